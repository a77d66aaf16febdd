"""A world that changes: what each stage shows, errors after a change of gain, files of a run."""

import json
import sys

import numpy as np
import pytest
import torch
from training_runs import only_run

from pacnet.datasets.demonstrations import Demonstration
from pacnet.forward_models.kinematics import KinematicModel
from train import changing_world
from train.changing import drink, gain
from train.changing.drink import ALL, BOTH, NEW, OLD, STAGES, THIRD, Stage, shown_in
from train.changing.gain import ANEW, HOLDING, NEAREST, NEVER, SENSOR, World, with_gain
from train.changing.replicates import DRINK, GAIN


def walk(steps: int, seed: int) -> torch.Tensor:
    """Readings that change slowly, `[steps, 6]`."""
    generator = torch.Generator().manual_seed(seed)
    ways = torch.randn(steps, 6, generator=generator).cumsum(0) / 20
    return (ways.sin() + 1) / 2


def make_world() -> World:
    """Two episodes before the change, one after it and one held out."""
    before = [with_gain(walk(300, seed), 1.0) for seed in range(2)]
    held_out = walk(40, 3)
    return World(
        before,
        [with_gain(walk(300, 2), 0.5)],
        [with_gain(held_out, 0.5)],
        [with_gain(held_out, 1.0)],
    )


# Gain


def test_a_gain_changes_one_reading_of_percepts_and_targets():
    readings = walk(10, 0)
    seen = with_gain(readings, 0.5)
    others = [i for i in range(6) if i != SENSOR]
    assert torch.equal(seen.percepts[:, SENSOR], readings[:, SENSOR] / 2)
    assert torch.equal(seen.percepts[:, others], readings[:, others])
    # A target is the percept three steps on; the last ones repeat.
    assert torch.equal(seen.targets[:7], seen.percepts[3:])
    assert torch.equal(seen.targets[7:], seen.percepts[-1:].expand(3, 6))
    assert torch.equal(with_gain(readings, 1.0).percepts, readings)


def test_errors_and_targets_of_every_row():
    world = make_world()
    scores = gain.score(world)
    assert {cell.split(" | ")[0] for cell in scores} == set(gain.ROWS)
    (held,) = world.held_out
    still = float((held.percepts - held.targets).abs().mean())
    assert scores[f"{HOLDING} | 300 | error"] == pytest.approx(still, rel=1e-5)

    # The mean target of the 50 nearest of all 900 frames, by a sort.
    percepts = np.concatenate([shown.percepts.numpy() for shown in (*world.before, *world.after)])
    targets = np.concatenate([shown.targets.numpy() for shown in (*world.before, *world.after)])
    errors = []
    for percept, target in zip(held.percepts.numpy(), held.targets.numpy(), strict=True):
        nearest = np.argsort(((percepts - percept) ** 2).sum(axis=1))[:50]
        errors.append(np.abs(targets[nearest].mean(axis=0) - target).mean())
    assert scores[f"{NEAREST} | 300 | error"] == pytest.approx(np.mean(errors), rel=1e-3)

    kept = {row: scores[f"{row} | 300 | targets"] for row in gain.ROWS}
    assert kept[NEAREST] == 900
    assert 0 < kept[ANEW] < 300
    assert kept[ANEW] == kept["sliding window of 300"] < kept["sliding window of 600"]
    assert kept["forgetting after 300"] < kept[NEVER] < 900


# Drink


def make_shown() -> dict[str, list[Demonstration]]:
    """Enough demonstrations of each behaviour, told apart by their actions."""
    none = torch.empty(2, 0)
    return {
        name: [Demonstration(0, name, none, none, torch.full((2, 1), i)) for i in range(9)]
        for name in (OLD, NEW, THIRD)
    }


def test_a_stage_shows_each_demonstration_once_and_in_order():
    for stage in STAGES.values():
        shown = shown_in(stage, make_shown())
        assert [one.task for one in shown] == list(stage.shown)
        assert [one.episode for one in shown] == list(range(len(shown)))
        for name in (OLD, NEW, THIRD):
            own = [float(one.action[0]) for one in shown if one.task == name]
            assert own == list(range(len(own)))


def test_what_was_shown_last_is_wanted_without_a_name_unless_both_ways_were_shown():
    assert {name: stage.settled for name, stage in STAGES.items()} == {
        "one world": (),
        "1 of the new way": (NEW,),
        "2 of the new way": (NEW,),
        "4 of the new way": (NEW,),
        BOTH: (),
        "2 of a third way": (THIRD,),
        ALL: (),
    }


def test_of_each_name_the_last_two_are_kept():
    shown = shown_in(Stage((OLD, OLD, NEW, OLD, NEW, NEW, THIRD), ()), make_shown())
    kept = [(one.task, float(one.action[0])) for one in drink._last(shown)]
    assert kept == [(OLD, 1), (OLD, 2), (NEW, 1), (NEW, 2), (THIRD, 0)]


@pytest.mark.slow
def test_alone_the_last_two_are_followed_and_with_names_both_ways_while_everything_keeps_to_the_old(
    monkeypatch,
):
    monkeypatch.setattr(drink, "_FIRST", (OLD,) * 3)
    first = (OLD, OLD, OLD, NEW, NEW)
    stages = {drink.AFTER_TWO: Stage(first, (NEW,)), BOTH: Stage((*first, OLD, NEW), (NEW, OLD))}
    monkeypatch.setattr(drink, "STAGES", stages)
    body = KinematicModel.from_pretrained("checkpoints/body")
    scores = drink.act_alone(1000, 1, body)
    success = {cell: score for cell, score in scores.items() if "targets" not in cell}
    assert success == {
        f"{drink.AFTER_TWO} | {drink.EVERYTHING} | {NEW}": 0.0,
        f"{drink.AFTER_TWO} | {drink.LAST} | {NEW}": 1.0,
        **{f"{BOTH} | {drink.NAMED} | {way}": 1.0 for way in (NEW, OLD)},
        **{f"{BOTH} | {drink.NAMED_LAST} | {way}": 1.0 for way in (NEW, OLD)},
    }


# A run


def fake_replicates(seeds, _episodes, _body):
    """Scores of every cell, which differ between replicates."""
    times = [f"{time} | {score}" for time in gain.TIMES for score in ("error", "error_before")]
    times += [f"{time} | targets" for time in gain.TIMES]
    ways = {name: (*stage.wanted, "targets") for name, stage in STAGES.items()}
    for seed in seeds:
        changed = {f"{row} | {time}": seed + 0.5 for row in gain.ROWS for time in times}
        changed |= {f"{row} | of anew": float(seed) for row in gain.ROWS}
        done = {
            f"{name} | {row} | {score}": float(seed)
            for name, scores in ways.items()
            for row in drink.ROWS
            for score in scores
        }
        del done[f"{ALL} | {drink.LAST} | {OLD}"]
        yield {GAIN: changed, DRINK: done}


def test_a_run_writes_scores_of_all_replicates_a_figure_and_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(changing_world, "run_replicates", fake_replicates)
    arguments = ["--seed", "4", "--replicates", "2", "--runs", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["changing_world", *arguments])
    changing_world.main()
    folder = only_run(tmp_path)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["command"].startswith("python -m train.changing_world --seed 4 --episodes 5")
    score = metrics["gain"][f"{NEVER} | 1200 | error"]
    assert score["values"] == [4.5, 5.5]
    assert score["mean"] == 5.0
    assert metrics["drink"][f"{BOTH} | {drink.SEVERAL} | {OLD}"]["values"] == [4.0, 5.0]
    assert [path.name for path in (folder / "figures").iterdir()] == ["changing_world.png"]
    printed = capsys.readouterr().out
    for line in (*gain.ROWS, *drink.ROWS, *STAGES):
        assert line in printed

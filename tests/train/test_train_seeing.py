"""Acting on pictures: what is watched, who acts beside the imitator, and how it is told."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from training_runs import only_run

from envs.scene import DEMONSTRATOR
from pacnet.datasets.demonstrations import Demonstration
from train import demonstrate, seeing
from train.postural.alone.scenes import draw_place
from train.postural.episodes import (
    Condition,
    demonstration_seeds,
    make_environment,
    motor_targets,
)
from train.postural.seeing import trials
from train.postural.seeing.actors import Nearest, Replay, coarse
from train.postural.seeing.trials import COUNTS, OURS, ROWS, STATE, cell
from train.postural.seeing.watching import CAMERA, RADIUS, told, watch


class _Looking:
    """An environment in which nothing but a picture of one colour is seen."""

    def __init__(self) -> None:
        self.level = 0

    def look(self) -> np.ndarray:
        return np.full((128, 128, 3), self.level, np.uint8)


def shown(*levels: int) -> list[Demonstration]:
    """Return demonstrations of three samples, whose pictures and actions tell their level."""
    return [
        Demonstration(
            number,
            "drink",
            torch.arange(3)[:, None].expand(3, 22).float(),
            torch.empty(3, 0),
            (10 * level + torch.arange(3.0))[:, None].expand(3, 11),
            pictures={CAMERA: np.full((3, 128, 128, 3), level, np.uint8)},
        )
        for number, level in enumerate(levels)
    ]


def observation(body: float) -> dict[str, np.ndarray]:
    return {"proprioception": np.full(22, body, np.float32)}


def test_a_coarse_picture_is_the_mean_over_its_cells():
    picture = np.zeros((128, 128, 3), np.uint8)
    picture[8:16, :4, 1] = 255  # half of the first cell of the second row, green
    row = coarse(picture)
    assert row.shape == (16 * 16 * 3,)
    assert row[16 * 3 + 1] == 0.5
    assert row.sum() == 0.5


def test_replay_chooses_by_the_first_picture_plays_in_order_and_holds_the_end():
    environment = _Looking()
    replay = Replay(shown(10, 90), environment)
    for first, actions in ((40, [100, 101, 102, 102]), (70, [900, 901, 902, 902])):
        environment.level = first
        replay.reset()
        played = []
        for _ in range(4):
            played.append(replay.step(observation(9.0))[0])
            environment.level = 50  # no later picture counts
        assert played == actions


def test_the_nearest_frame_is_of_the_own_state_and_of_the_first_picture():
    environment = _Looking()
    nearest = Nearest(shown(10, 90), environment)
    environment.level = 80
    nearest.reset()
    assert nearest.step(observation(1.2))[0] == 901
    assert nearest.step(observation(0.1))[0] == 900
    environment.level = 12
    assert nearest.step(observation(2.0))[0] == 902
    nearest.reset()
    assert nearest.step(observation(2.0))[0] == 102


def test_what_is_watched_is_seen_beside_the_demonstrators_head_and_elsewhere_each_time():
    environment = make_environment(Condition())
    one, other = demonstration_seeds(7, 2)
    percepts, pictures = watch(environment, one, RADIUS)
    assert len(percepts) == len(pictures)
    options = {"glass_offset": draw_place(one, RADIUS)}
    environment.reset(seed=one, options=options)
    np.testing.assert_array_equal(pictures[0], environment.look(DEMONSTRATOR))
    _, info = environment.reset(seed=other, options={"glass_offset": draw_place(other, RADIUS)})
    glass = percepts[:20, 22:25].mean(axis=0)
    assert np.abs(glass - info["glass_position"]).max() > 0.01
    environment.close()


def test_who_is_told_of_the_glass_watches_the_same_demonstrations():
    environment = make_environment(Condition())
    percepts, _ = watch(environment, demonstration_seeds(7, 1)[0], RADIUS)
    environment.close()
    (numbers,) = told(7, 1)
    np.testing.assert_array_equal(numbers.percepts.numpy(), percepts)
    np.testing.assert_array_equal(numbers.action.numpy(), motor_targets(percepts))


def test_tables_have_a_line_for_each_row_that_has_the_score(capsys):
    def summary(value: float) -> dict:
        return {"mean": value, "std": 0.0, "values": [value]}

    scores = {cell(row, count): {"success": summary(0.5)} for row in ROWS for count in COUNTS}
    scores[cell(OURS, COUNTS[0])]["absent_is_new"] = summary(1.0)
    seeing.print_tables(scores)
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [*STATE.split(), "0.50", "0.50"] in lines
    assert [OURS, "1.00", "-"] in lines
    assert sum(line[:1] == [OURS] for line in lines) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--radius", "0.1"], "expected --radius beside --camera"),
        (["--camera", "--radius", "0.5"], "expected a distance from 0 to 0.16 m, got '0.5'"),
    ],
)
def test_a_radius_that_cannot_be_is_refused(monkeypatch, capsys, arguments, message):
    monkeypatch.setattr(sys, "argv", ["demonstrate", "somewhere", *arguments])
    with pytest.raises(SystemExit):
        demonstrate.main()
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_leaves_scores_a_figure_and_a_film(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setattr(trials, "COUNTS", (6, 10))
    monkeypatch.setattr(seeing, "COUNTS", (6, 10))
    arguments = ["--episodes", "1", "--seed", "5", "--runs", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["seeing", *arguments])
    seeing.main()
    run = only_run(tmp_path)
    for name in ("figures/seeing.png", "seeing.mp4", "seeing.gif"):
        assert (run / name).stat().st_size > 1000
    scores = json.loads((run / "metrics.json").read_text())
    assert scores["ours | 10"]["success"]["values"] == [1.0]
    assert scores["ours | 10"]["absent_is_new"]["values"] == [1.0]
    assert "ours" in capsys.readouterr().out

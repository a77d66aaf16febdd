"""What is worth remembering: streams, the rules that are compared, files of a run."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from training_runs import only_run

from pacnet.datasets.demonstrations import Demonstration
from pacnet.forward_models.kinematics import KinematicModel
from train import memory
from train.remembering import alone, cues, replicates, walls
from train.remembering.clusters import batch_means, nearest_frames, online_means
from train.remembering.replicates import ALONE, BUDGET, BUDGETS, CUES, CURVE, WALLS
from train.remembering.rules import RULES, Choice, evenly_of_last, moving, moving_of_last, novel
from train.remembering.streams import (
    DRINK,
    NOISY,
    PLAIN,
    RARE,
    RESTS,
    STREAMS,
    TOAST,
    Stream,
    numbers_of,
    show,
)


def choice(budget: int, seed: int = 0) -> Choice:
    """A walk on a circle, three times around, the last time resting for 300 frames first."""
    angle = np.concatenate(
        [np.linspace(0, 6.28, 100)] * 2 + [np.zeros(300), np.linspace(0, 6, 100)]
    )
    of, task = np.repeat([[0, 1, 2], [0, 1, 1]], [100, 100, 400], axis=1)
    noise = 0.01 * np.random.default_rng(1).standard_normal((600, 2))
    return Choice(np.stack([np.cos(angle), np.sin(angle)], axis=1) + noise, of, task, budget, seed)


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_keeps_frames_within_the_budget(rule: str):
    for budget in (2, 12, 40):
        kept = RULES[rule](choice(budget))
        assert 0 < len(kept) <= budget
        assert (np.diff(kept) > 0).all()
        assert kept[0] >= 0
        assert kept[-1] < 600
        np.testing.assert_array_equal(RULES[rule](choice(budget)), kept)  # the same again


def test_every_nth_frame_of_the_last_demonstration():
    assert evenly_of_last(choice(4)).tolist() == [250, 350, 450, 550]  # of 200 to 599


def test_moving_frames_of_the_last_demonstration_of_each_task_and_none_of_the_rest():
    kept = moving_of_last(choice(40))
    assert len(kept) == 40
    assert ((kept < 100).sum(), (kept >= 200).sum()) == (20, 20)  # none of 100 to 199
    assert not np.isin(kept, np.arange(200, 470)).any()  # it rests until 499
    apart = np.diff(kept[kept >= 200])
    assert apart.max() - apart.min() <= 1  # every n-th
    # Where nothing moves, every n-th frame of all.
    still = replace(choice(8), percepts=0.01 * np.random.default_rng(0).standard_normal((600, 2)))
    assert len(moving_of_last(replace(still, percepts=np.zeros((600, 2))))) == 8
    assert moving(still.percepts).mean() < 0.1


def test_frames_are_numbered_by_demonstration_and_by_task():
    one = Demonstration(0, "a", torch.zeros(2, 1), torch.zeros(2, 0), torch.zeros(2, 1))
    of, task = numbers_of([one, replace(one, task="b"), one])
    assert of.tolist() == [0, 0, 1, 1, 2, 2]
    assert task.tolist() == [0, 0, 1, 1, 0, 0]


def test_novelty_alone_covers_the_circle_once_however_long_the_rest():
    kept = novel(choice(12))
    assert kept[0] == 0
    assert (kept < 100).sum() >= 8  # later rounds show little that is new
    frames = choice(12).percepts
    apart = np.linalg.norm(frames[:, None] - frames[kept], axis=2).min(axis=1)
    assert apart.max() < 0.7  # a twelfth of the way around is 0.52


def test_half_of_random_frames_are_of_the_rest_and_hardly_any_novel_ones():
    resting = np.arange(200, 500)  # half of the frames
    share = {name: np.isin(RULES[name](choice(60)), resting).mean() for name in RULES}
    assert share["random frames (a reservoir)"] == pytest.approx(0.5, abs=0.2)
    assert share["every n-th frame"] == pytest.approx(0.5, abs=0.02)
    assert share["novelty alone"] < 0.1


def test_online_means_are_running_means_of_what_each_wins():
    frames = np.array([[0.0], [10.0], [1.0], [12.0], [2.0]])
    # 0, 1 and 2 are nearer to the first, 10 and 12 to the second.
    np.testing.assert_allclose(online_means(frames, 2), [[1.0], [11.0]])
    assert nearest_frames(frames, np.array([[1.1], [11.4]])).tolist() == [2, 3]


def test_the_mean_target_of_the_nearest_cues():
    stored, targets = np.array([[0.0], [1.0], [3.0], [9.0]]), np.array([[1.0], [2.0], [6.0], [7.0]])
    asked = np.array([[0.2], [8.0]])
    assert cues._nearest(stored, targets, asked).tolist() == [[1.0], [7.0]]
    assert cues._nearest(stored, targets, asked, 2).tolist() == [[1.5], [6.5]]


def test_batch_means_find_groups():
    rng = np.random.default_rng(0)
    frames = np.concatenate([rng.normal(centre, 0.1, (50, 2)) for centre in (0, 5, 9)])
    means = np.sort(batch_means(frames, 3, rng)[:, 0])
    np.testing.assert_allclose(means, [0, 5, 9], atol=0.1)


def test_after_rests_all_episodes_are_played_and_elsewhere_a_tenth():
    assert replicates.budgets_alone(RESTS, 20) == {20: 2, 40: 20, 100: 2}
    assert replicates.budgets_alone(PLAIN, 20) == dict.fromkeys(CURVE, 2)
    assert replicates.budgets_alone(RARE, 1) == replicates.budgets_alone(NOISY, 1) == {BUDGET: 1}


def test_a_stream_shows_its_behaviours_in_order_each_after_a_rest():
    plain = show(Stream((DRINK, TOAST)), 3)
    shown = show(Stream((DRINK, TOAST), rest=2.0), 3)
    assert [one.task for one in shown] == [one.task for one in plain]
    assert len({one.task for one in shown}) == 2
    for one, other in zip(shown, plain, strict=True):
        assert len(one.state) == len(other.state) + 100  # 2 s at 50 Hz
        np.testing.assert_array_equal(one.percepts[100:], other.percepts)
        still = one.percepts[:100].numpy()
        np.testing.assert_allclose(still[:, :11].mean(axis=0), other.percepts[0, :11], atol=0.03)
        assert 0.005 < still[:, 0].std() < 0.02  # noise of 0.01 rad
    assert STREAMS[RARE].shown.count(TOAST) == 1
    assert STREAMS[RARE].wanted == TOAST


@pytest.mark.slow
def test_after_a_rest_the_keyframes_drink_alone_and_random_frames_do_not(monkeypatch):
    rare = "random frames (a reservoir)"
    monkeypatch.setattr(alone, "RULES", {rare: RULES[rare]})
    monkeypatch.setattr(cues, "RULES", {rare: RULES[rare]})
    body = KinematicModel.from_pretrained("checkpoints/body")
    stream = Stream((DRINK,) * 2, rest=20.0)
    scores = alone.score_alone(stream, {BUDGET: 1}, 1000, body)
    assert scores[f"{BUDGET} | {alone.OURS}"] == 1.0
    assert scores[f"{BUDGET} | {rare}"] == 0.0
    errors = cues.score_cues(stream, [BUDGET], 1000)
    assert errors[f"{BUDGET} | {alone.OURS}"] < 1.3 * errors[f"{BUDGET} | {alone.ALL}"]
    assert errors[f"{BUDGET} | {cues.MEAN_OF_ALL}"] < errors[f"{BUDGET} | {alone.ALL}"]
    assert errors[f"{BUDGET} | {rare}"] > 2 * errors[f"{BUDGET} | {alone.ALL}"]


def fake_replicates(seeds, episodes, _body, experiments):
    """Scores of every cell, which differ between replicates."""
    for seed in seeds:
        acted = {
            f"{stream} | {budget} | {row}": float(seed)
            for stream in STREAMS
            for budget in replicates.budgets_alone(stream, episodes)
            for row in alone.ROWS
        }
        found = {
            f"{stream} | {budget} | {row}": seed + 0.5
            for stream in STREAMS
            for budget in (BUDGETS if stream in (PLAIN, RESTS) else (BUDGET,))
            for row in cues.ROWS
        }
        followed = {
            f"{walls.RESTS} | {count}-NN {score} | {row}": seed + 0.25
            for count in walls.COUNTS
            for score in walls.SCORES
            for row in walls.ROWS
        }
        every = {ALONE: acted, CUES: found, WALLS: followed}
        yield {name: every[name] for name in experiments}


def test_a_run_writes_scores_of_all_replicates_a_figure_and_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(memory, "run_replicates", fake_replicates)
    arguments = ["--seed", "4", "--replicates", "2", "--runs", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["memory", *arguments])
    memory.main()
    folder = only_run(tmp_path)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["command"].startswith("python -m train.memory --seed 4")
    assert metrics[ALONE][f"{RESTS} | 40 | {alone.OURS}"]["values"] == [4.0, 5.0]
    assert metrics[WALLS][f"{walls.RESTS} | 8-NN tight | {walls.PACNET}"]["mean"] == 4.75
    assert [path.name for path in (folder / "figures").iterdir()] == ["memory.png"]
    assert "5.00 ± 0.71" in capsys.readouterr().out


def test_one_of_the_experiments_can_be_run_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(memory, "run_replicates", fake_replicates)
    monkeypatch.setattr(sys, "argv", ["memory", "--only", WALLS, "--runs", str(tmp_path)])
    memory.main()
    metrics = json.loads((only_run(tmp_path) / "metrics.json").read_text())
    assert WALLS in metrics
    assert ALONE not in metrics
    assert "following walls alone" in capsys.readouterr().out

"""Spoiled demonstrations: random draws, policies, scores, files of a run."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from training_runs import interrupt, only_run

from envs.mishaps import MISHAPS
from pacnet import PACNet
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.evaluation.figure_style import BLUE, VERMILION
from train import retraining
from train.postural.episodes import (
    Condition,
    demonstration_seeds,
    make_environment,
    watch_demonstration,
)
from train.postural.learning import NOVELTY_THRESHOLD, make_network
from train.postural.retraining.replicates import (
    POLICIES,
    UNSPOILED,
    Replicate,
    TrainingRun,
    draw_replicates,
    record,
    shown_to,
    teach,
)
from train.postural.retraining.report import Outcome, draw, groups, print_tables, summary

OVERWRITING, SEVERAL = "overwriting", "several_schemas"
PROJECT = Path(__file__).parents[2]


def spoiled_in(replicate: Replicate) -> int:
    return sum(mishap is not None for mishap in replicate.mishaps)


@pytest.mark.parametrize(
    ("demonstrations", "share", "number"), [(10, 0.2, 2), (10, 0.01, 1), (8, 0.99, 7), (2, 0.5, 1)]
)
def test_the_share_is_rounded_but_some_are_spoiled_and_not_all(
    demonstrations: int, share: float, number: int
):
    for replicate in draw_replicates(1000, 5, demonstrations, share):
        assert len(replicate.mishaps) == demonstrations
        assert spoiled_in(replicate) == number


def test_every_demonstration_and_every_mishap_is_equally_likely():
    replicates = draw_replicates(1000, 600, 10, 0.2)
    places = Counter(
        place
        for replicate in replicates
        for place, mishap in enumerate(replicate.mishaps)
        if mishap is not None
    )
    mishaps = Counter(filter(None, (m for replicate in replicates for m in replicate.mishaps)))
    assert set(places) == set(range(10))
    assert set(mishaps) == set(MISHAPS)
    # 1200 draws: 120 at each place and 400 of each mishap, give or take four standard deviations.
    assert all(abs(count - 120) < 42 for count in places.values())
    assert all(abs(count - 400) < 66 for count in mishaps.values())


def test_fewer_replicates_are_the_first_of_more_and_no_two_share_a_seed():
    many = draw_replicates(1000, 20, 10, 0.2)
    assert draw_replicates(1000, 3, 10, 0.2) == many[:3]
    assert len({replicate.seed for replicate in many}) == 20
    assert draw_replicates(1001, 3, 10, 0.2) != many[:3]


def test_the_order_of_demonstrations_of_each_policy():
    replicate = Replicate(1, (None, "miss", None, "tremor", None))
    shown = {policy: shown_to(POLICIES[policy], replicate) for policy in POLICIES}
    for policy in (OVERWRITING, SEVERAL):
        assert shown[policy] == [0, 1, 2, 3, 4]
        assert shown[f"{policy}_spoiled_last"] == [0, 2, 4, 1, 3]
    assert shown[UNSPOILED] == [0, 2, 4]


@pytest.fixture(scope="module")
def replicate() -> Replicate:
    return Replicate(1000, (None, "miss"))


@pytest.fixture(scope="module")
def dataset(replicate: Replicate, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("retraining") / "dataset"
    record(replicate, folder)
    return folder


@pytest.mark.slow
def test_the_dataset_holds_the_demonstrations_with_their_mishaps(
    replicate: Replicate, dataset: Path
):
    environment = make_environment(Condition())
    recorded = load_demonstrations(dataset)
    seeds = demonstration_seeds(replicate.seed, 2)
    assert len(recorded) == 2
    for demonstration, seed, mishap in zip(recorded, seeds, replicate.mishaps, strict=True):
        watched = watch_demonstration(environment, seed, mishap)
        np.testing.assert_array_equal(demonstration.percepts.numpy(), watched)


@pytest.mark.slow
def test_each_network_learns_what_it_is_shown(replicate: Replicate, dataset: Path, tmp_path: Path):
    recorded = load_demonstrations(dataset)  # of which the second is spoiled
    for policy, shown in ((OVERWRITING, recorded.episodes), (UNSPOILED, recorded.episodes[:1])):
        teach(TrainingRun(replicate, policy, dataset, tmp_path / policy, episodes=1))
        network = make_network(NOVELTY_THRESHOLD)
        for number, demonstration in enumerate(shown):
            network.observe(demonstration.percepts, demonstration.action, number)
        expected = network.state_dict()
        for name, tensor in PACNet.from_pretrained(tmp_path / policy).state_dict().items():
            np.testing.assert_array_equal(tensor.numpy(), expected[name].numpy(), name)


@pytest.mark.slow
def test_the_networks_of_a_replicate_differ_only_in_their_schemas(
    replicate: Replicate, dataset: Path, tmp_path: Path
):
    maps = []
    for policy in (OVERWRITING, SEVERAL):
        teach(TrainingRun(replicate, policy, dataset, tmp_path / policy, episodes=1))
        network = PACNet.from_pretrained(tmp_path / policy)
        assert network.config.schemas == POLICIES[policy].schemas
        maps.append(network.sofm)
    for other in maps[1:]:
        assert other.config == maps[0].config
        np.testing.assert_array_equal(other.prototypes.numpy(), maps[0].prototypes.numpy())


def outcome(
    seed: int, mishaps: tuple[str | None, ...], overwriting: float, several: float
) -> Outcome:
    def scores(success: float) -> dict[str, float | int]:
        distances = {"wrist_distance_mean_m": 0.02 - success / 100, "wrist_distance_max_m": 0.1}
        return {"task_success_rate": success, **distances, "nodes": 12, "schemas": 30}

    by_policy = {policy: scores(1.0) for policy in POLICIES}
    by_policy |= {OVERWRITING: scores(overwriting), SEVERAL: scores(several)}
    return Outcome(Replicate(seed, mishaps), by_policy)


OUTCOMES = (
    outcome(1, (None, "tremor", None), overwriting=0.9, several=1.0),
    outcome(2, (None, "miss", "interrupted"), overwriting=0.1, several=0.8),
    outcome(3, ("miss", None, None), overwriting=0.8, several=0.8),
)


def test_means_and_gains_are_those_of_hand_made_scores():
    scores = summary(OUTCOMES)
    overwriting = scores["policies"][OVERWRITING]["task_success_rate"]
    assert overwriting["mean"] == pytest.approx(0.6)
    # Off the mean by 0.3, -0.5 and 0.2: 0.38 / 2 = 0.19.
    assert overwriting["std"] == pytest.approx(0.19**0.5)
    gained = scores["gained_over_overwriting"]
    assert OVERWRITING not in gained
    assert UNSPOILED not in gained  # is no way of ours to learn
    assert gained[SEVERAL]["task_success_rate"]["values"] == pytest.approx([0.1, 0.7, 0.0])
    assert gained[SEVERAL]["wrist_distance_mean_m"]["mean"] == pytest.approx(-0.8 / 300)
    assert [one["mishaps"] for one in scores["replicates"]] == [
        one.replicate.mishaps for one in OUTCOMES
    ]
    json.dumps(scores)  # goes into a file


def test_groups_are_by_mishap_and_by_the_last_demonstration():
    seeds = {
        name: [one.replicate.seed for one in group] for name, group in groups(OUTCOMES).items()
    }
    assert seeds == {
        "with tremor": [1],
        "with interrupted": [2],
        "with miss": [2, 3],
        "drawn last spoiled": [2],
        "drawn last unspoiled": [1, 3],
    }
    assert set(groups(OUTCOMES[:1])) == {"with tremor", "drawn last unspoiled"}
    by_group = summary(OUTCOMES)["groups"]["with miss"]
    assert by_group["replicates"] == 2
    assert by_group["policies"][SEVERAL]["task_success_rate"]["mean"] == pytest.approx(0.8)


def test_the_figure_has_a_dot_for_each_replicate_where_it_scored():
    axes = draw(OUTCOMES).axes[0]
    dots = {
        colour: [
            tuple(point)
            for line in axes.lines
            if line.get_color() == colour
            for point in line.get_xydata().tolist()
        ]
        for colour in (BLUE, VERMILION)
    }
    places = list(POLICIES)
    rows = Counter(
        (colour, places[round(y)], x) for colour, points in dots.items() for x, y in points
    )
    assert rows[BLUE, OVERWRITING, 0.9] == rows[BLUE, OVERWRITING, 0.8] == 1
    assert rows[VERMILION, OVERWRITING, 0.1] == 1  # whose last demonstration was spoiled
    assert rows[BLUE, SEVERAL, 1.0] == rows[BLUE, SEVERAL, 0.8] == 1
    assert rows[VERMILION, SEVERAL, 0.8] == 1
    assert rows[VERMILION, "several_schemas_spoiled_last", 1.0] == 3
    assert rows[BLUE, UNSPOILED, 1.0] == 3
    assert len({*dots[BLUE], *dots[VERMILION]}) == 3 * len(POLICIES)  # none hides another
    assert axes.get_xlim()[0] < 0 < 1 < axes.get_xlim()[1]


def test_the_tables_show_every_policy_and_group(capsys: pytest.CaptureFixture[str]):
    print_tables(summary(OUTCOMES))
    lines = capsys.readouterr().out.splitlines()
    (overwriting, by_group) = (line for line in lines if line.startswith("overwriting, as drawn"))
    assert "0.6000 ± 0.4359" in overwriting
    assert "0.4500 ± 0.4950" in by_group  # with a miss: 0.1 and 0.8
    assert any("drawn last spoiled" in line for line in lines)
    assert "gained over overwriting" in lines


def test_one_demonstration_is_too_few(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(sys, "argv", ["retraining", "--demonstrations", "1"])
    with pytest.raises(SystemExit, match="2"):
        retraining.parse_arguments()
    assert "--demonstrations: expected an integer ≥ 2, got '1'" in capsys.readouterr().err


def command(runs: Path, replicates: int) -> list[str]:
    options = ("--demonstrations", "2", "--episodes", "1", "--seed", "1000")
    module = [sys.executable, "-m", "train.retraining"]
    return [*module, *options, "--replicates", str(replicates), "--runs", str(runs)]


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folders = []
    for name in ("one", "two"):
        runs = tmp_path_factory.mktemp(name)
        subprocess.run(command(runs, 2), cwd=PROJECT, capture_output=True, check=True)
        folders.append(only_run(runs))
    return folders


@pytest.mark.slow
def test_a_run_writes_all_its_files(two_runs: list[Path]):
    folder = two_runs[0]
    names = {path.name for path in folder.iterdir()}
    assert names == {"dataset", "checkpoint", "figures", "tensorboard", "metrics.json"}
    assert [path.name for path in (folder / "figures").iterdir()] == ["retraining.png"]
    scores = json.loads((folder / "metrics.json").read_text())
    assert set(scores["policies"]) == set(POLICIES)
    assert [one["seed"] for one in scores["replicates"]] == [
        replicate.seed for replicate in draw_replicates(1000, 2, 2, 0.2)
    ]
    for number in range(2):
        assert len(load_demonstrations(folder / "dataset" / f"replicate-{number}")) == 2
        for policy in POLICIES:
            checkpoint = folder / "checkpoint" / f"replicate-{number}" / policy
            network = PACNet.from_pretrained(checkpoint)
            nodes = scores["replicates"][number]["policies"][policy]["nodes"]
            assert nodes == len(network.sofm)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(two_runs: list[Path]):
    one, two = two_runs
    kept = [
        path.relative_to(one)
        for pattern in ("metrics.json", "checkpoint/**/*.*", "dataset/*/data/**/*.parquet")
        for path in one.glob(pattern)
    ]
    assert len(kept) == 1 + 2 * 2 * len(POLICIES) + 2
    for file in kept:
        assert (one / file).read_bytes() == (two / file).read_bytes(), file


@pytest.mark.slow
def test_ctrl_c_keeps_the_replicates_that_are_finished(tmp_path: Path):
    interrupt(command(tmp_path, 20), tmp_path, lambda _: list(tmp_path.glob("*/*/metrics.json")))
    scores = json.loads((only_run(tmp_path) / "metrics.json").read_text())
    assert 1 <= len(scores["replicates"]) < 20

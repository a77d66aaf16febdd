"""The benchmark on any datasets: its rows are what the library scores, refusals have rows too."""

from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import real_budget, real_data, results_page
from pacnet import Imitator, Recorder, load_demonstrations
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.evaluation import Split, score, splits

FRAMES = 60


def record(root: Path, dimensions: int, episodes: int, seed: int = 0, offset: float = 0.0) -> str:
    """Waves, whose slopes are the actions; the last dimension never moves."""
    rng = np.random.default_rng(seed)
    names = {"observation.state": [f"x{d}" for d in range(dimensions)], "action": ["u"]}
    with Recorder(root, 20, names) as recorder:
        for _ in range(episodes):
            phase = np.linspace(0, rng.uniform(6, 7), FRAMES)[:, None] + np.arange(dimensions)
            state = np.sin(phase) + 0.01 * rng.standard_normal(phase.shape)
            state[:, -1] = 0.5
            action = rng.uniform(0.5, 2) * np.cos(phase[:, :1])
            recorder.save_episode("swing", {"observation.state": state + offset, "action": action})
    return str(root)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    base = tmp_path_factory.mktemp("datasets")
    return [
        record(base / "waves", 3, 3),
        record(base / "far", 3, 2, seed=1, offset=9.0),
        record(base / "wider", 4, 2, seed=2),
        record(base / "alone", 3, 1, seed=3),
        str(base / "missing"),
    ]


@pytest.fixture(scope="module")
def tables(folders: list[str]) -> list[real_data.Table]:
    return real_data.measure(folders)


def test_held_out_episodes_have_the_scores_of_the_library(
    folders: list[str], tables: list[real_data.Table]
):
    row = dict(zip(tables[0].columns, tables[0].rows[0], strict=True))
    scores = score(splits(load_demonstrations(folders[0])))
    best = min(scores.baselines[name] for name in ("1-NN", "5-NN", "5-NN with history"))
    assert list(row.values())[:5] == ["waves", "3 / 1", "3", "180", "20"]
    assert row["acts"] == f"{scores.acted:.1%}"
    assert row["error"] == f"{scores.error:.3f}"
    assert row["of the best neighbours'"] == f"{scores.error / best:.2f} ×"
    for name, error in scores.baselines.items():
        assert row[name] == f"{error:.3f}"


def test_one_demonstration_is_the_first_of_the_training_data(
    folders: list[str], tables: list[real_data.Table]
):
    one, two, three = (load_demonstrations(folders[0], episodes=[n]) for n in range(3))
    parted = splits(load_demonstrations(folders[0]))
    known = [split.training for split in parted]
    scores = score(
        [Split(two, one, known[0]), Split(one, two, known[1]), Split(one, three, known[2])]
    )
    ratio = f"{scores.error / scores.baselines['1-NN']:.2f} ×"
    assert tables[1].rows[0] == ("waves", f"{scores.acted:.1%}", f"{scores.error:.3f}", ratio)


def test_as_many_frames_are_kept_in_each_way(folders: list[str], tables: list[real_data.Table]):
    """Two of three episodes are learned in each of three splits: 120 frames, 6 by the budget."""
    row = dict(zip(tables[2].columns, tables[2].rows[0], strict=True))
    assert (row["dataset"], row["frames learned"], row["kept"]) == ("waves", "360", "18")
    parted = splits(load_demonstrations(folders[0]))
    assert row["all"] == tables[0].rows[0][tables[0].columns.index("error")]
    assert row["1-NN, all frames"] == f"{score(parted).baselines['1-NN']:.3f}"

    def kept(training: Demonstrations) -> Imitator:
        imitator = Imitator.from_demonstrations(training, budget=6)
        imitator.learn(training)
        return imitator

    assert row["keyframes"] == f"{score(parted, kept).error:.3f}"
    # Of 120 rows six at distances of 119 / 5.
    evenly = real_budget._choose(120, 6, None)
    assert np.flatnonzero(evenly).tolist() == [0, 24, 48, 71, 95, 119]
    assert real_budget._choose(120, 6, 40).sum() == 6


def test_only_datasets_of_the_same_width_are_new_to_one_another(tables: list[real_data.Table]):
    rows = {name: cells for name, *cells in tables[3].rows}
    assert rows["waves"][0] == "2"  # one of three never moves
    assert [rows[name][3] for name in ("waves", "far", "wider")] == ["100.0%", "100.0%", "–"]
    assert float(rows["waves"][2].rstrip("%")) > 20 > float(rows["waves"][1].rstrip("%"))


def test_what_cannot_be_measured_has_a_row_that_says_why(
    folders: list[str], tables: list[real_data.Table]
):
    for table in tables:
        reasons = {row[0]: row[1] for row in table.rows if row[0] in ("alone", "missing")}
        assert "expected at least 2 episodes" in reasons["alone"]
        assert reasons["missing"].startswith("expected the folder of a LeRobot dataset")
        assert all(len(row) == len(table.columns) for row in table.rows)
        assert str(Path(folders[0]).parent) not in str(table)


def test_each_dimension_that_moves_is_moved_up_and_down_by_turns():
    percepts = torch.zeros(2, 3)
    deviations = torch.tensor([1.0, 0.0, 2.0])
    even, odd = ([*real_data.moved(percepts, deviations, number)] for number in (4, 7))
    assert [rows[1].tolist() for rows in even] == [[3, 0, 0], [0, 0, -6]]
    assert [rows[0].tolist() for rows in odd] == [[-3, 0, 0], [0, 0, 6]]
    assert not percepts.any()


def test_novel_percepts_are_called_so_from_the_beginning_of_an_episode(folders: list[str]):
    demonstrations = load_demonstrations(folders[0])
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    percepts = demonstrations.episodes[0].percepts
    far = real_data.novel(imitator, percepts + 9, "swing")
    assert far.dtype == np.bool_
    assert far.all()
    assert not real_data.novel(imitator, percepts, "swing").any()


def test_parts_of_the_page_are_replaced_or_added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(results_page, "PAGE", tmp_path / "benchmarks.md")
    results_page.update("one", "first\n")
    results_page.update("other", r"a \1 | b")
    results_page.update("one", "second")
    assert results_page.PAGE.read_text("utf-8") == (
        f"{results_page.INTRO}\n<!-- one -->\nsecond\n<!-- end of one -->\n\n"
        "<!-- other -->\na \\1 | b\n<!-- end of other -->\n"
    )
    results_page.PAGE.write_text("<!-- one -->\nwithout an end\n", "utf-8")
    with pytest.raises(ValueError, match="expected '<!-- one -->' and then"):
        results_page.update("one", "third")


def test_the_command_prints_and_writes(
    folders: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr(results_page, "PAGE", tmp_path / "benchmarks.md")
    monkeypatch.setattr("sys.argv", ["real_data", folders[2]])
    real_data.main()
    printed = capsys.readouterr().out
    assert printed.count("| wider ") == 4
    assert not results_page.PAGE.exists()
    monkeypatch.setattr("sys.argv", ["real_data", folders[2], "--write"])
    real_data.main()
    assert printed.strip() in results_page.PAGE.read_text("utf-8")

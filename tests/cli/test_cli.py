"""The command line: its output matches the Python API, and every failure is one line."""

import io
import itertools
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from safetensors.torch import load_file
from tqdm import tqdm

import pacnet
from pacnet.cli import main
from pacnet.cli.explain import print_explanation
from pacnet.cli.explanation import explain
from pacnet.cli.printing import print_table
from pacnet.cli.replay import reason_of, replay
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.evaluation.figure_style import BLUE
from pacnet.imitator import Imitator, ImitatorStep
from pacnet.network import Decision, PACNet

PROJECT = Path(__file__).parents[2]
STATE, SURROUNDINGS, ACTION = "observation.state", "observation.environment_state", "action"
NAMES = {STATE: ("x", "y"), SURROUNDINGS: ("z",), ACTION: ("right", "up")}
BENDS = {"drink": 1.0, "wave": -1.0, "juggle": 3.0}  # of any other task 0


def record(
    root: Path,
    tasks: Sequence[str],
    seed: int,
    frames: int = 80,
    names: Mapping[str, Sequence[str]] = NAMES,
    fps: int = 20,
) -> Path:
    """A dataset of an episode for each task: noisy paths, straight for a third, then bending."""
    from pacnet.datasets.recorder import Recorder

    rng = np.random.default_rng(seed)
    with Recorder(root, fps, names, "hand") as recorder:
        for task in tasks:
            along = np.linspace(0, 3, frames)
            bent = BENDS.get(task, 0) * np.clip(along - 1, 0, None)
            path = np.stack([along, bent, np.sin(along)], axis=1)
            path += 0.01 * rng.standard_normal(path.shape)
            features = (path[:, :2], path[:, 2:], np.gradient(path[:, :2], axis=0))
            recorder.save_episode(task, dict(zip(names, features, strict=True)))
    return root


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("data") / "shown", ("drink", "wave") * 3, 1000)


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What was shown, and something that was not."""
    return record(tmp_path_factory.mktemp("data") / "others", ("wave", "drink", "juggle"), 1001)


@pytest.fixture(scope="module")
def imitator(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint that the command wrote."""
    folder = tmp_path_factory.mktemp("checkpoint") / "imitator"
    assert run("fit", dataset, "--out", folder) == 0
    return folder


def run(*arguments: object) -> int:
    """The exit code of a command in this process."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as end:  # as argparse ends
        return int(end.code or 0)


def refusal(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line with which a command fails."""
    capsys.readouterr()
    assert run(*arguments) == 1
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    return error


def rows_under(head: str, printed: str) -> list[list[str]]:
    """The cells of a table's rows, from the line after its head on."""
    lines = printed.splitlines()
    first = next(place for place, line in enumerate(lines) if re.match(rf" *{head}\b", line))
    cells = [re.split(" {2,}", line.strip()) for line in lines[first:]]
    return [row for row in cells[1:] if len(row) == len(cells[0])]


def value_of(name: str, printed: str) -> str:
    """The value printed beside a name at the start of a line."""
    (value,) = re.findall(rf"^{name} {{2,}}(.*)$", printed, re.MULTILINE)
    return value


def unannounced(error: str) -> str:
    """What went to standard error, without what the first run on a machine says."""
    return re.sub(r"^pacnet: compiling for this machine, once, .*\n", "", error)


def taught(*datasets: Path) -> Imitator:
    """The second method: the same learned in Python."""
    shown = [load_demonstrations(dataset) for dataset in datasets]
    imitator = Imitator.from_demonstrations(shown[0])
    for demonstrations in shown:
        imitator.learn(demonstrations)
    return imitator


def assert_equal(imitator: Imitator, other: Imitator) -> None:
    tensors = other.state_dict()
    assert imitator.state_dict().keys() == tensors.keys()
    for name, tensor in imitator.state_dict().items():
        torch.testing.assert_close(tensor, tensors[name], rtol=0, atol=0, msg=name)
    assert imitator.config == other.config
    assert list(map(repr, imitator.reports)) == list(map(repr, other.reports))  # NaN equals NaN


# fit


def test_it_tells_its_version(capsys: pytest.CaptureFixture[str]):
    assert run("--version") == 0
    assert capsys.readouterr().out == f"pacnet {pacnet.__version__}\n"


def test_fit_prints_what_each_episode_changed(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", dataset, "--out", tmp_path / "out") == 0
    out, error = capsys.readouterr()
    assert unannounced(error) == ""  # no progress bar where nobody watches it
    rows = rows_under("dataset", out)
    saved = Imitator.from_pretrained(tmp_path / "out").network
    assert [row[:4] for row in rows] == [
        ["shown", str(number), task, "80"] for number, task in enumerate(("drink", "wave") * 3)
    ]
    grown = np.array([int(row[4]) for row in rows])
    assert [int(row[5]) for row in rows] == grown.cumsum().tolist()
    assert grown.sum() == len(saved.sofm) == int(value_of("nodes", out))
    novelty = [row[7] for row in rows]
    assert novelty[0] == "–"
    assert float(novelty[1]) > 1  # the first that waves
    assert max(map(float, novelty[2:])) < float(novelty[1]) / 2
    assert int(value_of("schemas", out)) == len(saved.schemas.lengths)
    assert value_of("targets", out) == f"{int(saved.schemas.lengths.sum())} actions"
    assert value_of("learned", out).startswith("6 episodes, 480 frames in ")


def test_fit_prints_the_share_of_each_episode_that_is_stored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    for frames in (80, 24, 4):
        root = record(tmp_path / f"{frames}", ("drink",), 1010, frames)
        assert run("fit", root, "--out", tmp_path / f"taught{frames}") == 0
        ((*_, stored, _),) = rows_under("dataset", capsys.readouterr().out)
        schemas = Imitator.from_pretrained(tmp_path / f"taught{frames}").network.schemas
        # Of one episode alone no target is merged with another's: each has a frame of its own.
        kept = {
            frame
            for schema in range(len(schemas.lengths))
            for frame in schemas.frames(schema).tolist()
        }
        assert stored == f"{len(kept) / frames:.1%}"
        assert run("info", tmp_path / f"taught{frames}") == 0
        assert rows_under("dataset", capsys.readouterr().out)[0][6] == stored
    assert stored == "0.0%"


def test_fit_writes_what_python_learns(dataset: Path, imitator: Path):
    assert_equal(Imitator.from_pretrained(imitator), taught(dataset))


def test_fit_continues_from_a_checkpoint(
    dataset: Path,
    other: Path,
    imitator: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    before = (imitator / "model.safetensors").read_bytes()
    assert run("fit", other, "--from", imitator, "--out", tmp_path) == 0
    assert_equal(Imitator.from_pretrained(tmp_path), taught(dataset, other))
    assert (imitator / "model.safetensors").read_bytes() == before
    out = capsys.readouterr().out
    assert [row[0] for row in rows_under("dataset", out)] == ["others"] * 3
    assert value_of("learned", out).endswith("(9 episodes in all)")


def test_fit_with_corrections_leaves_thresholds_alone(dataset: Path, other: Path, tmp_path: Path):
    assert run("fit", dataset, "--out", tmp_path / "one") == 0
    more = ("fit", other, "--from", tmp_path / "one")
    assert run(*more, "--corrections", "--out", tmp_path / "corrected") == 0
    assert run(*more, "--out", tmp_path / "both") == 0
    one, corrected, both = (
        Imitator.from_pretrained(tmp_path / name).novelty_detector
        for name in ("one", "corrected", "both")
    )
    assert np.array_equal(corrected.thresholds, one.thresholds)
    assert len(both.episodes) > len(corrected.episodes) == len(one.episodes)


def test_fit_replaces_a_checkpoint_only_when_asked(
    dataset: Path, other: Path, imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    shutil.copytree(imitator, tmp_path / "copy")
    message = refusal(capsys, "fit", other, "--out", tmp_path / "copy")
    assert "expected a folder without a checkpoint" in message
    assert f"--from {tmp_path / 'copy'}" in message
    assert "--overwrite" in message
    message = refusal(capsys, "fit", other, "--out", tmp_path / "copy", "--from", imitator)
    assert "expected a folder without a checkpoint" in message
    assert run("fit", other, "--out", tmp_path / "copy", "--from", f"{tmp_path}/copy/") == 0
    assert_equal(Imitator.from_pretrained(tmp_path / "copy"), taught(dataset, other))
    assert run("fit", other, "--out", tmp_path / "copy", "--overwrite") == 0
    assert_equal(Imitator.from_pretrained(tmp_path / "copy"), taught(other))


def test_fit_takes_features_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    names = dict(zip(("observation.hand", "observation.cup", "aim"), NAMES.values(), strict=True))
    root = record(tmp_path / "renamed", ("drink", "wave"), 1002, names=names)
    assert "expected the feature 'observation.state'" in refusal(
        capsys, "fit", root, "--out", tmp_path / "out"
    )
    options = ("--state", "observation.hand", "--action", "aim")
    cup = ("--environment-state", "observation.cup")
    assert run("fit", root, *options, *cup, "--out", tmp_path / "out") == 0
    config = Imitator.from_pretrained(tmp_path / "out").config
    assert config.percepts == {"observation.hand": ("x", "y"), "observation.cup": ("z",)}
    assert config.action == ("right", "up")
    assert run("fit", root, *options, "--out", tmp_path / "blind") == 0
    assert list(Imitator.from_pretrained(tmp_path / "blind").config.percepts) == [
        "observation.hand"
    ]


def test_fit_can_leave_the_environment_state_out(dataset: Path, tmp_path: Path):
    assert run("fit", dataset, "--environment-state", "none", "--out", tmp_path) == 0
    assert Imitator.from_pretrained(tmp_path).percept_names == ("x", "y")
    assert run("fit", dataset, "--from", tmp_path, "--out", tmp_path) == 0  # knows what it takes
    assert len(Imitator.from_pretrained(tmp_path).reports) == 12


def test_fit_can_aim_at_states(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run("fit", dataset, "--targets", "state", "--lead", 3, "--out", tmp_path) == 0
    config = Imitator.from_pretrained(tmp_path).config
    assert (config.targets, config.lead) == ("state", 3)
    out, error = capsys.readouterr()
    assert value_of("targets", out).endswith(" states")
    # From each frame to the next within 6 episodes of 80: what takes its time is announced.
    assert unannounced(error) == "fitting the forward model to 474 transitions ...\n"
    assert run("fit", dataset, "--from", tmp_path, "--out", tmp_path) == 0
    assert unannounced(capsys.readouterr().err) == ""  # it stays what it is
    assert run("info", tmp_path) == 0
    assert "states of 2 dimensions, 3 frames ahead" in capsys.readouterr().out


def test_fit_says_when_no_targets_were_stored(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    root = record(tmp_path / "short", ("drink",), 1003, frames=4)
    assert run("fit", root, "--out", tmp_path / "out") == 0
    out, error = capsys.readouterr()
    assert value_of("targets", out) == "0 actions"
    assert error.startswith("note: no targets were stored")
    assert error.count("\n") == 1
    assert "expected a network that has learned schemas" in refusal(
        capsys, "watch", tmp_path / "out", root
    )


# info


def test_info_prints_what_was_learned(
    dataset: Path, imitator: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("info", imitator) == 0
    out = capsys.readouterr().out
    known = taught(dataset)
    assert "Imitator" in value_of("checkpoint", out)
    assert value_of("percept", out) == "3 dimensions at 20 frames per second"
    assert value_of("action", out) == "right, up"
    assert value_of("behaviours", out) == "drink, wave"
    assert int(value_of("nodes", out)) == len(known.network.sofm)
    scale = known.network.sofm.scale.tolist()
    assert rows_under("feature", out)[:3] == [
        [feature, name, f"{factor:.4g}"]
        for feature, name, factor in zip(
            (STATE, STATE, SURROUNDINGS), ("x", "y", "z"), scale, strict=True
        )
    ]
    assert [row[:3] for row in rows_under("dataset", out)] == [
        ["shown", str(number), task] for number, task in enumerate(("drink", "wave") * 3)
    ]


def test_info_as_json_has_the_same(
    dataset: Path, imitator: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("info", imitator, "--json") == 0
    document = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    known = taught(dataset)
    assert document["kind"] == "Imitator"
    assert document["behaviours"] == ["drink", "wave"]
    assert document["action"] == ["right", "up"]
    assert (document["fps"], document["targets_are"], document["lead"]) == (20, "action", None)
    assert document["nodes"] == len(known.network.sofm)
    assert document["targets"] == int(known.network.schemas.lengths.sum())
    assert list(document["percept"][STATE]) == ["x", "y"]
    assert document["percept"][SURROUNDINGS]["z"] == float(known.network.sofm.scale[2])
    assert [report["episode"] for report in document["reports"]] == list(range(6))
    assert document["reports"][0]["max_novelty"] is None
    assert document["bytes"] == sum(file.stat().st_size for file in imitator.iterdir())
    first = np.mean([shown.action[0].numpy() for shown in load_demonstrations(dataset)], axis=0)
    assert document["first_action"] == pytest.approx(first, rel=1e-5)


def test_commands_find_the_imitator_of_a_policy(
    imitator: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    shutil.copytree(imitator, tmp_path / "policy" / "imitator")
    (tmp_path / "policy" / "config.json").write_text('{"type": "pacnet"}')
    (tmp_path / "policy" / "model.safetensors").write_bytes(b"of the policy")
    assert run("info", tmp_path / "policy") == 0
    assert "Imitator" in value_of("checkpoint", capsys.readouterr().out)
    assert run("watch", tmp_path / "policy", dataset) == 0


@pytest.mark.parametrize("name", sorted(path.name for path in (PROJECT / "checkpoints").iterdir()))
def test_info_describes_every_shipped_checkpoint(name: str, capsys: pytest.CaptureFixture[str]):
    folder = PROJECT / "checkpoints" / name
    fields = json.loads((folder / "config.json").read_text())["config"]
    assert run("info", folder, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["kind"] == fields.get("model", "PACNet")
    tensors = load_file(folder / "model.safetensors")
    if document["kind"] == "PACNet":
        assert document["nodes"] == len(tensors["sofm.nodes.prototype"])
        assert document["targets"] == len(tensors["schemas.pool.target"])
    else:
        assert document["numbers"] == sum(tensor.numel() for tensor in tensors.values())
    assert run("info", folder) == 0
    assert document["kind"] in value_of("checkpoint", capsys.readouterr().out)


# watch


def test_watch_prints_what_it_recognises_in_each_episode(
    imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("watch", imitator, other, "--out", tmp_path / "pictures") == 0
    out, error = capsys.readouterr()
    assert unannounced(error) == ""
    rows = rows_under("episode", out)
    assert [row[:3] for row in rows[:2]] == [["0", "wave", "wave"], ["1", "drink", "drink"]]
    assert rows[2][:3] == ["2", "juggle", "new"]
    known = Imitator.from_pretrained(imitator)
    for row, shown in zip(rows, load_demonstrations(other), strict=True):
        known.reset()
        steps = [known.step(percept) for percept in shown.percepts]
        novelty = [step.novelty for step in steps]
        most = int(np.argmax(novelty))
        held = [step for step in steps if step.action is None]
        new = [step for step in held if step.is_novel]
        assert len(new) > len(held) / 2 or not held
        assert row[5:] == [
            f"{np.mean([step.is_novel for step in steps]):.1%}",
            f"{novelty[most]:.2f}",
            steps[most].dimension,
            f"{most / 20:.2f} s",
            f"{np.mean([step.action is not None for step in steps]):.1%}",
            "novel percept" if held else "–",
        ]
        known.reset()
        named = known.network.recognise(shown.percepts)
        if steps[-1].is_novel:
            assert row[2:5] == ["new", "–", "–"]
            continue
        behaviour = int(named.behaviour[-1])
        assert row[2] == ("drink", "wave")[behaviour]
        assert row[3] == f"{float(named.probability[-1, behaviour]):.1%}"
        since = round(float(row[4].removesuffix(" s")) * 20)
        assert (named.behaviour[since:] == behaviour).all()
        assert since == 0 or named.behaviour[since - 1] != behaviour
    assert float(rows[2][5].removesuffix("%")) > 50  # juggling is new for most of the time
    assert rows[2][7] == "y"
    pictures = sorted(path.name for path in (tmp_path / "pictures").iterdir())
    assert pictures == ["episode_000.png", "episode_001.png", "episode_002.png"]
    assert value_of("pictures", out) == str(tmp_path / "pictures")


def test_watch_draws_its_output(
    imitator: Path, other: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    figures, save = [], Figure.savefig

    def saved(self: Figure, file: Path) -> None:
        save(self, file)
        figures.append(self)

    monkeypatch.setattr(Figure, "savefig", saved)
    assert run("watch", imitator, other, "--out", tmp_path) == 0
    known, shown = Imitator.from_pretrained(imitator), load_demonstrations(other)
    for number, (figure, episode) in enumerate(zip(figures, shown, strict=True)):
        title = f"Episode {number}, recorded as “{episode.task}”"
        assert figure.get_suptitle() == title
        known.reset()
        steps = [known.step(percept) for percept in episode.percepts]
        curve, threshold, *_ = figure.axes[2].lines
        np.testing.assert_allclose(curve.get_xdata(), np.arange(80) / 20)
        np.testing.assert_allclose(curve.get_ydata(), [step.novelty for step in steps], rtol=1e-6)
        assert set(threshold.get_ydata()) == {1}  # where the imitator begins to hold
        assert figure.axes[2].get_xlim() == (0, 4)
        band = figure.axes[2].collections[-1].get_paths()
        for frame, step in enumerate(steps):
            middle = ((frame + 0.5) / 20, 0.05)
            assert any(part.contains_point(middle) for part in band) == (step.action is None)
        pixels = imread(tmp_path / f"episode_{number:03}.png")[..., :3]
        inked = (np.abs(pixels - to_rgb(BLUE)) < 0.01).all(axis=2).mean()  # drinking is the first
        assert inked > 0.01


def test_watch_prints_why_it_holds_where_nothing_is_novel(
    imitator: Path, other: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    step = Imitator.step

    def unsure(self: Imitator, percept: np.ndarray) -> ImitatorStep:
        """Of 80 frames, it holds for one reason at 31 and for another at 29."""
        done = step(self, percept)
        frame = next(frames) % 80
        if frame < 31:
            decision = done.decision._replace(is_novel=False, target=None)
        elif frame < 60:
            decision = done.decision._replace(is_novel=True, target=None)
        else:
            return done._replace(is_novel=False, action=np.zeros(2, np.float32))
        return done._replace(is_novel=False, action=None, decision=decision)

    frames = itertools.count()
    monkeypatch.setattr(Imitator, "step", unsure)
    assert run("watch", imitator, other) == 0
    rows = rows_under("episode", capsys.readouterr().out)
    assert [row[-2:] for row in rows] == [["25.0%", "no confident schema"]] * 3


def test_tasks_that_the_font_lacks_are_drawn_without_a_warning(tmp_path: Path):
    root = record(tmp_path / "shown", ("\N{CJK UNIFIED IDEOGRAPH-65E5}", "drink"), 1009)
    assert run("fit", root, "--out", tmp_path / "taught") == 0
    assert run("watch", tmp_path / "taught", root, "--out", tmp_path / "pictures") == 0
    assert len(list((tmp_path / "pictures").iterdir())) == 2


TASK = "Pick up the {} cube and place it carefully into the {} box on the far side of the table"


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (["drink", "a\nb\tc", 40 * "d"], ["drink", "a b c", 40 * "d"]),
        ([20 * "a" + 10 * "-" + 20 * "b"], [20 * "a" + "…" + 19 * "b"]),
        (
            [TASK.format("red", "left"), TASK.format("red", "right"), TASK.format("red", "left")],
            [
                "Pick up the red cube and place it…left…",
                "Pick up the red cube and place it…right…",
                "Pick up the red cube and place it…left…",
            ],
        ),
        ([f"{30 * 'a'}{number}{30 * 'b'}" for number in (1, 2)],) * 2,  # not one word to cut at
    ],
)
def test_names_in_tables_are_short_and_distinct(
    names: list[str], shown: list[str], capsys: pytest.CaptureFixture[str]
):
    print_table(("<name",), [(name,) for name in names])
    assert capsys.readouterr().out.splitlines() == ["name", *shown]


def test_watch_needs_no_action_in_the_dataset(imitator: Path, tmp_path: Path):
    names = {STATE: NAMES[STATE], SURROUNDINGS: NAMES[SURROUNDINGS], "wish": NAMES[ACTION]}
    root = record(tmp_path / "watched", ("drink",), 1004, names=names)
    assert run("watch", imitator, root) == 0


def rerun_tables(file: Path) -> dict[str, str]:
    """Path of each entity in a Rerun file -> its table, as Rerun prints it.

    Rerun's functions for reading are others in each version; its own printed tables are not.
    """
    command = [sys.executable, "-m", "rerun", "rrd", "print", "-vvv", file]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    chunks = re.split(
        r"^Chunk\(\w+\) with \d+ rows .*? - (/(?:\\.|\S)+) - ", printed, flags=re.MULTILINE
    )
    return dict(zip(chunks[1::2], chunks[2::2], strict=True))


def test_watch_writes_a_rerun_recording(imitator: Path, other: Path, tmp_path: Path):
    pytest.importorskip("rerun")
    assert run("watch", imitator, other, "--rerun", tmp_path / "seen.rrd") == 0
    tables = rerun_tables(tmp_path / "seen.rrd")
    curves = {
        path: re.findall(r"┆ P(?:T([\d.]+)S|0D) +┆ \[(\S+)\] ", table)
        for path, table in tables.items()
        if path.startswith("/episode_")
    }
    episodes = list(replay(Imitator.from_pretrained(imitator), load_demonstrations(other)))
    expected = {
        f"/episode_{number:03}/{name}": values
        for number, one in enumerate(episodes)
        for name, values in (
            ("novelty", one.watched.recognition.novelty),
            ("progress", one.watched.recognition.progress),
            ("winner", one.watched.recognition.winner),
            ("probability/drink", one.watched.recognition.probability[:, 0]),
            ("probability/wave", one.watched.recognition.probability[:, 1]),
        )
    }
    assert curves.keys() == expected.keys()
    for path, values in expected.items():
        times, printed_values = zip(*curves[path], strict=True)
        assert [float(time or 0) for time in times] == pytest.approx(np.arange(80) / 20)
        assert [float(value) for value in printed_values] == pytest.approx(values.tolist())


def test_a_task_is_one_name_in_the_rerun_recording(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    pytest.importorskip("rerun")
    root = record(tmp_path / "shown", ("pick/place it",), 1008)
    assert run("fit", root, "--out", tmp_path / "taught") == 0
    capfd.readouterr()
    assert run("watch", tmp_path / "taught", root, "--rerun", tmp_path / "seen.rrd") == 0
    assert unannounced(capfd.readouterr().err) == ""  # where Rerun's own code would warn
    (path,) = [path for path in rerun_tables(tmp_path / "seen.rrd") if "probability" in path]
    assert path == r"/episode_000/probability/pick\/place\ it"


def test_watch_says_what_is_missing_for_rerun(
    imitator: Path,
    other: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setitem(sys.modules, "rerun", None)
    message = refusal(capsys, "watch", imitator, other, "--rerun", tmp_path / "seen.rrd")
    assert "pip install 'pacnet[rerun]'" in message


# export


def test_export_adds_the_imitators_output_as_columns(
    imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("export", imitator, other, "--out", tmp_path / "copy") == 0
    columns = "behaviour, progress, novelty, is_novel, winner, expected_next, expected_end"
    assert value_of("new columns", capsys.readouterr().out) == columns
    known = Imitator.from_pretrained(imitator)
    info = json.loads((tmp_path / "copy" / "meta" / "info.json").read_text())
    assert info["features"]["behaviour"]["names"] == ["drink", "wave"]
    assert info["features"]["expected_end"]["names"] == ["x", "y", "z"]
    table = pq.read_table(tmp_path / "copy" / "data" / "chunk-000" / "file-000.parquet")
    copies = load_demonstrations(tmp_path / "copy")
    for number, (copy, shown) in enumerate(zip(copies, load_demonstrations(other), strict=True)):
        rows = slice(80 * number, 80 * (number + 1))
        column = {name: table[name].to_pylist()[rows] for name in info["features"]}
        assert torch.equal(copy.percepts, shown.percepts)
        assert torch.equal(copy.action, shown.action)
        known.reset()
        steps = [known.step(percept) for percept in shown.percepts]
        known.reset()
        named = known.network.recognise(shown.percepts)
        assert column["is_novel"] == [step.is_novel for step in steps]
        assert column["winner"] == named.winner.tolist()
        expected = {
            "novelty": [step.novelty for step in steps],
            "behaviour": named.probability,
            "progress": named.progress,
            "expected_next": named.next_percept,
            "expected_end": named.end_percept,
        }
        for name, values in expected.items():
            np.testing.assert_allclose(column[name], values, rtol=1e-5, atol=1e-6)


def test_export_refuses_before_it_runs(
    imitator: Path,
    other: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr("pacnet.cli.replay.replay", lambda *_: pytest.fail("it watched"))
    message = refusal(capsys, "export", imitator, other, "--out", other)
    assert "expected a new folder for the copy" in message
    twice = tmp_path / "twice"
    shutil.copytree(other, twice)
    edit_info(twice, lambda info: info["features"].update(novelty=info["features"][ACTION]))
    message = refusal(capsys, "export", imitator, twice, "--out", tmp_path / "copy")
    assert "novelty" in message
    assert not (tmp_path / "copy").exists()


# explain


def explained(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    capsys.readouterr()
    assert run("explain", *arguments, "--json") == 0
    return json.loads(capsys.readouterr().out, parse_constant=pytest.fail)


def test_explain_names_the_frame_and_demonstration_of_the_target(
    imitator: Path, dataset: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    watched = load_demonstrations(other).episodes[1]
    known = Imitator.from_pretrained(imitator)
    for percept in watched.percepts[:61]:
        step = known.step(percept)
    assert document["decision"] == "acts"
    assert list(document["action"]) == ["right", "up"]
    assert document["action"] == document["target"]
    np.testing.assert_array_equal(np.float32(list(document["action"].values())), step.action)
    assert (document["novelty"], document["dimension"]) == (step.novelty, step.dimension)
    assert (document["winner"], document["schema"]) == (step.decision.winner, step.decision.schema)
    # The action itself stands in the dataset, at the frame it is said to come from.
    origin, *others = document["origins"]
    assert (origin["dataset"], origin["task"]) == ("shown", "drink")
    shown = load_demonstrations(dataset)
    source = shown.episodes[origin["episode"]]
    assert source.task == "drink"
    np.testing.assert_array_equal(source.action[origin["frame"]], step.action)
    assert origin["seconds"] == origin["frame"] / 20
    near = source.percepts[origin["frame"]] - watched.percepts[60]
    assert float(near.abs().max()) < 0.1
    # It stands for about the same place in the other drinks.
    assert {row["episode"] for row in document["origins"]} == {0, 2, 4}
    for row in others:
        apart = shown.episodes[row["episode"]].percepts[row["frame"]] - watched.percepts[60]
        assert float(apart.abs().max()) < 0.5


def test_explain_converts_each_frame_with_its_own_rate(imitator: Path, other: Path):
    faster = replace(load_demonstrations(other), fps=40)
    document = explain(Imitator.from_pretrained(imitator), faster, 1, 60)
    assert document["seconds"] == 60 / 40
    assert document["origins"]
    assert all(row["seconds"] == row["frame"] / 20 for row in document["origins"])


def test_explain_ranks_schemas_and_nodes(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 0, "--frame", 60)
    confidences = [row["confidence"] for row in document["schemas"]]
    assert confidences == sorted(confidences, reverse=True)
    (won,) = [row for row in document["schemas"] if row["schema"] == document["schema"]]
    assert won["behaviours"] == ["wave"]
    assert won["confidence"] > confidences[0] - 0.1  # who has won is given up only by a margin
    sofm = Imitator.from_pretrained(imitator).network.sofm
    percept = load_demonstrations(other).episodes[0].percepts[60]
    apart = np.linalg.norm((sofm.prototypes - percept) * sofm.scale, axis=1)
    nearest = np.argsort(apart)[:5]
    assert [row["node"] for row in document["nodes"]] == nearest.tolist()
    np.testing.assert_allclose([row["distance"] for row in document["nodes"]], apart[nearest], 1e-5)
    np.testing.assert_allclose(
        [row["activation"] for row in document["nodes"]], np.exp(-apart[nearest]), 1e-5
    )
    assert document["winner"] == nearest[0]
    assert document["activation"] == pytest.approx(np.exp(-apart.min()), 1e-5)


def test_explain_says_why_the_most_confident_schema_did_not_win(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 0, "--frame", 60)
    print_explanation(document)
    assert "loses only to" not in capsys.readouterr().out
    challenger = {**document["schemas"][0], "schema": 99, "confidence": 0.99}
    print_explanation({**document, "schemas": [challenger, *document["schemas"]]})
    assert "loses only to a schema that is more confident by 10.0%" in capsys.readouterr().out


def test_explain_says_why_it_holds(imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]):
    document = explained(capsys, imitator, other, "--episode", 2, "--frame", 79)
    assert (document["decision"], document["is_novel"], document["action"]) == ("holds", True, None)
    assert document["reason"] == "the percept is novel in y"
    assert run("explain", imitator, other, "--episode", 2, "--frame", 79) == 0
    out = capsys.readouterr().out
    assert value_of("decision", out) == "holds: the percept is novel in y"
    assert "(below 0.55, no match)" in value_of("winner", out)


KNOWN = Decision(
    target=np.zeros(2),
    has_target=True,
    winner=7,
    activation=0.9,
    is_novel=False,
    offset=0,
    schema=3,
)


@pytest.mark.parametrize(
    ("decision", "changes", "sentence"),
    [
        (KNOWN, {}, "the percept is known and a motor schema is confident"),
        (KNOWN, {"is_novel": True, "action": None}, "the percept is novel in elbow"),
        (
            KNOWN._replace(target=None, is_novel=True),
            {"is_novel": True, "action": None},
            "the percept is novel in elbow",  # which says more than that nothing matches
        ),
        (
            KNOWN._replace(target=None, is_novel=True),
            {"action": None},
            "no node of the map matches the percept",
        ),
        (
            KNOWN._replace(target=None),
            {"action": None},
            "no motor schema of node 7 or near the percept is confident",
        ),
        (KNOWN, {"action": None}, "the forward model finds no action that leads to the target"),
    ],
)
def test_every_decision_has_a_reason(decision: Decision, changes: dict[str, Any], sentence: str):
    step = ImitatorStep(np.zeros(2), False, 0.5, "elbow", 0.1, 0.2, decision)
    assert reason_of(step._replace(**changes)).sentence == sentence


def test_explain_prints_the_deviation_and_its_threshold(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 2, "--frame", 79)
    known = Imitator.from_pretrained(imitator)
    for percept in load_demonstrations(other).episodes[2].percepts:
        step = known.step(percept)
    assert (document["deviation"], document["threshold"]) == (step.deviation, step.threshold)
    print_explanation({**document, "novelty": 6.0, "deviation": -1.5, "threshold": 0.25})
    novelty = value_of("novelty", capsys.readouterr().out)
    assert novelty == "6.00 (novel above 1), largest in y: deviation -1.5, threshold 0.25"


def test_explain_says_that_an_action_is_not_sent(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    print_explanation(document)
    assert "\naction\n" in capsys.readouterr().out
    print_explanation({**document, "decision": "holds", "action": None})  # as for novel percepts
    out = capsys.readouterr().out
    assert "\naction, not sent\n" in out
    assert rows_under("name", out)[0] == ["right", f"{document['target']['right']:.4g}"]


def test_explain_prints_the_content_of_its_json(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    document = explained(capsys, imitator, other, "--episode", 1, "--frame", 60)
    assert run("explain", imitator, other, "--episode", 1, "--frame", 60) == 0
    out = capsys.readouterr().out
    assert value_of("frame", out) == "60 (3.00 s) of episode 1 of others, “drink”"
    assert value_of("decision", out) == "acts: the percept is known and a motor schema is confident"
    length = document["schemas"][0]["targets"]
    schema = f"{document['schema']}, target {document['position'] + 1} of {length}"
    assert re.search(rf"^schema {{2,}}{schema}$", out, re.MULTILINE)
    assert "loses only to" not in out
    assert rows_under("name", out)[:2] == [
        [name, f"{value:.4g}"] for name, value in document["action"].items()
    ]
    assert rows_under("dataset", out)[: len(document["origins"])] == [
        ["shown", f"{row['episode']}", "drink", f"{row['frame']}", f"{row['seconds']:.2f} s"]
        for row in document["origins"]
    ]
    (won,) = [row for row in rows_under("schema +node", out) if row[0] == f"* {document['schema']}"]
    assert won[1] == str(document["winner"])
    assert won[2] == f"{document['schemas'][0]['confidence']:.1%}"
    assert f"\nmotor schemas of node {document['winner']}; * won\n" in out
    elsewhere = {**document["schemas"][0], "node": document["winner"] + 1}
    print_explanation({**document, "schemas": [elsewhere]})
    assert "and those of other nodes near the percept; * won\n" in capsys.readouterr().out
    assert [row[0].removeprefix("* ") for row in rows_under("node", out)][:2] == [
        str(row["node"]) for row in document["nodes"][:2]
    ]


def test_explain_separates_a_state_target_from_the_action(
    dataset: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("fit", dataset, "--targets", "state", "--out", tmp_path) == 0
    document = explained(capsys, tmp_path, other, "--episode", 1, "--frame", 60)
    assert list(document["target"]) == ["x", "y"]
    origin = document["origins"][0]
    source = load_demonstrations(dataset).episodes[origin["episode"]]
    np.testing.assert_array_equal(
        np.float32(list(document["target"].values())), source.state[origin["frame"] + 1]
    )
    assert document["action"] is None or list(document["action"]) == ["right", "up"]
    assert run("explain", tmp_path, other, "--episode", 1, "--frame", 60) == 0
    now = load_demonstrations(other).episodes[1].state[60, 0]
    rows = rows_under("name", capsys.readouterr().out)
    assert rows[0] == ["x", f"{float(now):.4g}", f"{document['target']['x']:.4g}"]


def test_explain_names_the_valid_episodes_and_frames(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    message = refusal(capsys, "explain", imitator, other, "--episode", 3, "--frame", 0)
    assert "expected an episode of others, 0 to 2, got 3" in message
    message = refusal(capsys, "explain", imitator, other, "--episode", 1, "--frame", 80)
    assert "expected a frame of episode 1, 0 to 79, got 80" in message


# what is refused


def edit_info(root: Path, change) -> None:
    path = root / "meta" / "info.json"
    info = json.loads(path.read_text())
    change(info)
    path.write_text(json.dumps(info))


COMMANDS = {
    "fit": "fit {dataset} --out {out}",
    "fit --from": "fit {dataset} --from {checkpoint} --out {out}",
    "info": "info {checkpoint}",
    "watch": "watch {checkpoint} {dataset} --out {out}",
    "export": "export {checkpoint} {dataset} --out {out}",
    "explain": "explain {checkpoint} {dataset} --episode 0 --frame 0",
}


def command_line(command: str, checkpoint: Path, dataset: Path, out: Path) -> list[str]:
    line = COMMANDS[command].split()
    return [word.format(checkpoint=checkpoint, dataset=dataset, out=out) for word in line]


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "info"])
def test_a_dataset_that_cannot_be_read_is_one_line(
    command: str, imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "out"

    def message(dataset: Path) -> str:
        return refusal(capsys, *command_line(command, imitator, dataset, out))

    assert "expected the folder of a LeRobot dataset" in message(tmp_path / "nowhere")
    assert "no LeRobot dataset: it has no meta/info.json" in message(tmp_path)
    old = tmp_path / "old"
    shutil.copytree(other, old)
    edit_info(old, lambda info: info.update(codebase_version="v2.1"))
    assert "expected codebase_version v3.0, found v2.1" in message(old)
    eye = tmp_path / "eye"
    shutil.copytree(other, eye)
    picture = {"dtype": "video", "shape": [3, 4, 4], "names": None}
    edit_info(eye, lambda info: info["features"].update({STATE: picture}))
    assert re.search(f"{STATE}.*video", message(eye))
    assert not out.exists()


@pytest.mark.parametrize("command", ["fit --from", "watch", "export", "explain"])
def test_a_dataset_of_something_else_is_one_line(
    command: str, imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    names = {**NAMES, STATE: ("x", "elbow")}
    root = record(tmp_path / "else", ("drink",), 1005, names=names)
    message = refusal(capsys, *command_line(command, imitator, root, tmp_path / "out"))
    assert "expected 'observation.state' with the dimensions" in message
    assert "x, elbow" in message
    blind = {STATE: NAMES[STATE], "cup": NAMES[SURROUNDINGS], ACTION: NAMES[ACTION]}
    root = record(tmp_path / "blind", ("drink",), 1005, names=blind)
    message = refusal(capsys, *command_line(command, imitator, root, tmp_path / "out"))
    assert "observation.environment_state" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "fit"])
def test_no_checkpoint_is_one_line(
    command: str, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    def message(checkpoint: Path) -> str:
        return refusal(capsys, *command_line(command, checkpoint, other, tmp_path / "out"))

    assert "expected a checkpoint folder" in message(tmp_path / "nowhere")
    assert "expected a checkpoint folder" in message(other)
    (tmp_path / "model.safetensors").write_bytes(b"nothing")
    assert "expected a whole safetensors file" in message(tmp_path)
    if command != "info":
        network = PROJECT / "checkpoints" / "behaviours"
        assert "expected the checkpoint of an Imitator" in message(network)
        assert "got that of a PACNet" in message(network)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["fit --from", "watch", "export", "explain"])
def test_a_dataset_of_another_rate_is_one_line(
    command: str, imitator: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    root = record(tmp_path / "fast", ("drink",), 1006, fps=30)
    message = refusal(capsys, *command_line(command, imitator, root, tmp_path / "out"))
    assert "expected 20 frames per second" in message
    assert "got 30" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["fit", "watch"])
def test_a_file_where_a_folder_is_to_be_is_one_line(
    command: str, imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "out").touch()
    message = refusal(capsys, *command_line(command, imitator, other, tmp_path / "out"))
    assert f"expected --out as a folder, '{tmp_path / 'out'}' is a file" in message


def test_a_folder_where_a_file_is_to_be_is_one_line(
    imitator: Path, other: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("rerun")
    message = refusal(capsys, "watch", imitator, other, "--rerun", tmp_path)
    assert f"expected --rerun as a file, '{tmp_path}' is a folder" in message


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            "explain in data --episode -1 --frame 0",
            "--episode: expected a whole number ≥ 0, got '-1'",
        ),
        ("explain in data --episode 0 --frame x", "--frame: expected a whole number ≥ 0, got 'x'"),
        (
            "fit data --out out --targets state --lead 0",
            "--lead: expected a whole number ≥ 1, got '0'",
        ),
        ("fit '' --out out", "DATASET: expected the name of a file or folder, got an empty one"),
        ("fit data --out ''", "--out: expected the name of a file or folder, got an empty one"),
        ("watch in data --out ''", "--out: expected the name of a file or folder"),
        ("export in data --out ''", "--out: expected the name of a file or folder"),
    ],
)
def test_wrong_usage_is_explained(
    arguments: str, expected: str, capsys: pytest.CaptureFixture[str]
):
    assert run(*shlex.split(arguments)) == 2
    assert expected in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("learn",),
        ("fit", "data"),
        ("fit", "data", "--out", "out", "--lead", "2"),
        ("fit", "data", "--out", "out", "--targets", "action", "--lead", "2"),
        ("fit", "data", "--out", "out", "--targets", "state", "--lead", "0"),
        ("fit", "data", "--out", "out", "--from", "in", "--targets", "state"),
        ("fit", "data", "--out", "out", "--from", "in", "--lead", "2"),
        ("fit", "data", "--out", "out", "--corrections"),
        ("explain", "in", "data", "--episode", "-1", "--frame", "0"),
        ("explain", "in", "data", "--episode", "0"),
        ("watch", "in"),
    ],
)
def test_wrong_usage_exits_with_2(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]):
    assert run(*arguments) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("usage: pacnet")


@pytest.mark.parametrize("command", ["fit", "watch", "export"])
def test_progress_bars_run_from_nothing_to_the_end(
    command: str, imitator: Path, other: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    bars = []

    class Watched(tqdm):
        """As on a terminal; notes where it stands each time."""

        def __init__(self, **named: Any) -> None:
            super().__init__(**{**named, "disable": False, "file": io.StringIO()})
            self.stood = [self.n]
            bars.append(self)

        def update(self, n: float | None = 1) -> bool | None:
            moved = super().update(n)
            self.stood.append(self.n)
            return moved

    monkeypatch.setattr("tqdm.tqdm", Watched)
    assert run(*command_line(command, imitator, other, tmp_path / "out")) == 0
    stood = {bar.desc: bar.stood for bar in bars}
    expected = {
        "fit": {"learning": [0, 80, 160, 240]},
        "watch": {
            "watching": [0, 50, 80, 130, 160, 210, 240],
            "drawing": [0, 1, 2, 3],
        },
        "export": {"watching": [0, 50, 80, 130, 160, 210, 240]},
    }
    assert stood == expected[command]
    assert [bar.total for bar in bars] == [bar.stood[-1] for bar in bars]


# the process


@pytest.fixture
def restored_threads() -> Iterator[None]:
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)


@pytest.mark.usefixtures("restored_threads")
@pytest.mark.parametrize("command", ["fit", "watch", "export", "explain"])
def test_it_takes_no_more_than_one_thread(
    command: str, imitator: Path, other: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    threads = []
    method = "update" if command == "fit" else "step_on"
    work = getattr(PACNet, method)

    def counting(self: PACNet, *given: Any, **named: Any) -> Any:
        threads.append(torch.get_num_threads())
        return work(self, *given, **named)

    monkeypatch.setattr(PACNet, method, counting)
    torch.set_num_threads(2)
    assert run(*command_line(command, imitator, other, tmp_path / "out")) == 0
    assert set(threads) == {1}


def process(*arguments: object, code: str = "") -> subprocess.CompletedProcess[str]:
    """A process of its own; `code` runs before the command."""
    start = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    end = f"from pacnet.cli import main; raise SystemExit(main({list(map(str, arguments))}))"
    command = [sys.executable, "-c", f"{start}{code}\n{end}"]
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, timeout=1800
    )


INTERRUPT = "import os; os.kill(os.getpid(), signal.SIGINT)"


def test_ctrl_c_while_it_learns_leaves_nothing(dataset: Path, tmp_path: Path):
    code = f"""
from pacnet.imitator.imitator import Imitator
learn = Imitator.learn
def interrupt(_):
    {INTERRUPT}
Imitator.learn = lambda self, shown, _, **options: learn(self, shown, interrupt, **options)
"""
    done = process("fit", dataset, "--out", tmp_path / "out", code=code)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_ctrl_c_while_it_writes_waits_until_the_checkpoint_is_whole(
    dataset: Path, imitator: Path, tmp_path: Path
):
    code = f"""
from pacnet.core import checkpoint
write = checkpoint.open_synced
def interrupted(path):
    {INTERRUPT}
    return write(path)
checkpoint.open_synced = interrupted
"""
    done = process("fit", dataset, "--out", tmp_path / "out", code=code)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")
    written = {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()}
    assert written == {file.name: file.read_bytes() for file in imitator.iterdir()}


def test_help_lists_every_command():
    done = subprocess.run(
        [sys.executable, "-m", "pacnet", "--help"],
        cwd=PROJECT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for command in ("fit", "info", "watch", "export", "explain"):
        assert re.search(rf"^ +{command} +\w", done.stdout, re.MULTILINE)
    assert "pacnet fit recordings/drinking --out imitator" in done.stdout


@pytest.mark.parametrize("command", ["fit", "info", "watch", "export", "explain"])
def test_help_of_a_command_ends_with_an_example(command: str, capsys: pytest.CaptureFixture[str]):
    assert run(command, "--help") == 0
    out = capsys.readouterr().out
    assert re.search(rf"\nexample:\n  pacnet {command} \S", out)
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.slow
def test_a_closed_pipe_gives_no_traceback(imitator: Path):
    command = f"{sys.executable} -m pacnet info {imitator} | true"
    done = subprocess.run(
        ["bash", "-c", command], cwd=PROJECT, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""


@pytest.mark.slow
def test_thirty_thousand_frames_are_what_python_learns(tmp_path: Path):
    from pacnet.datasets.recorder import Recorder

    rng = np.random.default_rng(1007)
    names = {
        STATE: [f"joint {number}" for number in range(22)],
        SURROUNDINGS: [f"glass {number}" for number in range(6)],
        ACTION: [f"motor {number}" for number in range(11)],
    }
    mix = rng.standard_normal((4, 28))
    with Recorder(tmp_path / "data", 50, names) as recorder:
        for number in range(30):
            time = np.linspace(0, 6, 1000)[:, None]
            bend = (1 - 2 * (number % 2)) * np.clip(time - 2, 0, None)
            moves = np.hstack([np.sin(time), np.cos(1.4 * time), bend, time / 3])
            path = moves @ mix + 0.01 * rng.standard_normal((1000, 28))
            episode = (path[:, :22], path[:, 22:], np.roll(path, -1, axis=0)[:, :11])
            recorder.save_episode(
                ("drink", "wave")[number % 2], dict(zip(names, episode, strict=True))
            )
    done = process("fit", tmp_path / "data", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert value_of("learned", done.stdout).startswith("30 episodes, 30,000 frames in ")
    assert_equal(Imitator.from_pretrained(tmp_path / "out"), taught(tmp_path / "data"))

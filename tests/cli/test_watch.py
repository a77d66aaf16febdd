"""`pacnet watch` prints and draws what the imitator recognises."""

import itertools
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import (
    ACTION,
    NAMES,
    STATE,
    SURROUNDINGS,
    record,
    refusal,
    rows_under,
    run,
    unannounced,
    value_of,
)
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread

from pacnet.cli.replay import replay
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.evaluation.figure_style import BLUE
from pacnet.imitator import Imitator, ImitatorStep


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
            "–" if steps[-1].is_novel else f"{steps[-1].progress:.1%}",
        ]
        named = known.recognise(shown.percepts)
        if steps[-1].is_novel:
            assert row[2:5] == ["new", "–", "–"]
            continue
        behaviour = int(named.behaviour[-1])
        assert row[2] == ("drink", "wave")[behaviour]
        assert row[3] == f"{float(named.probability[-1, behaviour]):.1%}"
        since = round(float(row[4].removesuffix(" s")) * 20)
        assert (named.behaviour[since:] == behaviour).all()
        assert since == 0 or named.behaviour[since - 1] != behaviour
    assert float(rows[2][5].removesuffix("%")) > 40  # juggling is new once it bends
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

    def unsure(self: Imitator, percept: np.ndarray, _: object) -> ImitatorStep:
        """Of 80 frames, it holds for one reason at 31 and for another at 29."""
        done = step(self, percept)
        frame = next(frames) % 80
        action = None if frame < 60 else np.zeros(2, np.float32)
        return done._replace(is_novel=31 <= frame < 60, action=action)

    frames = itertools.count()
    monkeypatch.setattr(Imitator, "step", unsure)
    assert run("watch", imitator, other) == 0
    rows = rows_under("episode", capsys.readouterr().out)
    assert [row[-3:-1] for row in rows] == [["25.0%", "no action found"]] * 3


def test_watch_follows_only_the_task_asked_for(
    imitator: Path, other: Path, capsys: pytest.CaptureFixture[str]
):
    assert run("watch", imitator, other, "--task", "drink") == 0
    waving, drinking, _ = rows_under("episode", capsys.readouterr().out)
    assert (waving[2], waving[-2]) == ("new", "novel percept")  # as it is for drinking
    assert drinking[2:4] == ["drink", "100.0%"]
    known = Imitator.from_pretrained(imitator)
    for row, shown in zip((waving, drinking), load_demonstrations(other), strict=False):
        known.reset("drink")
        steps = [known.step(percept) for percept in shown.percepts]
        assert row[5] == f"{np.mean([step.is_novel for step in steps]):.1%}"
        assert row[6] == f"{max(step.novelty for step in steps):.2f}"


def test_tasks_that_the_font_lacks_are_drawn_without_a_warning(tmp_path: Path):
    root = record(tmp_path / "shown", ("\N{CJK UNIFIED IDEOGRAPH-65E5}", "drink"), 1009)
    assert run("fit", root, "--out", tmp_path / "trained") == 0
    assert run("watch", tmp_path / "trained", root, "--out", tmp_path / "pictures") == 0
    assert len(list((tmp_path / "pictures").iterdir())) == 2


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
            ("novelty", one.recognized.recognition.novelty),
            ("progress", one.recognized.recognition.progress),
            ("winner", one.recognized.recognition.winner),
            ("probability/drink", one.recognized.recognition.probability[:, 0]),
            ("probability/wave", one.recognized.recognition.probability[:, 1]),
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
    assert run("fit", root, "--out", tmp_path / "trained") == 0
    capfd.readouterr()
    assert run("watch", tmp_path / "trained", root, "--rerun", tmp_path / "seen.rrd") == 0
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

"""`pacnet export` adds what the imitator recognises as columns."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from command_line import ACTION, edit_info, refusal, run, value_of

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator import Imitator


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
        named = known.recognise(shown.percepts)
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


def test_export_follows_only_the_task_asked_for(imitator: Path, other: Path, tmp_path: Path):
    assert run("export", imitator, other, "--task", "drink", "--out", tmp_path / "copy") == 0
    table = pq.read_table(tmp_path / "copy" / "data" / "chunk-000" / "file-000.parquet")
    known, (waving, *_) = Imitator.from_pretrained(imitator), load_demonstrations(other)
    known.reset("drink")
    steps = [known.step(percept) for percept in waving.percepts]
    novelty = table["novelty"].to_pylist()[:80]
    np.testing.assert_allclose(novelty, [step.novelty for step in steps], rtol=1e-6)
    assert max(novelty) > 1
    behaviour = np.array(table["behaviour"].to_pylist()[:80])
    np.testing.assert_allclose(behaviour, known.recognise(waving.percepts).probability, rtol=1e-6)
    assert behaviour[-1, 1] > 0.9  # it is seen to wave all the same


def test_export_leaves_videos_out_on_request(imitator: Path, other: Path, tmp_path: Path):
    filmed = tmp_path / "filmed"
    shutil.copytree(other, filmed)
    camera = {"dtype": "video", "shape": [4, 4, 3], "names": None}
    edit_info(filmed, lambda info: info["features"].update({"observation.images.top": camera}))
    command = ("export", imitator, filmed, "--out", tmp_path / "copy", "--no-videos")
    assert run(*command) == 0  # without a warning about the video that is not there
    info = json.loads((tmp_path / "copy" / "meta" / "info.json").read_text())
    assert "observation.images.top" not in info["features"]


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

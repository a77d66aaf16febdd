"""Independent checkers find nothing wrong with the datasets that the scripts write."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from checkers import assert_clean

from pacnet.cli import main
from train import behaviours, schema_network
from train.common.expected_findings import expect_findings
from train.postural import learning
from train.postural.babbling import recording
from train.postural.retraining.replicates import Replicate, record
from train.postural.seeing import watching

SEED = 11
DRAWN = Replicate(SEED, (None, "tremor", None, "miss", None, None, None, "interrupted", None, None))

RECORDED: dict[str, Callable[[Path], object]] = {
    "postural_imitation": lambda folder: learning.record(folder, SEED, 8),
    "demonstrate": lambda folder: learning.record(folder, SEED, 8, "move", "move it"),
    "demonstrate --camera": lambda folder: watching.record(folder, SEED, 2),
    "behaviours": lambda folder: behaviours.record(folder, SEED, 4),
    "schema_network": lambda folder: schema_network.demonstrate(SEED, folder),
    "retraining": lambda folder: record(DRAWN, folder),
    "babbling": lambda folder: recording.record(folder, SEED, 300),
}


@pytest.mark.slow
@pytest.mark.parametrize("script", RECORDED)
def test_checkers_find_nothing_wrong(tmp_path: Path, script: str):
    RECORDED[script](tmp_path / "dataset")
    # Findings that are expected still cost points: postures at random have no path.
    assert_clean(tmp_path / "dataset", 90 if script == "babbling" else 95)


@pytest.mark.slow
def test_checkers_find_nothing_wrong_with_annotations(tmp_path: Path):
    learning.record(tmp_path / "dataset", SEED, 4)
    imitator, annotated = tmp_path / "imitator", tmp_path / "annotated"
    assert main(["fit", str(tmp_path / "dataset"), "--out", str(imitator)]) == 0
    assert main(["export", str(imitator), str(tmp_path / "dataset"), "--out", str(annotated)]) == 0
    assert_clean(annotated)


def test_expected_findings_are_declared_with_a_reason(tmp_path: Path):
    (tmp_path / "meta").mkdir()
    expect_findings(tmp_path, "episodes.*", "spoiled on purpose", [1, 7])
    (declared,) = json.loads((tmp_path / "meta/rdq_expected.yaml").read_text())
    assert declared == {
        "checks": ["episodes.*"],
        "episodes": [1, 7],
        "reason": "spoiled on purpose",
    }

    expect_findings(tmp_path, "episodes.spikes*", "the walls have edges")
    (declared,) = json.loads((tmp_path / "meta/rdq_expected.yaml").read_text())
    assert "episodes" not in declared

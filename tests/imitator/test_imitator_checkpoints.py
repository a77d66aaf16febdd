"""Checkpoints of an imitator: one that is loaded is the same, and a damaged one is refused."""

from __future__ import annotations

import json
import math
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
import torch
from reaching import assert_same, follow, reach, shown

from pacnet import MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.imitator import EpisodeReport, Imitator


def test_a_loaded_imitator_acts_and_learns_like_the_saved_one(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path / "checkpoint")
    loaded = Imitator.from_pretrained(tmp_path / "checkpoint")
    assert loaded.reports == trained.reports
    assert isinstance(loaded.reports[0], EpisodeReport)
    assert loaded.config == trained.config
    percepts = torch.cat([reach(100).percepts[:150], reach(101, glass=0.2).percepts[:20]])
    for ours, theirs in zip(follow(trained, percepts), follow(loaded, percepts), strict=True):
        assert (ours.action is None) == (theirs.action is None)
        assert ours.action is None or np.array_equal(ours.action, theirs.action)
        assert (ours.novelty, ours.dimension) == (theirs.novelty, theirs.dimension)
    for imitator in (trained := deepcopy(trained), loaded):
        imitator.learn(shown(reach(6, glass=0.3)))
    assert_same(trained, loaded)


def test_other_checkpoints_are_refused(tmp_path: Path):
    PACNet(PACNetConfig(SOFMConfig.paper(3), MotorSchemasConfig(2, 3))).save_pretrained(tmp_path)
    with pytest.raises(ValueError, match="expected a checkpoint of Imitator"):
        Imitator.from_pretrained(tmp_path)


def test_a_checkpoint_of_version_0_1_is_refused_with_what_to_do(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    old = {"network": {}, "lessons": fields.pop("reports")}
    write_checkpoint(tmp_path, {**fields, **old}, tensors)
    with pytest.raises(ValueError, match=r"got one of version 0.1.*learn its demonstrations again"):
        Imitator.from_pretrained(tmp_path)


def test_a_checkpoint_with_a_field_too_many_is_refused(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, {**fields, "speed": 3}, tensors)
    with pytest.raises(ValueError, match=r"expected the fields of ImitatorConfig.*speed"):
        Imitator.from_pretrained(tmp_path)


def test_a_checkpoint_without_a_tensor_is_refused(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    del tensors["first_action"]
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match=r"expected the tensors of an Imitator.*first_action"):
        Imitator.from_pretrained(tmp_path)


def test_the_config_is_json(trained: Imitator, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())["config"]
    assert config["percepts"]["observation.state"] == ["shoulder", "elbow"]
    assert config["scaling"]["scale"] == list(trained.config.scaling.scale)
    assert config["budget"] is None


@pytest.mark.parametrize(
    ("tensor", "value", "named"),
    [
        *(("novelty_detector.thresholds", value, "thresholds") for value in (math.nan, math.inf)),
        *(("novelty_detector.thresholds", value, "thresholds") for value in (-1.0, 0.0)),
        *(("memory.demonstrations.task", value, "tasks") for value in (1, -1, 2**40)),
    ],
)
def test_a_checkpoint_with_impossible_thresholds_or_other_tasks_is_refused(
    trained: Imitator, tensor: str, value: float, named: str, tmp_path: Path
):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    tensors[tensor][0] = value
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match=named):
        Imitator.from_pretrained(tmp_path)


@pytest.mark.parametrize("reports", [None, "all", [{"dataset": "reaching"}], [], [3]])
def test_a_checkpoint_with_other_reports_is_refused(
    trained: Imitator, reports: object, tmp_path: Path
):
    trained.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    write_checkpoint(tmp_path, {**fields, "reports": reports}, tensors)
    with pytest.raises(ValueError, match="report"):
        Imitator.from_pretrained(tmp_path)

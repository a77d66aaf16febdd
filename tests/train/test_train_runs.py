"""Run folders, metrics files and arguments of the training scripts."""

import argparse
import json

import pytest

from pacnet import MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from train.common.runs import (
    command_line,
    factor,
    load_or_exit,
    make_parser,
    make_run_folder,
    natural,
    positive,
    threshold,
    write_metrics,
)


def test_two_runs_in_the_same_second_have_different_folders(tmp_path):
    folders = {make_run_folder("drink", seed=3, runs=tmp_path) for _ in range(4)}
    assert len(folders) == 4
    assert all(folder.is_dir() and "-seed3" in folder.name for folder in folders)
    assert {folder.parent for folder in folders} == {tmp_path / "drink"}


def test_the_command_parses_to_the_same_arguments():
    parser = make_parser("train.recall", "text", episodes=20)
    parser.add_argument("checkpoint")
    parser.add_argument("--pace", type=factor, default=1.0)
    given = parser.parse_args(["some/folder", "--seed", "7", "--pace", "1.25"])
    command = command_line("train.recall", given)
    assert command.startswith("python -m train.recall some/folder ")
    assert parser.parse_args(command.split()[3:]) == given


def test_metrics_carry_command_seed_and_versions(tmp_path):
    write_metrics(tmp_path / "metrics.json", "python -m train.x", 5, {"task_success_rate": 1.0})
    document = json.loads((tmp_path / "metrics.json").read_text())
    assert document["command"] == "python -m train.x"
    assert document["seed"] == 5
    assert document["task_success_rate"] == 1.0
    assert {"python", "torch", "mujoco", "pacnet"} <= set(document["versions"])


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (natural, "-1"),
        (natural, "1.5"),
        (positive, "0"),
        (factor, "0"),
        (factor, "50"),
        (factor, "nan"),
        (factor, "inf"),
        (threshold, "1"),
        (threshold, "x"),
    ],
)
def test_an_argument_out_of_range_is_named(kind, text):
    with pytest.raises(argparse.ArgumentTypeError, match=f"expected .*got '{text}'"):
        kind(text)


def test_a_missing_checkpoint_ends_the_script_with_one_line(tmp_path):
    with pytest.raises(SystemExit, match=r"^error: expected a checkpoint folder[^\n]*$"):
        load_or_exit(tmp_path / "nowhere", 2, 1)


def test_a_checkpoint_of_other_dimensions_ends_the_script_with_one_line(tmp_path):
    PACNet(PACNetConfig(SOFMConfig.paper(2), MotorSchemasConfig(1, 2))).save_pretrained(tmp_path)
    assert load_or_exit(tmp_path, 2, 1).config.attention.dimensions == 2
    with pytest.raises(SystemExit, match=r"^error: expected .* 28 percept and 11 .*got 2 and 1"):
        load_or_exit(tmp_path, 28, 11)


def test_a_file_in_the_place_of_the_runs_ends_the_script_with_one_line(tmp_path):
    (tmp_path / "runs").write_text("")
    with pytest.raises(SystemExit, match=r"^error: expected a folder for runs[^\n]*$"):
        make_run_folder("drink", seed=3, runs=tmp_path / "runs")

"""Claims about the features that become states, environment states and actions."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
from handmade import columns, write, write_info, write_rows

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning, MissingFeature

STATE, SURROUNDINGS = "observation.state", "observation.environment_state"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return write(tmp_path / "shown")


def rename(root: Path, names: dict[str, str]) -> None:
    """Call features otherwise, in the description and in the data."""
    frames = columns()
    features = json.loads((root / "meta/info.json").read_text())["features"]
    for old, new in names.items():
        frames[new] = frames.pop(old)
        features[new] = features.pop(old)
    write_info(root, features=features)
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")


def test_all_that_is_missing_is_said_at_once_with_what_is_there_and_how_to_choose(root: Path):
    rename(root, {STATE: "state", "action": "actions", SURROUNDINGS: "observation.ee_pose"})

    message = (
        r"the features 'observation.state' and 'action', the dataset has the vectors "
        r"'state' \[3\], 'actions' \[1\], 'observation.ee_pose' \[2\]: "
        r"choose with --state NAME and --action NAME \(state=NAME, action=NAME in Python\)"
    )
    with pytest.raises(MissingFeature, match=message):
        load_demonstrations(root)

    shown = load_demonstrations(root, state="state", action="actions").episodes[0]
    np.testing.assert_array_equal(shown.state, columns()[STATE][:4])
    np.testing.assert_array_equal(shown.action, columns()["action"][:4])


def test_several_features_stand_side_by_side_in_the_order_given(root: Path):
    demonstrations = load_demonstrations(root, state=[SURROUNDINGS, STATE])
    shown = demonstrations.episodes[0]

    np.testing.assert_array_equal(shown.state[:, :2], columns()[SURROUNDINGS][:4])
    np.testing.assert_array_equal(shown.state[:, 2:], columns()[STATE][:4])
    assert shown.environment_state.shape == (4, 0)  # the default one is part of the state
    assert demonstrations.state_features == (SURROUNDINGS, STATE)
    assert [*demonstrations.percept_features] == [SURROUNDINGS, STATE]


def test_several_actions_and_environment_states(root: Path):
    demonstrations = load_demonstrations(
        root, environment_state=["action", SURROUNDINGS], action=[STATE, SURROUNDINGS]
    )
    shown = demonstrations.episodes[2]
    assert (shown.environment_state.shape, shown.action.shape) == ((3, 3), (3, 5))
    assert demonstrations.action_features == (STATE, SURROUNDINGS)
    assert demonstrations.action_names[:2] == ("observation.state_0", "observation.state_1")


@pytest.mark.parametrize(
    "choice",
    [
        {"state": None},
        {"state": ()},
        {"state": SURROUNDINGS},
        {"state": None, "environment_state": [SURROUNDINGS]},
    ],
)
def test_the_environment_state_alone(root: Path, choice: dict[str, object]):
    demonstrations = load_demonstrations(root, **choice)
    assert demonstrations.percept_features.keys() == {SURROUNDINGS}
    percepts = demonstrations.episodes[0].percepts
    np.testing.assert_array_equal(percepts, columns()[SURROUNDINGS][:4])


def test_a_dataset_without_a_robots_state_has_its_surroundings(root: Path):
    rename(root, {STATE: "joints"})
    with pytest.warns(DatasetWarning, match="no 'observation.state': percepts are obs.* alone"):
        demonstrations = load_demonstrations(root)
    assert demonstrations.state_features == ()
    assert demonstrations.percept_features.keys() == {SURROUNDINGS}


@pytest.mark.parametrize("missing", [STATE, SURROUNDINGS])
def test_defaults_that_are_declared_and_not_there_are_left_out(root: Path, missing: str):
    frames = columns()
    del frames[missing]
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DatasetWarning)
        percepts = load_demonstrations(root).percept_features
    assert percepts.keys() == {STATE, SURROUNDINGS} - {missing}


def test_actions_may_be_left_out(root: Path):
    demonstrations = load_demonstrations(root, action=None)
    assert demonstrations.episodes[0].action.shape == (4, 0)
    assert demonstrations.action_names == ()
    assert torch.equal(
        demonstrations.episodes[0].percepts, load_demonstrations(root).episodes[0].percepts
    )


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"state": [STATE, STATE]}, "different features, got observation.state, observation.state"),
        ({"environment_state": STATE}, "different features"),
        ({"action": ["action", "action"]}, "different features"),
        (
            {"state": None, "environment_state": None},
            "expected a state, an env",
        ),
    ],
)
def test_choices_that_contradict_themselves(root: Path, choice: dict[str, object], message: str):
    with pytest.raises(ValueError, match=message):
        load_demonstrations(root, **choice)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ([["a", "b", "c"]], ("a", "b", "c")),
        ([["a"], ["b", "c"]], ("a", "b", "c")),
        ({"arm": ["a", "b"], "hand": ["c"]}, ("a", "b", "c")),
        ({"motors": [["a", "b"], "c"]}, ("a", "b", "c")),
        ({"b": 1, "a": 0, "c": 2}, ("a", "b", "c")),
        (["grip", "x", "grip"], ("grip.0", "x.1", "grip.2")),
        ([["a", "b"]], ("0", "1", "2")),
        ([[[[[["a", "b", "c"]]]]]], ("0", "1", "2")),
        ("abc", ("0", "1", "2")),
        ({}, ("0", "1", "2")),
    ],
)
def test_names_of_dimensions_may_be_nested(root: Path, names: object, expected: tuple[str, ...]):
    features = json.loads((root / "meta/info.json").read_text())["features"]
    features[STATE]["names"] = names
    write_info(root, features=features)
    assert load_demonstrations(root).names[STATE] == expected


# Frames by who acted


def with_column(root: Path, values: np.ndarray, dtype: str = "bool") -> None:
    frames = columns() | {"intervention": values}
    features = json.loads((root / "meta/info.json").read_text())["features"]
    write_info(root, features=features | {"intervention": {"dtype": dtype, "shape": [1]}})
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")


def test_only_frames_where_a_column_is_true_are_read_and_each_run_is_a_demonstration(root: Path):
    with_column(root, np.array([1, 0, 1, 1, 0, 0, 0, 1], dtype=bool))
    demonstrations = load_demonstrations(root, only_where="intervention")

    runs = [(shown.episode, shown.first_frame, len(shown.state)) for shown in demonstrations]
    assert runs == [(0, 0, 1), (0, 2, 2), (2, 2, 1)]
    np.testing.assert_array_equal(demonstrations.episodes[1].state, columns()[STATE][2:4])
    assert "intervention" not in demonstrations.names


def test_numbers_0_and_1_say_it_too_and_no_other(root: Path):
    with_column(root, np.array([1, 0, 1, 1, 0, 0, 0, 1.0]), "float32")
    assert len(load_demonstrations(root, only_where="intervention")) == 3
    with_column(root, np.array([1, 0, 2, 1, 0, 0, 0, 1.0]), "float32")
    with pytest.raises(DatasetError, match="'intervention' to be true or false in each frame"):
        load_demonstrations(root, only_where="intervention")


def test_a_column_that_is_never_true(root: Path):
    with_column(root, np.zeros(8, dtype=bool))
    with pytest.raises(DatasetError, match="expected frames where 'intervention' is true"):
        load_demonstrations(root, only_where="intervention")


def test_a_column_that_is_not_there(root: Path):
    with pytest.raises(MissingFeature, match=r"'success', .*: choose with --only-where NAME"):
        load_demonstrations(root, only_where="success")


def test_only_frames_that_are_asked_for_must_be_finite(root: Path):
    frames = columns()
    frames[STATE][1] = np.nan
    frames["intervention"] = np.arange(8) > 1
    write_rows(root, frames, list(range(8)), "chunk-000/file-000.parquet")
    assert len(load_demonstrations(root, only_where="intervention")) == 3
    with pytest.raises(DatasetError, match="episode 0, frame 1, dimension"):
        load_demonstrations(root)

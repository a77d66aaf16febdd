"""The memory of demonstrations: whole sequences, boxes around them, snapshots, loading."""

from copy import deepcopy

import numpy as np
import pytest
import torch

from pacnet.core.drafts import BufferVersions, snapshot_of
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator import Imitator
from pacnet.schemas.demonstration_memory import DemonstrationMemory, Shown

LENGTHS = (70, 1, 32, 33, 200)


def rows(count: int, width: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((count, width)).astype(np.float32)


def append(memory: DemonstrationMemory, frames: int, seed: int, task: int = 0) -> None:
    memory.append(rows(frames, 3, seed), rows(frames, 3, -seed + 100), rows(frames, 2, seed), task,
                  correction=False)  # fmt: skip


def filled(*lengths: int) -> DemonstrationMemory:
    memory = DemonstrationMemory(3, 2)
    for seed, frames in enumerate(lengths):
        append(memory, frames, seed, task=seed % 2)
    return memory


def assert_equal(one: Shown, other: Shown) -> None:
    for name, value, same in zip(Shown._fields, one, other, strict=True):
        np.testing.assert_array_equal(value, same, err_msg=name)


def copied(shown: Shown) -> Shown:
    return Shown(*(array.copy() for array in shown))


def test_every_row_is_where_it_was_shown():
    shown = filled(*LENGTHS).shown()
    assert shown.first.tolist() == [0, 70, 71, 103, 136, 336]
    assert shown.frames.tolist() == [*LENGTHS]
    assert shown.task.tolist() == [0, 1, 0, 1, 0]
    for seed, frames in enumerate(LENGTHS):
        part = slice(shown.first[seed], shown.first[seed + 1])
        np.testing.assert_array_equal(shown.percepts[part], rows(frames, 3, seed))
        np.testing.assert_array_equal(shown.targets[part], rows(frames, 2, seed))
        assert shown.time[part].tolist() == [*range(frames)]


def test_the_pace_is_the_mean_step():
    memory = DemonstrationMemory(2, 1)
    path = np.float32([[0, 0], [3, 4], [3, 4], [3, 5]])  # steps of 5, 0 and 1
    memory.append(path, path, path[:, :1], 0, correction=False)
    memory.append(path[:1], path[:1], path[:1, :1], 0, correction=False)
    assert memory.shown().pace == pytest.approx([2.0, 0.0])


@pytest.mark.parametrize("loaded", [False, True])
def test_boxes_contain_their_rows_and_no_others(loaded: bool):
    memory = filled(*LENGTHS)
    if loaded:  # boxes are then made for all at once
        state, memory = memory.state_dict(), DemonstrationMemory(3, 2)
        memory.load_state_dict(state)
    shown = memory.shown()
    assert_equal(shown, filled(*LENGTHS).shown())
    assert shown.box_of.tolist() == [0, 3, 4, 5, 7, 14]  # of up to 32 frames each
    assert shown.box_first[shown.box_of].tolist() == shown.first.tolist()
    for box in range(shown.box_of[-1]):
        inside = shown.percepts[shown.box_first[box] : shown.box_first[box + 1]]
        np.testing.assert_array_equal(shown.low[box], inside.min(axis=0))
        np.testing.assert_array_equal(shown.high[box], inside.max(axis=0))


def test_what_was_taken_before_is_unchanged_by_more():
    memory = filled(*LENGTHS)
    taken, snapshot = memory.shown(), snapshot_of(memory)
    before = copied(taken)
    for seed in range(5, 12):  # beyond the capacity too
        append(memory, 90, seed)
    assert_equal(taken, before)
    assert_equal(snapshot.shown(), before)
    assert len(memory.shown().frames) == 12


def test_a_draft_that_is_appended_to_leaves_the_original_as_it_is_known():
    """A thread that reads the original would take the change of shared memory for one of it."""
    memory = filled(*LENGTHS)
    append(memory, 1, 5)  # beyond which there is capacity now
    known, versions = memory.shown(), BufferVersions(memory)
    append(snapshot_of(memory), 20, 6)
    assert versions.unchanged()
    assert memory.shown() is known


def test_what_was_taken_before_is_unchanged_by_forgetting():
    memory = filled(*LENGTHS)
    taken, snapshot = memory.shown(), snapshot_of(memory)
    before = copied(taken)
    memory.select(np.arange(len(taken.percepts)) % 3 == 0)
    append(memory, 50, 9)
    assert_equal(taken, before)
    assert_equal(snapshot.shown(), before)


def test_a_demonstration_that_is_forgotten_keeps_its_place():
    memory = filled(4, 3, 2)
    memory.select(np.array([1, 0, 0, 1, 0, 0, 0, 1, 0], bool))
    shown = memory.shown()
    assert shown.first.tolist() == [0, 2, 2, 3]
    assert shown.time.tolist() == [0, 3, 0]
    assert shown.frames.tolist() == [4, 3, 2]
    np.testing.assert_array_equal(shown.percepts[1], rows(4, 3, 0)[3])
    append(memory, 5, 7)
    assert memory.shown().first.tolist() == [0, 2, 2, 3, 8]
    memory.check_state(memory.state_dict())


def test_arguments_are_copied():
    memory, given = DemonstrationMemory(3, 2), rows(5, 3, 0)
    memory.append(given, given, given[:, :2], 0, correction=True)
    given[:] = 9
    np.testing.assert_array_equal(memory.shown().percepts, rows(5, 3, 0))
    assert memory.demonstrations.live("correction").tolist() == [1]


@pytest.mark.parametrize(
    ("name", "where", "value", "message"),
    [
        ("demonstrations.rows", 0, 69, "as many rows as demonstrations have"),
        ("demonstrations.rows", 0, -1, "as many rows as demonstrations have"),
        ("demonstrations.frames", 0, 3, "as many rows as demonstrations have"),
        ("rows.time", 5, 4, "frames in order of time"),
        ("rows.time", 69, 70, "frames of their demonstrations"),
        ("rows.time", 0, -1, "frames of their demonstrations"),
        ("demonstrations.task", 1, -1, "tasks ≥ 0"),
        ("demonstrations.correction", 1, 2, "corrections or none"),
        ("demonstrations.pace", 1, -1.0, "a pace ≥ 0"),
        ("demonstrations.pace", 1, np.inf, "a pace ≥ 0"),
        ("rows.percept", 7, np.nan, "bounded percepts"),
        ("rows.change", 7, 1e30, "bounded changes"),
        ("rows.target", 7, np.inf, "finite targets"),
    ],
)
def test_a_state_that_contradicts_itself_is_refused(name, where, value, message):
    memory = filled(*LENGTHS)
    state = {key: tensor.clone() for key, tensor in memory.state_dict().items()}
    state[name][where] = value
    before = deepcopy(memory.state_dict())
    with pytest.raises(ValueError, match=message):
        memory.load_state_dict(state)
    assert all(torch.equal(tensor, before[key]) for key, tensor in memory.state_dict().items())


def test_what_was_changed_from_outside_is_noticed():
    memory = filled(*LENGTHS)
    memory.shown()
    memory.rows.live("percept")[3] = 7
    assert (memory.shown().percepts[3] == 7).all()
    assert (memory.shown().high[0] == 7).all()
    memory.demonstrations.rows[0] = 69
    with pytest.raises(ValueError, match="as many rows as demonstrations have"):
        memory.shown()


@pytest.mark.parametrize("kind", ["places", "efforts"])
def test_every_frame_of_a_demonstration_is_found_again(kind: str):
    """Shown its percepts, an imitator gives its targets."""
    phase = torch.linspace(0, 1, 150)[:, None]
    state = torch.cat([phase, (6 * phase).sin(), (11 * phase).cos()], dim=1)
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(150, 3, generator=generator)
    action = state + 0.05 * noise if kind == "places" else 10 * noise
    names = {"observation.state": ("a", "b", "c"), "action": ("u", "v", "w")}
    one = Demonstration(0, "go", state, torch.empty(150, 0), action)
    demonstrations = Demonstrations(50, names, (one,), "one")
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    assert imitator.config.follows == ((0, 1, 2) if kind == "places" else (-1, -1, -1))
    steps = [imitator.step(percept) for percept in state]
    np.testing.assert_allclose([step.action for step in steps], action, atol=1e-5)
    assert [step.followed[0].frame for step in steps] == [*range(150)]
    assert max(step.novelty for step in steps) == 0

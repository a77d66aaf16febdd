"""Old names: attributes, config fields and tensors work under them, and say what they are now."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import pytest
import torch
from torch import Tensor, nn

from pacnet.core.checkpoint import rebuild_config
from pacnet.core.old_names import old_arguments, old_names, rename_on_load, with_new_names

NEW_BY_OLD = {"room": "capacity", "told": "spec"}


@old_names(room="capacity")
@dataclass(frozen=True)
class Config:
    """A config, one of whose fields was renamed."""

    capacity: int
    margin: float = 0.5


@old_arguments(place="offset")
@old_names(place="offset")
class Record(NamedTuple):
    """A record, whose field was renamed."""

    offset: int


@old_names(room="capacity")
class Child(nn.Module):
    """A module, whose tensor was renamed."""

    capacity: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("capacity", torch.zeros(2))
        rename_on_load(self, NEW_BY_OLD)


class Parent(nn.Module):
    """Only a child's tensor was renamed, and the child's own name."""

    def __init__(self) -> None:
        super().__init__()
        self.spec = Child()
        rename_on_load(self, NEW_BY_OLD)


@pytest.mark.parametrize(
    ("owner", "old", "value"), [(Config(3), "room", 3), (Record(4), "place", 4)]
)
def test_an_old_attribute_gives_the_new_one_with_a_warning(owner: object, old: str, value: int):
    with pytest.warns(DeprecationWarning, match=f"{old} is now") as warned:
        assert getattr(owner, old) == value
    assert warned[0].filename == __file__


def test_an_old_attribute_of_a_module_gives_the_tensor_itself():
    child = Child()
    with pytest.warns(DeprecationWarning, match="room is now capacity"):
        assert child.room is child.capacity
    assert list(child.state_dict()) == ["capacity"]


def test_an_old_field_sets_the_new_one_with_a_warning():
    with pytest.warns(DeprecationWarning, match="room is now capacity") as warned:
        config = Config(room=3, margin=0.25)
    assert config == Config(3, 0.25)
    assert warned[0].filename == __file__
    with pytest.warns(DeprecationWarning, match="room is now capacity"):
        assert replace(config, room=5) == Config(5, 0.25)
    with pytest.warns(DeprecationWarning, match="place is now offset") as warned:
        assert Record(place=3) == Record(3) == Record(offset=3)
    assert warned[0].filename == __file__


def test_new_names_do_not_warn_and_unknown_ones_are_refused():
    assert asdict(Config(capacity=3)) == {"capacity": 3, "margin": 0.5}
    with pytest.raises(TypeError, match="rooms"):
        Config(rooms=3)


def test_fields_that_were_read_are_renamed_without_a_warning():
    assert with_new_names(Config, {"room": 3, "other": 1}) == {"capacity": 3, "other": 1}
    assert with_new_names(dict, {"room": 3}) == {"room": 3}
    assert rebuild_config(Config, {"room": 3}) == Config(3)


@pytest.mark.parametrize(
    "copied", [lambda m: m, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))]
)
def test_tensors_load_under_old_and_new_names_also_into_copies(
    copied: Callable[[nn.Module], nn.Module],
):
    parent = copied(Parent())
    for number, name in enumerate(("told.room", "told.capacity", "spec.room", "spec.capacity")):
        parent.load_state_dict({name: torch.full((2,), float(number))})
        assert parent.spec.capacity.tolist() == [number] * 2
    parent.spec.load_state_dict({"room": torch.ones(2)})
    assert parent.spec.capacity.tolist() == [1, 1]


def test_only_whole_parts_of_names_are_renamed_and_only_under_the_prefix():
    parent = nn.Module()
    parent.a = Parent()
    loaded = {name: torch.ones(2) for name in ("a.told.room", "a.rooms", "b.room")}
    report = parent.load_state_dict(loaded, strict=False)
    assert report.missing_keys == []
    assert set(report.unexpected_keys) == {"a.rooms", "b.room"}


def test_loading_does_not_rename_the_callers_own_tensors():
    state = {"told.room": torch.ones(2)}
    Parent().load_state_dict(state)
    assert list(state) == ["told.room"]


def test_a_forward_model_keeps_names_that_are_old_ones_elsewhere():
    imitator = nn.Module()
    imitator.network = nn.Module()
    imitator.network.forward_model = nn.Module()
    imitator.network.forward_model.familiarity = nn.Linear(1, 1)
    imitator.network.forward_model.register_buffer("usual", torch.zeros(1))
    imitator.novelty_detector = nn.BatchNorm1d(1)
    rename_on_load(imitator, {"familiarity": "novelty_detector", "usual": "running_mean"})
    loaded = {name: torch.ones_like(value) for name, value in imitator.state_dict().items()}
    loaded["familiarity.usual"] = loaded.pop("novelty_detector.running_mean")
    imitator.load_state_dict(loaded)
    for name, value in imitator.state_dict().items():
        assert torch.equal(value, torch.ones_like(value)), name

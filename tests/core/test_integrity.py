"""What is loaded is checked, as a whole, before anything is copied."""

from __future__ import annotations

import copy
from collections.abc import Mapping

import pytest
import torch
from torch import Tensor, nn

from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.core.integrity import check_conditions, check_on_load, check_structure


class Part(nn.Module):
    """A counter that is never negative, and rows."""

    count: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("count", torch.tensor(0))
        self.rows = GrowableRows({"point": Column((2,), torch.float32)})
        self.checks = 0
        check_on_load(self)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Count the checks."""
        self.checks += 1
        check_structure(self, tensors)
        check_conditions({"a count ≥ 0": tensors["count"] >= 0})


class Whole(Part):
    """A part with two others."""

    def __init__(self) -> None:
        super().__init__()
        self.one, self.other = Part(), Part()


def state_of(module: nn.Module, count: int) -> dict[str, Tensor]:
    return {
        name: torch.ones(count, 2) if name.endswith("point") else torch.tensor(count)
        for name in module.state_dict()
    }


def checks(*wholes: Whole) -> list[int]:
    return [part.checks for whole in wholes for part in (whole, whole.one, whole.other)]


def test_each_load_checks_each_module():
    whole = Whole()
    for load in (1, 2):
        whole.load_state_dict(state_of(whole, load))
        assert min(checks(whole)) >= load
        assert len(whole.other.rows) == load


def test_a_module_is_checked_when_it_is_loaded_by_itself_or_within_one_that_checks_nothing():
    one, other = Whole(), Whole()
    one.one.load_state_dict(state_of(one.one, 3))
    assert checks(one) == [0, 1, 0]
    both = nn.Sequential(one, other)
    both.load_state_dict(state_of(both, 4))
    assert min(checks(one, other)) >= 1


@pytest.mark.parametrize("name", ["count", "one.count", "other.count"])
def test_a_refused_load_changes_nothing_and_the_next_one_is_checked_again(name: str):
    whole = Whole()
    for _ in range(2):
        with pytest.raises(ValueError, match="expected a count ≥ 0"):
            whole.load_state_dict({**state_of(whole, 5), name: torch.tensor(-1)})
        assert int(whole.count) == int(whole.one.count) == len(whole.rows) == 0
    copied = copy.deepcopy(whole)
    with pytest.raises(ValueError, match="expected a count ≥ 0"):
        copied.load_state_dict({**state_of(whole, 5), name: torch.tensor(-1)})


STRUCTURES = {
    "a missing tensor": ({"one.count": None}, r"Part, got \['count'\] missing, none extra"),
    "an extra one": ({"one.more": torch.ones(1)}, r"Part, got none missing, \['more'\] extra"),
    "another shape": ({"count": torch.ones(2, dtype=torch.int64)}, r"count of Whole .*got .*\[2\]"),
    "another type": ({"count": torch.tensor(1.0)}, "count of Whole as integers"),
    "no memory": ({"one.count": torch.tensor(1, device="meta")}, "count of Part"),
    "a float type of few digits": (
        {"rows.point": torch.ones(1, 2).to(torch.float8_e4m3fn)}, "rows.point of Whole as float",
    ),
    "two float types": ({"one.rows.point": torch.ones(1, 2).double()}, "of one type in Whole"),
}  # fmt: skip


@pytest.mark.parametrize("case", STRUCTURES)
def test_tensors_of_another_structure_are_refused_and_named(case: str):
    changes, message = STRUCTURES[case]
    whole = Whole()
    state = {n: t for n, t in {**state_of(whole, 1), **changes}.items() if t is not None}
    with pytest.raises(ValueError, match=message):
        whole.load_state_dict(state, strict=False)
    assert int(whole.count) == 0

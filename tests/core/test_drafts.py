"""Drafts: what is learned on one replaces a module's state at once; snapshots keep theirs."""

from __future__ import annotations

import copy
import pickle
import sys
from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from pacnet.core.drafts import (
    BufferVersions,
    Lock,
    adopt,
    draft_of,
    short_switch_interval,
    snapshot_of,
)
from pacnet.core.growable_rows import Column, GrowableRows


class Module(nn.Module):
    """A buffer, a parameter, rows and a cache."""

    total: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("total", torch.tensor(0))
        self.weight = nn.Parameter(torch.ones(1))
        self.rows = GrowableRows({"point": Column((2,), torch.float32, transposed=True)})
        self.names: tuple[str, ...] = ()
        self._cache: object = None

    def learn(self, name: str) -> None:
        """Change everything that is learned."""
        self.total += 1
        self.rows.append({"point": torch.full((2,), float(self.total))})
        self.names = (*self.names, name)
        self._cache = name


def known(module: Module) -> tuple[object, ...]:
    return int(module.total), module.rows.live("point").tolist(), module.names


@pytest.fixture(params=[0, 1, 200])
def module(request: pytest.FixtureRequest) -> Module:
    module = Module()
    for number in range(request.param):
        module.learn(str(number))
    return module


def test_a_draft_learns_apart_and_is_adopted_as_a_whole(module: Module):
    before, rows, weight = known(module), module.rows, module.weight
    draft = draft_of(module)
    assert known(draft) == before
    assert draft.weight is weight
    assert draft._cache is None
    draft.learn("more")
    assert known(module) == before
    module.eval()
    adopt(module, draft)
    assert known(module) == known(draft) != before
    assert module.rows is rows
    assert module._cache is None
    assert not module.training
    module.learn("after")
    assert module.rows.live("point")[-1].tolist() == [int(module.total)] * 2


def test_a_snapshot_shares_tensors_and_keeps_them(module: Module):
    snapshot, before = snapshot_of(module), known(module)
    assert snapshot.total is module.total
    assert snapshot.rows.point.data_ptr() == module.rows.point.data_ptr()
    draft = draft_of(module)
    draft.learn("more")
    adopt(module, draft)
    assert known(snapshot) == before


def test_a_draft_of_a_module_whose_memory_is_gone_is_refused(module: Module):
    module.total.untyped_storage().resize_(0)
    with pytest.raises(ValueError, match="expected total with its 1 elements in memory"):
        draft_of(module)


CHANGES: dict[str, Callable[[Module], object]] = {
    "in place": lambda m: m.total.add_(1),
    "replaced": lambda m: setattr(m, "total", m.total.clone()),
    "moved": lambda m: m.total.set_(torch.tensor(0)),
    "grown": lambda m: m.rows.extend(1),
    "gone": lambda m: m.total.untyped_storage().resize_(0),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize(
    "copied", [lambda m: m, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))]
)
def test_a_change_of_a_buffer_is_seen_also_in_copies(
    change: str, copied: Callable[[tuple[Module, BufferVersions]], tuple[Module, BufferVersions]]
):
    module = Module()
    versions = BufferVersions(module.rows, single=[(module, "total")])
    module, versions = copied((module, versions))
    assert versions.unchanged()
    CHANGES[change](module)
    assert not versions.unchanged()
    if change != "gone":  # which torch cannot copy
        assert not copied((module, versions))[1].unchanged()


def test_copies_of_a_lock_that_is_held_are_free():
    lock = Lock()
    with lock, lock:
        for other in (copy.deepcopy(lock), pickle.loads(pickle.dumps(lock))):
            assert other.lock is not lock.lock
            with other:
                pass


def test_threads_switch_sooner_until_all_have_learned():
    usual = sys.getswitchinterval()
    with short_switch_interval():
        with short_switch_interval():
            assert sys.getswitchinterval() == pytest.approx(1e-4)
        assert sys.getswitchinterval() == pytest.approx(1e-4)
    assert sys.getswitchinterval() == usual

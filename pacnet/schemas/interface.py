"""The interface of motor schemas, with one sequence per node or several that compete."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention.records import NO_NODE
from pacnet.core.growable_rows import as_array
from pacnet.core.validation import as_batch, check_bounded, check_index
from pacnet.schemas.sequences import Sequences

NO_EPISODE = -1
"""The episode of a schema that was never written."""
_Own = TypeVar("_Own", bound="Schemas")


class Samples(NamedTuple):
    """T samples of an episode, in order of time."""

    node: Tensor
    """The winner, int64 `[T]`; used only where it is habituated."""
    activation: Tensor
    """Activation of the winner, `[T]`."""
    habituated: Tensor
    """Whether the winner is fully habituated, bool `[T]`."""
    target: Tensor
    """`[T, A]`."""
    cue: Tensor
    """The normalized percept, `[T, D]`."""
    habituated_at: Tensor
    """Sample since when the winner is habituated, int64 `[T]`; `NO_NODE` if that is not known."""


class Target(NamedTuple):
    """The current target of a motor schema, at one percept or at each of T percepts.

    The fields are an array and two integers, or arrays or tensors of T rows. A row without a target
    holds NaN, −1 and −1.
    """

    target: Any
    """`[A]`, or `[T, A]`."""
    offset: Any
    """Its offset in the schema's sequence, or int64 `[T]`; that of the nearest cue."""
    schema: Any
    """The schema's id, or int64 `[T]`."""


class Schemas(Sequences, ABC):
    """Motor schemas of the nodes of a map, in the order of its nodes."""

    behaviours: list[str]
    """Names of the demonstrated behaviours, in order of first use; empty where none are kept."""

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of nodes."""

    def extra_repr(self) -> str:
        """Return how much is stored, for `print`."""
        width = self.pool.columns["target"].shape[0]
        return f"nodes={len(self)}, targets={int(self.lengths.sum())}, target_dimensions={width}"

    @abstractmethod
    def add_node(self) -> int:
        """Add a node without targets and return its number."""

    @abstractmethod
    def delete(self, nodes: Tensor) -> None:
        """Delete nodes, int64 `[K]` ascending, with their schemas; later nodes move down.

        Raises:
            ValueError: not ascending, or no such nodes.
        """

    @abstractmethod
    def begin_episode(self, number: int, behaviour: str) -> None:
        """Begin a learning episode in place, or continue the last one; arguments are checked."""

    @abstractmethod
    def add_samples(self, samples: Samples, episode: int) -> None:
        """Learn checked samples of an episode in place; in eval mode, nothing."""

    @abstractmethod
    def recall_one(self, node: int, percept: NDArray[np.floating]) -> Target | None:
        """Do the same as `recall`, with arrays and without checks."""

    @abstractmethod
    def reset(self) -> None:
        """Start a recall episode; what was learned stays."""

    @abstractmethod
    def for_recall(self: _Own) -> _Own:
        """Return a module that shares these tensors, for a recall episode of its own.

        It keeps them when these schemas learn more and get others.
        """

    @abstractmethod
    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are a valid state."""

    @staticmethod
    @abstractmethod
    def extent(tensors: Mapping[str, Tensor]) -> tuple[int, int]:
        """Return the number of nodes in a `state_dict`, and its last episode or `NO_EPISODE`."""

    @torch.no_grad()
    def recall(self, node: int, percept: Tensor) -> Target | None:
        """Return the current target of the winner, or None where there is none.

        Args:
            node: the winner, or `NO_NODE`.
            percept: normalized, `[D]`.

        Raises:
            ValueError: no such node, or a percept of the wrong shape, dtype or device, or not
                finite.
        """
        self._check_recall(as_batch(percept), node)
        recalled = self.recall_one(node, as_array(percept))
        if recalled is None:
            return None
        return recalled._replace(target=torch.from_numpy(recalled.target).to(percept))

    @torch.no_grad()
    def recall_samples(self, nodes: Tensor, percepts: Tensor) -> Target:
        """Return the targets of T winners, in order of time; see `recall`.

        Args:
            nodes: winners or `NO_NODE`, int64 `[T]`.
            percepts: normalized, `[T, D]`.

        Raises:
            ValueError: no such node, not one for each percept, or a bad percept.
        """
        if not isinstance(nodes, Tensor) or nodes.dim() != 1 or nodes.layout != torch.strided:
            got = list(nodes.shape) if isinstance(nodes, Tensor) else type(nodes).__name__
            raise ValueError(f"expected nodes as a tensor [T], got {got}")
        if nodes.dtype != torch.int64:
            raise ValueError(f"expected nodes as torch.int64, got {nodes.dtype}")
        self._check_recall(percepts, *([int(nodes.min()), int(nodes.max())] if len(nodes) else []))
        if len(nodes) != len(percepts):
            raise ValueError(
                f"expected a node for each of {len(percepts)} percepts, got {len(nodes)}"
            )
        recalled = self.recall_all(nodes.numpy(force=True), as_array(percepts))
        return Target(
            torch.from_numpy(recalled.target).to(percepts),
            torch.from_numpy(recalled.offset).to(percepts.device),
            torch.from_numpy(recalled.schema).to(percepts.device),
        )

    def recall_all(self, nodes: NDArray[np.int64], percepts: NDArray[np.floating]) -> Target:
        """Do the same as `recall_samples`, with arrays and without checks."""
        targets = np.full((len(nodes), self.pool.live("target").shape[1]), np.nan, percepts.dtype)
        offsets, schemas = np.full((2, len(nodes)), NO_NODE)
        for sample, node in enumerate(nodes.tolist()):
            recalled = self.recall_one(node, percepts[sample])
            if recalled is not None:
                targets[sample], offsets[sample], schemas[sample] = recalled
        return Target(targets, offsets, schemas)

    def _check_recall(self, percepts: object, *nodes: int) -> None:
        self.check()
        cues = self.pool.live("cue")
        check_bounded("percepts", percepts, cues.shape[1], cues)
        for node in nodes:
            check_index("a node", node, len(self), optional=True)


def check_episode(episode: object, behaviour: object, last: int) -> int:
    """Return an episode's number, or raise a ValueError; the last one's number continues it."""
    number = check_index("an episode", episode, 2**63)
    if number < last:
        raise ValueError(f"expected an episode ≥ {last}, the last one observed, got {number}")
    if not isinstance(behaviour, str):
        raise ValueError(f"expected behaviour as a str, got {type(behaviour).__name__}")
    return number

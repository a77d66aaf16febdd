"""The attention map: a self-organising feature map that grows on novelty and habituates.

Source: Maistros, Marom & Hayes (2001), section "Attention System", the three cases; preset `gwr`:
Marsland, Shapiro & Nehmzow (2002), "A self-organising network that grows when required".
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from pacnet.rows import Column, GrowableRows
from pacnet.sofm_config import SOFMConfig
from pacnet.validation import check_rows

NOBODY = -1
"""Stands for «no node»: the winner of an empty map, the runner-up of a map of one node."""

_LARGEST = 1e17  # of a scaled percept: its squares still add up in float32
_SEARCH_ELEMENTS = 2**24  # differences held at once while searching: 64 MB


class Attention(NamedTuple):
    """What the map says of each percept. B percepts."""

    winner: Tensor
    """Nearest node, int64 `[B]`, or `NOBODY`."""
    runner_up: Tensor
    """Second nearest node, int64 `[B]`, or `NOBODY`."""
    activation: Tensor
    """exp(−distance to the winner), `[B]`, in (0, 1]; 0 where the map is empty."""
    novelty: Tensor
    """Whether the activation is under the novelty threshold, bool `[B]`."""


class Observation(NamedTuple):
    """What the map said of each percept before it learned it, and what it then did. T percepts."""

    winner: Tensor
    """Nearest node, int64 `[T]`, as numbered at that sample, or `NOBODY`."""
    runner_up: Tensor
    """Second nearest node, int64 `[T]`, as numbered at that sample, or `NOBODY`."""
    activation: Tensor
    """exp(−distance to the winner), `[T]`."""
    novelty: Tensor
    """Whether the activation was under the novelty threshold, bool `[T]`."""
    attended: Tensor
    """Whether the map responded (cases 1 and 2), bool `[T]`."""
    inserted: Tensor
    """Whether it made a node (case 1), bool `[T]`."""
    ignored: Tensor
    """Whether it did not respond (case 3), bool `[T]`; the opposite of `attended`."""
    dishabituated: Tensor
    """Whether the winner had been habituated for the forgetting interval and responds again."""
    deleted: Tensor
    """Number of nodes that went with their last edge, int64 `[T]`."""


class Response(NamedTuple):
    """What the map did with one percept."""

    attention: Attention  # of one percept, B = 1
    inserted: bool = False
    ignored: bool = False
    dishabituated: bool = False
    habituated: bool = False  # whether the winner was fully habituated when it matched
    deleted: Tensor | None = None  # numbers of the nodes that went, int64 [K], before they went


class HabituatingSOFM(nn.Module):
    """A map that grows on novelty, habituates to the familiar, and forgets after an interval.

    `forward` only reads. `observe` learns online, and only in training mode. The state is plain
    rows: `nodes` (prototype, habituation, habituated_at) and `edges` (ends, age). Prototypes are
    kept in scaled units, percept × scale; `prototypes` gives them in the percept's own.

    Args:
        config: every threshold and choice; see `SOFMConfig`.
    """

    scale: Tensor
    time: Tensor

    def __init__(self, config: SOFMConfig) -> None:
        super().__init__()
        self.config = config
        self.nodes = GrowableRows(
            {
                "prototype": Column((config.dimensions,), torch.float32),
                "habituation": Column((), torch.float32),
                "habituated_at": Column((), torch.int64),  # [samples], NOBODY while it responds
            }
        )
        self.edges = GrowableRows(
            {
                "ends": Column((2,), torch.int64),  # the lower number first
                "age": Column((), torch.int64),
            }
        )
        scale = (1.0,) * config.dimensions if config.scale is None else config.scale
        self.register_buffer("scale", torch.tensor(scale), persistent=False)
        self.register_buffer("time", torch.tensor(0))  # samples observed so far

    def __len__(self) -> int:
        """The number of nodes."""
        return len(self.nodes)

    @property
    def prototypes(self) -> Tensor:
        """The nodes in the percept's units, `[N, D]`."""
        return self.nodes.live("prototype") / self.scale

    @property
    def habituation(self) -> Tensor:
        """Habituation of each node, `[N]`, from 1 (never fired) down to 1 − 1/alpha."""
        return self.nodes.live("habituation")

    @property
    def fully_habituated(self) -> Tensor:
        """Which nodes are fully habituated, bool `[N]`."""
        return self.habituation < self.config.habituated_below

    def forward(self, percepts: Tensor) -> Attention:
        """Reads the map: winner, runner-up, activation and novelty of each percept.

        Args:
            percepts: `[B, D]` in the units that `config.scale` expects.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, or not finite.
        """
        return self.read(self.scaled(percepts))

    @torch.no_grad()
    def observe(self, percepts: Tensor) -> Observation:
        """Learns percepts one after the other; in eval mode it ignores them all.

        Observing a sequence at once equals observing it sample by sample, bit for bit.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, or not finite;
                nothing has been learned then.
        """
        return record([self.attend(percept) for percept in self.scaled(percepts)])

    def scaled(self, percepts: Tensor) -> Tensor:
        """Checks percepts `[B, D]` and brings them to the map's own units.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, not finite, or so
                large when scaled that their distances would not be.
        """
        scaled = check_rows("percepts", percepts, self.config.dimensions, self.scale) * self.scale
        largest = float(scaled.detach().abs().max())
        if largest > _LARGEST:
            raise ValueError(f"expected scaled percepts within ±{_LARGEST:g}, got {largest:g}")
        return scaled

    def attend(self, percept: Tensor) -> Response:
        """The three cases of the paper, for one checked and scaled percept `[D]`.

        Called without gradient. A training loop calls `observe`; this is the step that it
        repeats and that `PACNet` interleaves with the motor schemas.
        """
        attention = self.read(percept[None])
        if not self.training:
            return Response(attention, ignored=True)
        # Growing inside a caller's inference mode would make buffers nobody can update later.
        with torch.inference_mode(False):
            return self._learn(percept, attention)

    def _learn(self, percept: Tensor, attention: Attention) -> Response:
        self.time += 1
        if len(self) == 0:
            self._add_node(percept)
            return Response(attention, inserted=True)
        winner, runner_up = int(attention.winner), int(attention.runner_up)

        # Forgetting: an interval after it habituated, the winner responds again.
        dishabituated = self._forget(winner)

        # Case 1: the match is not good enough. Novelty: a new node.
        may_insert = self._is_habituated(winner) or not self.config.insert_only_when_habituated
        if bool(attention.novelty) and may_insert:
            self._insert(percept, winner, runner_up)
            return Response(attention, inserted=True, dishabituated=dishabituated)
        habituated = self._is_habituated(winner)

        # Case 3: the winner is fully habituated. It ignores the percept.
        if habituated and self.config.ignore_when_habituated:
            return Response(attention, ignored=True, habituated=True)

        # Case 2: a good match. Winner and neighbours move towards the percept and habituate.
        self._join(winner, runner_up)
        config = self.config
        self._move_and_habituate(winner, percept, config.winner_rate, config.winner_tau)
        for node in self._neighbours(winner):
            self._forget(node)
            if not (config.ignore_when_habituated and self._is_habituated(node)):
                self._move_and_habituate(node, percept, config.neighbour_rate, config.neighbour_tau)
        return Response(
            attention,
            dishabituated=dishabituated,
            habituated=habituated,
            deleted=self._age_edges(winner),
        )

    def read(self, percepts: Tensor) -> Attention:
        """`forward` for percepts `[B, D]` that `scaled` has checked.

        Searches without gradient, then takes the winning distance with it.
        """
        count = len(percepts)
        nobody = torch.full((count,), NOBODY, device=percepts.device)
        if len(self) == 0:
            nothing = percepts.new_zeros(count)
            return Attention(nobody, nobody.clone(), nothing, nothing < 1)
        prototypes = self.nodes.live("prototype")
        chunk = max(1, _SEARCH_ELEMENTS // prototypes.numel())
        with torch.no_grad():
            pairs = [_two_nearest(part, prototypes) for part in percepts.split(chunk)]
        winner, runner_up = (torch.cat(numbers) for numbers in zip(*pairs, strict=True))
        distance = torch.linalg.vector_norm(percepts - prototypes[winner], dim=1)
        activation = torch.exp(-distance)
        novelty = activation < self.config.novelty_threshold
        return Attention(winner, runner_up if len(self) > 1 else nobody, activation, novelty)

    def _is_habituated(self, node: int) -> bool:
        return bool(self.nodes.live("habituation")[node] < self.config.habituated_below)

    def _forget(self, node: int) -> bool:
        """Dishabituates a node whose interval is over; only when it is touched does it matter."""
        interval = self.config.forgetting_interval
        since = int(self.nodes.live("habituated_at")[node])
        if interval is None or since == NOBODY or int(self.time) - since < interval:
            return False
        self.nodes.live("habituation")[node] = self.config.resting_habituation
        self.nodes.live("habituated_at")[node] = NOBODY
        return True

    def _move_and_habituate(self, node: int, percept: Tensor, rate: float, tau: float) -> None:
        """Moves by a fraction of the way; then one firing of Stanley's equation, in closed form.

        τ dh/dt = α(h₀ − h) − S with S = 1 gives h(t) = h₀ − (1/α)(1 − e^{−αt/τ}); one firing on,
        h(t + 1) = h∞ + (h(t) − h∞) e^{−α/τ} with h∞ = h₀ − 1/α, which also holds for firings of
        different τ in any order.
        """
        prototype = self.nodes.live("prototype")[node]
        habituation = self.nodes.live("habituation")[node]
        fraction = rate * habituation if self.config.habituation_scales_learning else rate
        prototype += fraction * (percept - prototype)
        floor = self.config.floor_habituation
        habituation.copy_(floor + (habituation - floor) * self.config.decay(tau))
        if self._is_habituated(node) and int(self.nodes.live("habituated_at")[node]) == NOBODY:
            self.nodes.live("habituated_at")[node] = self.time

    def _insert(self, percept: Tensor, winner: int, runner_up: int) -> None:
        """Makes a node where `config.insert_at` says, joined to what it lies beside."""
        if self.config.insert_at == "percept":
            # The new node is now the best match and the old winner the second best.
            self._join(self._add_node(percept), winner)
            return
        node = self._add_node((self.nodes.live("prototype")[winner] + percept) / 2)
        self._join(node, winner)
        if runner_up != NOBODY:
            self._join(node, runner_up)
            self.edges.delete(self._edge(winner, runner_up))

    def _add_node(self, prototype: Tensor) -> int:
        resting = self.config.resting_habituation
        return self.nodes.append(
            {"prototype": prototype, "habituation": resting, "habituated_at": NOBODY}
        )

    def _neighbours(self, node: int) -> list[int]:
        """Nodes that share an edge with this one, in the order of their numbers."""
        ends = self.edges.live("ends")
        touching = ends[(ends == node).any(dim=1)]
        return sorted(int(other) for other in touching[touching != node])

    def _edge(self, one: int, other: int) -> Tensor:
        """Number of the edge between two nodes, int64 `[0 or 1]`."""
        ends = self.edges.live("ends")
        return (ends == ends.new_tensor(sorted((one, other)))).all(dim=1).nonzero().flatten()

    def _join(self, one: int, other: int) -> None:
        """Makes the edge between two nodes, or makes it young again."""
        if other == NOBODY:
            return
        edge = self._edge(one, other)
        if len(edge):
            self.edges.live("age")[edge] = 0
        else:
            self.edges.append({"ends": torch.tensor(sorted((one, other))), "age": 0})

    def _age_edges(self, winner: int) -> Tensor | None:
        """Ages the winner's edges; drops the old ones, then the nodes left without an edge.

        Returns:
            The numbers that the dropped nodes had, int64 `[K]`, or None where none was dropped.
        """
        ends, age = self.edges.live("ends"), self.edges.live("age")
        age += (ends == winner).any(dim=1)
        old = age > self.config.max_edge_age
        if not bool(old.any()):
            return None
        candidates = ends[old].unique()  # sorted
        self.edges.delete(old.nonzero().flatten())
        lonely = candidates[~torch.isin(candidates, self.edges.live("ends"))]
        if len(lonely) == 0:
            return None
        self.nodes.delete(lonely)
        ends = self.edges.live("ends")
        ends -= torch.searchsorted(lonely, ends)  # numbers move down past each dropped node
        return lonely


def _two_nearest(percepts: Tensor, prototypes: Tensor) -> tuple[Tensor, Tensor]:
    """Numbers of the nearest and the second nearest prototype, int64 `[B]` each."""
    # Squares summed directly: |x|² − 2xw + |w|² would lose the digits that decide ties.
    distance = (percepts[:, None] - prototypes).square().sum(dim=2)  # [B, N], squared
    nearest = distance.argmin(dim=1)  # of exactly equal ones the lowest number
    distance.scatter_(1, nearest[:, None], torch.inf)
    return nearest, distance.argmin(dim=1)


def record(responses: list[Response]) -> Observation:
    """Joins the responses to T percepts into one record."""
    fields = zip(*(response.attention for response in responses), strict=True)
    attention = Attention(*(torch.cat(field) for field in fields))
    device = attention.winner.device
    ignored = torch.tensor([r.ignored for r in responses], device=device)
    deleted = [0 if r.deleted is None else len(r.deleted) for r in responses]
    return Observation(
        *attention,
        attended=~ignored,
        inserted=torch.tensor([r.inserted for r in responses], device=device),
        ignored=ignored,
        dishabituated=torch.tensor([r.dishabituated for r in responses], device=device),
        deleted=torch.tensor(deleted, device=device),
    )

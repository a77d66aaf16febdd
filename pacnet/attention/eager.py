"""The rule of the growing map in plain torch: the specification of the compiled engine.

Source: Maistros, Marom & Hayes (2001), section "Attention System", the three cases; preset `gwr`:
Marsland, Shapiro & Nehmzow (2002), "A self-organising network that grows when required".
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from pacnet.attention.config import SOFMConfig
from pacnet.attention.records import NO_NODE, Attention, MapUpdate, observation_of
from pacnet.attention.state import MapState
from pacnet.core.growable_rows import GrowableRows

_SEARCH_ELEMENTS = 2**24  # differences held at once while searching: 64 MB


class _Response(NamedTuple):
    """What the map did with one percept."""

    attention: Attention  # of one percept, B = 1
    inserted: bool = False
    ignored: bool = False
    dishabituated: bool = False
    habituated: bool = False  # whether the winner was fully habituated when it matched
    habituated_at: int = NO_NODE  # since when it was
    deleted: Tensor | None = None  # nodes, int64 [K], as they were before the deletion


class EagerEngine:
    """The rule of the map in plain torch, for every device and precision.

    Args:
        config: of the map.
    """

    def __init__(self, config: SOFMConfig) -> None:
        self.config = config

    def read(self, nodes: GrowableRows, percepts: Tensor) -> Attention:
        """Read normalized percepts `[B, D]`."""
        prototypes = nodes.live("prototype")
        if len(prototypes) == 0:
            winner = torch.full((len(percepts),), NO_NODE, device=percepts.device)
            activation = percepts.new_zeros(len(percepts))
            return Attention(winner, winner.clone(), activation, activation < 1)
        winner, runner_up = _search(percepts, prototypes)
        return activate(percepts, prototypes, winner, runner_up, self.config.novelty_threshold)

    def learn(self, state: MapState, percepts: Tensor) -> MapUpdate:
        """Learn normalized percepts `[T, D]` in order of time, in place, without gradient.

        Raises:
            ValueError: nodes or edges that contradict one another.
        """
        state.check()
        responses = [self._respond(state, percept) for percept in percepts.detach()]
        fields = zip(*(response.attention for response in responses), strict=True)
        attention = Attention(*(torch.cat(field) for field in fields))
        flags = zip(*(response[1:6] for response in responses), strict=True)
        inserted, ignored, dishabituated, habituated, habituated_at = (
            torch.tensor(flag, device=attention.winner.device) for flag in flags
        )
        deleted = {t: r.deleted for t, r in enumerate(responses) if r.deleted is not None}
        observation = observation_of(attention, inserted, ignored, dishabituated, deleted)
        return MapUpdate(observation, habituated, habituated_at, deleted)

    def _respond(self, state: MapState, percept: Tensor) -> _Response:
        """Apply the three cases of the paper to one percept `[D]`."""
        attention, config = self.read(state.nodes, percept[None]), self.config
        state.buffers["time"] += 1
        if len(state.nodes) == 0:
            self._add_node(state, percept)
            return _Response(attention, inserted=True)
        winner, runner_up = int(attention.winner), int(attention.runner_up)

        # Forgetting: an interval after it habituated, the winner responds again.
        dishabituated = self._forget(state, winner)
        since = int(state.nodes.live("habituated_at")[winner])

        # Case 1: the match is not good enough. Novelty: a new node.
        habituated = self._is_habituated(state, winner)
        if bool(attention.novelty) and (habituated or not config.insert_only_when_habituated):
            self._insert(state, percept, winner, runner_up)
            return _Response(
                attention, inserted=True, dishabituated=dishabituated, habituated_at=since
            )

        # Case 3: the winner is fully habituated. It ignores the percept.
        if habituated and config.ignore_when_habituated:
            return _Response(attention, ignored=True, habituated=True, habituated_at=since)

        # Case 2: a good match. Winner and neighbours move towards the percept and habituate.
        _join(state, winner, runner_up)
        self._fire(state, winner, percept, config.winner_rate, config.winner_tau)
        for node in _neighbours(state, winner):
            self._forget(state, node)
            if not (config.ignore_when_habituated and self._is_habituated(state, node)):
                self._fire(state, node, percept, config.neighbour_rate, config.neighbour_tau)
        return _Response(
            attention,
            dishabituated=dishabituated,
            habituated=habituated,
            habituated_at=since,
            deleted=self._age_edges(state, winner),
        )

    def _is_habituated(self, state: MapState, node: int) -> bool:
        return bool(state.nodes.live("habituation")[node] < self.config.habituated_below)

    def _forget(self, state: MapState, node: int) -> bool:
        """Dishabituate a node whose interval is over; nodes are checked only when they are used."""
        interval = self.config.forgetting_interval
        since = int(state.nodes.live("habituated_at")[node])
        if interval is None or since == NO_NODE or int(state.buffers["time"]) - since < interval:
            return False
        state.nodes.live("habituation")[node] = self.config.resting_habituation
        state.nodes.live("habituated_at")[node] = NO_NODE
        return True

    def _fire(self, state: MapState, node: int, percept: Tensor, rate: float, tau: float) -> None:
        """Move a node a fraction of the way; habituate by Stanley's equation, in closed form.

        τ dh/dt = α(h₀ − h) − S with S = 1 gives h(t) = h₀ − (1/α)(1 − e^{−αt/τ}); one firing on,
        h(t + 1) = h∞ + (h(t) − h∞) e^{−α/τ} with h∞ = h₀ − 1/α, which also holds for firings of
        different τ in any order.
        """
        prototype = state.nodes.live("prototype")[node]
        habituation = state.nodes.live("habituation")[node]
        fraction = rate * habituation if self.config.habituation_scales_learning else rate
        prototype += fraction * (percept - prototype)
        floor = self.config.floor_habituation
        habituation.copy_(floor + (habituation - floor) * self.config.decay(tau))
        habituated_at = state.nodes.live("habituated_at")
        if self._is_habituated(state, node) and int(habituated_at[node]) == NO_NODE:
            habituated_at[node] = state.buffers["time"]

    def _insert(self, state: MapState, percept: Tensor, winner: int, runner_up: int) -> None:
        """Make a node where `config.insert_at` says, joined to its neighbours."""
        if self.config.insert_at == "percept":
            # The new node is now the best match and the old winner the second best.
            _join(state, self._add_node(state, percept), winner)
            return
        node = self._add_node(state, (state.nodes.live("prototype")[winner] + percept) / 2)
        _join(state, node, winner)
        if runner_up != NO_NODE:
            _join(state, node, runner_up)
            state.edges.swap_remove(_edge_between(state, winner, runner_up))

    def _add_node(self, state: MapState, prototype: Tensor) -> int:
        resting = self.config.resting_habituation
        return state.nodes.append(
            {"prototype": prototype, "habituation": resting, "habituated_at": NO_NODE}
        )

    def _age_edges(self, state: MapState, winner: int) -> Tensor | None:
        """Age the winner's edges, delete old ones, then isolated nodes; return those, if any."""
        ends, age = state.edges.live("ends"), state.edges.live("age")
        age += (ends == winner).any(dim=1)
        old = age > self.config.max_edge_age
        if not bool(old.any()):
            return None
        candidates = ends[old].unique()  # sorted
        state.edges.swap_remove(old.nonzero().flatten())
        isolated = candidates[~torch.isin(candidates, state.edges.live("ends"))]
        if len(isolated) == 0:
            return None
        state.delete_nodes(isolated)
        return isolated


def _neighbours(state: MapState, node: int) -> list[int]:
    """Return the nodes that share an edge with this one, ascending."""
    ends = state.edges.live("ends")
    touching = ends[(ends == node).any(dim=1)]
    return sorted(int(other) for other in touching[touching != node])


def _edge_between(state: MapState, one: int, other: int) -> Tensor:
    """Return the index of the edge between two nodes, int64 `[0 or 1]`."""
    ends = state.edges.live("ends")
    return (ends == ends.new_tensor(sorted((one, other)))).all(dim=1).nonzero().flatten()


def _join(state: MapState, one: int, other: int) -> None:
    """Make an edge between two nodes, or set its age to 0."""
    if other == NO_NODE:
        return
    edge = _edge_between(state, one, other)
    if len(edge):
        state.edges.live("age")[edge] = 0
    else:
        state.edges.append({"ends": torch.tensor(sorted((one, other))), "age": 0})


def activate(
    percepts: Tensor, prototypes: Tensor, winner: Tensor, runner_up: Tensor, threshold: float
) -> Attention:
    """Return the attention to percepts whose winners are known, with its gradient."""
    distance = torch.linalg.vector_norm(percepts - prototypes[winner], dim=1)
    activation = torch.exp(-distance)
    return Attention(winner, runner_up, activation, activation < threshold)


@torch.no_grad()
def _search(percepts: Tensor, prototypes: Tensor) -> tuple[Tensor, Tensor]:
    """Return the nearest and the second nearest of N ≥ 1 prototypes, int64 `[B]` each."""
    chunk = max(1, _SEARCH_ELEMENTS // prototypes.numel())
    pairs = [_two_nearest(part, prototypes) for part in percepts.split(chunk)]
    winner, runner_up = (torch.cat(indices) for indices in zip(*pairs, strict=True))
    return winner, runner_up


def _two_nearest(percepts: Tensor, prototypes: Tensor) -> tuple[Tensor, Tensor]:
    # Squares summed directly: |x|² − 2xw + |w|² would lose the digits that decide ties.
    distance = (percepts[:, None] - prototypes).square().sum(dim=2)  # [B, N], squared
    nearest = distance.argmin(dim=1)  # ties go to the lowest index
    if len(prototypes) == 1:
        return nearest, torch.full_like(nearest, NO_NODE)
    distance.scatter_(1, nearest[:, None], torch.inf)
    return nearest, distance.argmin(dim=1)

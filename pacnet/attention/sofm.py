"""The attention map: a self-organising feature map that grows on novelty and habituates.

Source: Maistros, Marom & Hayes (2001), section "Attention System", the three cases; preset `gwr`:
Marsland, Shapiro & Nehmzow (2002), "A self-organising network that grows when required".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.config import LARGEST_PERCEPT, SOFMConfig
from pacnet.attention.records import (
    NO_NODE,
    Attention,
    MapUpdate,
    Observation,
    Response,
    Step,
    ignored,
    record,
)
from pacnet.attention.state_checks import map_holds
from pacnet.core.drafts import Lock, adopt, draft_of, short_switch_interval, snapshot_of
from pacnet.core.growable_rows import (
    Column,
    GrowableRows,
    as_array,
    check_storage,
    copy_on_state_dict,
)
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.core.validation import as_batch, check_row, check_rows
from pacnet.kernels.engine import Engine, check_engine, runs_compiled

if TYPE_CHECKING:
    from pacnet.attention.compiled import CompiledSOFM, MapState

_SEARCH_ELEMENTS = 2**24  # differences held at once while searching: 64 MB


class HabituatingSOFM(nn.Module):
    """A map that grows on novelty, habituates to the familiar, and forgets after an interval.

    `forward` only reads. `observe` learns online, and only in training mode. The state is plain
    rows: `nodes` (prototype, habituation, habituated_at) and `edges` (ends, age). Prototypes are
    kept in scaled units, percept × scale; `prototypes` gives them in the percept's own.

    Args:
        config: every threshold and choice; see `SOFMConfig`.
        engine: `auto` runs compiled kernels where they can run, for float32 on the CPU, and eager
            torch elsewhere; `eager` and `compiled` force one. Both learn the same.

    Raises:
        ValueError: no such engine. With `compiled`, the methods raise it where it cannot run.
    """

    scale: Tensor
    time: Tensor

    def __init__(self, config: SOFMConfig, engine: Engine = "auto") -> None:
        super().__init__()
        check_engine(engine)
        self.config = config
        self.engine: Engine = engine
        self._compiled: CompiledSOFM | None = None
        self._cache: MapState | None = None
        self._learning = Lock()
        self.nodes = GrowableRows(
            {
                "prototype": Column((config.dimensions,), torch.float32, transposed=True),
                "habituation": Column((), torch.float32),
                "habituated_at": Column((), torch.int64),  # [samples], NO_NODE while it responds
            }
        )
        self.edges = GrowableRows(
            {
                "ends": Column((2,), torch.int64),  # the lower number first
                "age": Column((), torch.int64),
            }
        )
        scale = torch.ones(config.dimensions)
        if config.scale is not None:
            scale = torch.tensor(config.scale)
        self.register_buffer("scale", scale, persistent=False)
        self.register_buffer("time", torch.tensor(0))  # samples observed so far
        copy_on_state_dict(self)
        check_on_load(self)

    def __len__(self) -> int:
        """The number of nodes."""
        return len(self.nodes)

    def extra_repr(self) -> str:
        """Return the size of the map, for `print`."""
        return f"nodes={len(self)}, edges={len(self.edges)}, dimensions={self.config.dimensions}"

    @property
    def prototypes(self) -> Tensor:
        """The nodes in the percept's units, `[N, D]`."""
        return self.nodes.live("prototype") / check_storage("scale", self.scale)

    @property
    def habituation(self) -> Tensor:
        """Habituation of each node, `[N]`, from 1 (never fired) down to 1 − 1/alpha."""
        return self.nodes.live("habituation")

    @property
    def fully_habituated(self) -> Tensor:
        """Which nodes are fully habituated, bool `[N]`."""
        return self.habituation < self.config.habituated_below

    def state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """As of any module; where another thread learns, of before or after it."""
        with self._learning:
            return super().state_dict(*args, **kwargs)

    def load_state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """As of any module, all or nothing; what another thread is learning is finished before."""
        with self._learning:
            return super().load_state_dict(*args, **kwargs)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError unless these tensors, of a `state_dict`, are the state of a map."""
        check_structure(self, tensors)
        check_conditions(map_holds(self.config.floor_habituation, tensors))

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
        return self.observe_scaled(self.scaled(percepts))

    def observe_scaled(self, percepts: Tensor) -> Observation:
        """`observe` for percepts `[T, D]` that `scaled` has checked; called without gradient."""
        if not self.training:
            return ignored(self.read(percepts)).observation
        # Growing inside a caller's inference mode would make buffers nobody can update later.
        with self._learning, short_switch_interval(), torch.inference_mode(False):
            draft = draft_of(self)
            observation = draft.learn(percepts).observation
            adopt(self, draft)
        return observation

    def step(self, percept: NDArray[np.float32] | Tensor) -> Step:
        """`observe` for one percept of a control loop, in a few microseconds, without tensors.

        In training mode it learns the percept, in place: who reads meanwhile may see a prototype on
        its way. In eval mode it only reads the map.

        Args:
            percept: `[D]`, an array or tensor of the map's dtype; arrays are on the CPU.

        Raises:
            ValueError: a percept of the wrong shape, dtype or device, or not finite; nothing has
                been learned then.
        """
        if not self.training:
            return self.look(percept)[0]
        with self._learning.lock:
            compiled = self.compiled()
            if compiled is not None:
                row = check_row("percept", percept, self.config.dimensions)
                step = compiled.step(self._state(), row)
                return self._refuse(row) if step is None else step
        observation = self.observe(as_batch(percept, arrays=True))
        return Step._make(field.item() for field in observation)

    def look(self, percept: NDArray[np.float32] | Tensor) -> tuple[Step, NDArray[np.float32]]:
        """`step` in eval mode, whichever mode it is in, and the scaled percept, `[D]`."""
        compiled = self.compiled()
        if compiled is not None:
            row = check_row("percept", percept, self.config.dimensions)
            seen = compiled.look(self._state(), row)
            return self._refuse(row) if seen is None else seen
        with torch.no_grad():
            scaled = self.scaled(as_batch(percept, arrays=True))
            reading = [field.item() for field in self.read(scaled)]
        step = Step._make((*reading, False, False, True, False, 0))  # it ignores what it reads
        return step, as_array(scaled[0])

    def compiled(self) -> CompiledSOFM | None:
        """The compiled engine, or None where the eager one runs.

        Raises:
            ValueError: `engine="compiled"`, and it cannot run.
        """
        nodes: Any = self._modules["nodes"]  # as an attribute it would take a microsecond
        if not runs_compiled(self.engine, nodes._buffers["prototype"]):
            return None
        if self._compiled is None or self._compiled.config is not self.config:
            from pacnet.attention.compiled import CompiledSOFM

            self._compiled = CompiledSOFM(self.config)
        return self._compiled

    def _state(self) -> MapState:
        if self._cache is None:
            from pacnet.attention.compiled import MapState

            own: Any = self._buffers
            self._cache = MapState(self.nodes, self.edges, own, self._drop_nodes)
        return self._cache

    def _refuse(self, percept: NDArray[np.float32]) -> NoReturn:
        """Says what is wrong with one that was not read.

        Raises:
            ValueError: always.
        """
        self.scaled(torch.from_numpy(percept.copy())[None])
        raise ValueError(f"expected a percept that the map can read, got {percept.tolist()}")

    def _check_own(self) -> None:
        """Checks what a user may have done to the config, the prototypes or the scale.

        Raises:
            ValueError: they are no longer of one width, or not all in memory.
        """
        width, own = self.config.dimensions, (self.nodes.live("prototype"), self.scale)
        if own[0].dim() != 2 or own[0].shape[1] != width or own[1].shape != (width,):
            raise ValueError(
                f"expected prototypes [nodes, {width}] and a scale [{width}], as the config says, "
                f"got {list(own[0].shape)} and {list(own[1].shape)}"
            )
        if own[0].dtype != own[1].dtype:
            raise ValueError(f"expected a scale in {own[0].dtype}, got {own[1].dtype}")
        check_storage("scale", own[1])

    def scaled(self, percepts: Tensor) -> Tensor:
        """Checks percepts `[B, D]` and brings them to the map's own units.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, not finite, or so
                large when scaled that their distances would not be.
        """
        self._check_own()
        width = self.config.dimensions
        rows = check_rows("percepts", percepts, width, self.scale, finite=False)
        scaled = rows if self.config.scale is None else rows * self.scale
        low, high = scaled.detach().aminmax()
        if not -LARGEST_PERCEPT <= float(low) <= float(high) <= LARGEST_PERCEPT:  # NaN is not
            check_rows("percepts", percepts, width, self.scale)
            wanted, largest = f"±{LARGEST_PERCEPT:g}", max(-float(low), float(high))
            raise ValueError(f"expected scaled percepts within {wanted}, got {largest:g}")
        return scaled

    def learn(self, percepts: Tensor) -> MapUpdate:
        """Learns percepts `[T, D]` that `scaled` has checked, in place, without gradient.

        `observe` calls it on a draft; so does whoever else lets others read meanwhile.
        """
        compiled = self.compiled()
        if compiled is not None:
            return compiled.learn(self._state(), _contiguous(percepts))
        self._check_rows()
        return record([self.attend(percept) for percept in percepts.detach()])

    def _check_rows(self) -> None:
        """Checks what a user may have done to nodes and edges.

        Raises:
            ValueError: as `GrowableRows.check`, edges that lead nowhere, or a time of several.
        """
        if self.time.shape != () or self.time.dtype != torch.int64:
            raise ValueError(f"expected time as one torch.int64, got {self.time}")
        self.nodes.check()
        self.edges.check()
        ends = self.edges.live("ends")
        inside = (ends >= 0) & (ends < len(self)) & (ends[:, :1] != ends[:, 1:])
        if not bool(inside.all()):
            raise ValueError(f"expected edges between two of {len(self)} nodes each, got others")

    def attend(self, percept: Tensor) -> Response:
        """The three cases of the paper, for one checked and scaled percept `[D]`: one eager step.

        It is the specification of what the compiled engine does. Called without gradient.
        """
        attention = self.read(percept[None])
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
        nodes, compiled = (
            snapshot_of(self.nodes),
            self.compiled(),
        )  # another thread may replace its rows
        prototypes = nodes.live("prototype")
        if compiled is not None and not (torch.is_grad_enabled() and percepts.requires_grad):
            return compiled.read(nodes, percepts)
        count = len(percepts)
        nobody = torch.full((count,), NO_NODE, device=percepts.device)
        if len(prototypes) == 0:
            nothing = percepts.new_zeros(count)
            return Attention(nobody, nobody.clone(), nothing, nothing < 1)
        if compiled is None:
            winner, runner_up = _search(percepts, prototypes)
        else:
            winner, runner_up = compiled.read(nodes, percepts)[:2]
        distance = torch.linalg.vector_norm(percepts - prototypes[winner], dim=1)
        activation = torch.exp(-distance)
        novelty = activation < self.config.novelty_threshold
        return Attention(winner, runner_up if len(prototypes) > 1 else nobody, activation, novelty)

    def _is_habituated(self, node: int) -> bool:
        return bool(self.nodes.live("habituation")[node] < self.config.habituated_below)

    def _forget(self, node: int) -> bool:
        """Dishabituates a node whose interval is over; only when it is touched does it matter."""
        interval = self.config.forgetting_interval
        since = int(self.nodes.live("habituated_at")[node])
        if interval is None or since == NO_NODE or int(self.time) - since < interval:
            return False
        self.nodes.live("habituation")[node] = self.config.resting_habituation
        self.nodes.live("habituated_at")[node] = NO_NODE
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
        if self._is_habituated(node) and int(self.nodes.live("habituated_at")[node]) == NO_NODE:
            self.nodes.live("habituated_at")[node] = self.time

    def _insert(self, percept: Tensor, winner: int, runner_up: int) -> None:
        """Makes a node where `config.insert_at` says, joined to what it lies beside."""
        if self.config.insert_at == "percept":
            # The new node is now the best match and the old winner the second best.
            self._join(self._add_node(percept), winner)
            return
        node = self._add_node((self.nodes.live("prototype")[winner] + percept) / 2)
        self._join(node, winner)
        if runner_up != NO_NODE:
            self._join(node, runner_up)
            self.edges.swap_remove(self._edge(winner, runner_up))

    def _add_node(self, prototype: Tensor) -> int:
        resting = self.config.resting_habituation
        return self.nodes.append(
            {"prototype": prototype, "habituation": resting, "habituated_at": NO_NODE}
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
        if other == NO_NODE:
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
        self.edges.swap_remove(old.nonzero().flatten())
        lonely = candidates[~torch.isin(candidates, self.edges.live("ends"))]
        if len(lonely) == 0:
            return None
        self._drop_nodes(lonely)
        return lonely

    def _drop_nodes(self, lonely: Tensor) -> None:
        """Deletes nodes that have no edge, int64 `[K]` ascending; the later ones move down."""
        self.nodes.delete(lonely)
        ends = self.edges.live("ends")
        ends -= torch.searchsorted(lonely, ends)


@torch.no_grad()
def _search(percepts: Tensor, prototypes: Tensor) -> tuple[Tensor, Tensor]:
    """Numbers of the nearest and the second nearest prototype, int64 `[B]` each."""
    chunk = max(1, _SEARCH_ELEMENTS // prototypes.numel())
    pairs = [_two_nearest(part, prototypes) for part in percepts.split(chunk)]
    winner, runner_up = (torch.cat(numbers) for numbers in zip(*pairs, strict=True))
    return winner, runner_up


def _two_nearest(percepts: Tensor, prototypes: Tensor) -> tuple[Tensor, Tensor]:
    """Numbers of the nearest and the second nearest prototype, int64 `[B]` each."""
    # Squares summed directly: |x|² − 2xw + |w|² would lose the digits that decide ties.
    distance = (percepts[:, None] - prototypes).square().sum(dim=2)  # [B, N], squared
    nearest = distance.argmin(dim=1)  # of exactly equal ones the lowest number
    distance.scatter_(1, nearest[:, None], torch.inf)
    return nearest, distance.argmin(dim=1)


def _contiguous(percepts: Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(percepts.detach().numpy())

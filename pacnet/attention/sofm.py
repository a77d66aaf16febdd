"""The attention map: a self-organising feature map that grows on novelty and habituates.

The module holds buffers and checks; `eager` has the learning rule, `compiled` the fast engine.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.config import SOFMConfig
from pacnet.attention.eager import EagerEngine
from pacnet.attention.records import Attention, MapUpdate, Observation, Step, ignored
from pacnet.attention.state import MapState, map_holds
from pacnet.core.drafts import Lock, adopt, draft_of, short_switch_interval, snapshot_of
from pacnet.core.growable_rows import (
    Column,
    GrowableRows,
    as_array,
    check_storage,
    copy_on_state_dict,
)
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.core.old_names import old_names
from pacnet.core.validation import MAX_VALUE, as_batch, check_row, check_rows
from pacnet.kernels.engine import Engine, check_engine, runs_compiled

if TYPE_CHECKING:
    from pacnet.attention.compiled import CompiledEngine


@old_names(scaled="normalize", look="read_one", learn="update")
class HabituatingSOFM(nn.Module):
    """A map that grows on novel percepts, habituates to familiar ones, and forgets after a time.

    `forward` only reads. `observe` learns online, and only in training mode; `step` does either for
    one percept of a control loop. The state is plain rows: `nodes` (prototype, habituation,
    habituated_at) and `edges` (ends, age). Prototypes are kept normalized, percept × scale;
    `prototypes` returns them in the percept's own units.

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
        self._compiled: CompiledEngine | None = None
        self._cache: MapState | None = None
        self._learning = Lock()
        self.nodes = GrowableRows(
            {
                "prototype": Column((config.dimensions,), torch.float32, transposed=True),
                "habituation": Column((), torch.float32),
                "habituated_at": Column((), torch.int64),  # [samples], NO_NODE while it responds
            }
        )
        ends, age = Column((2,), torch.int64), Column((), torch.int64)  # lower end first
        self.edges = GrowableRows({"ends": ends, "age": age})
        scale = torch.tensor(config.scale or [1.0] * config.dimensions)
        self.register_buffer("scale", scale, persistent=False)
        self.register_buffer("time", torch.tensor(0))  # samples observed so far
        copy_on_state_dict(self)
        check_on_load(self)

    def __len__(self) -> int:
        """Return the number of nodes."""
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

    def forward(self, percepts: Tensor) -> Attention:
        """Read the map: winner, runner-up, activation and novelty of each percept.

        The activation is differentiable in the percepts.

        Args:
            percepts: `[B, D]` in the units that `config.scale` expects.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, or not finite.
        """
        return self.read(self.normalize(percepts))

    @torch.no_grad()
    def observe(self, percepts: Tensor) -> Observation:
        """Learn percepts one after the other; ignore them all in eval mode.

        Observing a sequence at once equals observing it sample by sample, bit for bit.

        Args:
            percepts: `[T, D]`, in order of time.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, or not finite;
                nothing has been learned then.
        """
        normalized = self.normalize(percepts)
        if not self.training:
            return ignored(self.read(normalized))
        # Buffers made inside a caller's inference mode could not be updated later.
        with self._learning, short_switch_interval(), torch.inference_mode(False):
            draft = draft_of(self)
            observation = draft.update(normalized).observation
            adopt(self, draft)
        return observation

    def step(self, percept: NDArray[np.float32] | Tensor) -> Step:
        """Observe one percept of a control loop, in a few microseconds, without tensors.

        In training mode it learns the percept in place: threads that read meanwhile may see a
        prototype on its way. In eval mode it only reads the map.

        Args:
            percept: `[D]`, an array or tensor of the map's dtype; arrays are on the CPU.

        Raises:
            ValueError: a percept of the wrong shape, dtype or device, or not finite; nothing has
                been learned then.
        """
        if not self.training:
            return self.read_one(percept)[0]
        with self._learning.lock:
            compiled = self._find_compiled()
            if compiled is not None:
                row = check_row("percept", percept, self.config.dimensions)
                step = compiled.step(self._state(), row)
                return self._reject(row) if step is None else step
        observation = self.observe(as_batch(percept, arrays=True))
        return Step._make(field.item() for field in observation)

    def normalize(self, percepts: Tensor) -> Tensor:
        """Check percepts `[B, D]` and return them in the map's own units, percept × scale.

        Raises:
            ValueError: percepts of the wrong shape, dtype or device, empty, not finite, or so
                large when scaled that their distances would not be.
        """
        width = self.config.dimensions
        self._state().check_widths(width)
        rows = check_rows("percepts", percepts, width, self.scale, finite=False)
        normalized = rows if self.config.scale is None else rows * self.scale
        low, high = normalized.detach().aminmax()
        if not -MAX_VALUE <= float(low) <= float(high) <= MAX_VALUE:  # NaN is not
            check_rows("percepts", percepts, width, self.scale)
            largest = max(-float(low), float(high))
            raise ValueError(f"expected scaled percepts within ±{MAX_VALUE:g}, got {largest:g}")
        return normalized

    # For a network

    def read(self, normalized: Tensor) -> Attention:
        """Read percepts `[B, D]` that `normalize` has returned."""
        # A snapshot, as another thread may replace the rows meanwhile.
        return self._engine().read(snapshot_of(self.nodes), normalized)

    def update(self, normalized: Tensor) -> MapUpdate:
        """Learn percepts `[T, D]` that `normalize` has returned, in place, in either mode.

        Call it without gradient, on a draft of the map if other threads read the map.
        """
        return self._engine().learn(self._state(), normalized)

    def read_one(self, percept: NDArray[np.float32] | Tensor) -> tuple[Step, NDArray[np.float32]]:
        """Read one percept `[D]` as `step` in eval mode does, and return it normalized, `[D]`."""
        compiled = self._find_compiled()
        if compiled is not None:
            row = check_row("percept", percept, self.config.dimensions)
            reading = compiled.read_one(self._state(), row)
            return self._reject(row) if reading is None else reading
        with torch.no_grad():
            normalized = self.normalize(as_batch(percept, arrays=True))
            observation = ignored(self.read(normalized))
        return Step._make(field.item() for field in observation), as_array(normalized[0])

    def state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """Return the state; if another thread is learning, that before or after it."""
        with self._learning:
            return super().state_dict(*args, **kwargs)

    def load_state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """Load a state, all or nothing, once other threads have finished learning."""
        with self._learning:
            return super().load_state_dict(*args, **kwargs)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of a map."""
        check_structure(self, tensors)
        check_conditions(map_holds(self.config.floor_habituation, tensors))

    def _engine(self) -> EagerEngine | CompiledEngine:
        return self._find_compiled() or EagerEngine(self.config)

    def _find_compiled(self) -> CompiledEngine | None:
        """Return the compiled engine, or None where the eager one runs.

        Raises:
            ValueError: `engine="compiled"`, and it cannot run.
        """
        nodes: Any = self._modules["nodes"]  # as an attribute it would take a microsecond
        if not runs_compiled(self.engine, nodes._buffers["prototype"]):
            return None
        if self._compiled is None or self._compiled.config is not self.config:
            from pacnet.attention.compiled import CompiledEngine  # which imports numba

            self._compiled = CompiledEngine(self.config)
        return self._compiled

    def _state(self) -> MapState:
        if self._cache is None:
            own: Any = self._buffers
            self._cache = MapState(self.nodes, self.edges, own)
        return self._cache

    def _reject(self, percept: NDArray[np.float32]) -> NoReturn:
        """Raise a ValueError that says why the engine refused a percept."""
        self.normalize(torch.from_numpy(percept.copy())[None])
        raise ValueError(f"expected a percept that the map can read, got {percept.tolist()}")

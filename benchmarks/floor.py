"""The lower bound of the time: `floor.c`, compiled here and called once for a whole stream."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from pacnet import SOFMConfig

SOURCE = Path(__file__).with_name("floor.c")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fPIC")
BLOCK = 16  # nodes that the C source searches at once

FIELDS = {
    "winner": np.int64,
    "runner_up": np.int64,
    "deleted": np.int64,
    "activation": np.float32,
    "novelty": np.bool_,
    "inserted": np.bool_,
    "ignored": np.bool_,
    "dishabituated": np.bool_,
}
"""What is recorded of each sample, in the order of the C source."""


class _Config(ctypes.Structure):
    _fields_ = [
        ("dimensions", ctypes.c_int64),
        *((name, ctypes.c_float) for name in ("novelty_threshold", "winner_rate")),
        *((name, ctypes.c_float) for name in ("neighbour_rate", "habituated_below", "resting")),
        *((name, ctypes.c_float) for name in ("floor", "winner_decay", "neighbour_decay")),
        ("insert_only_when_habituated", ctypes.c_int32),
        ("insert_at_midpoint", ctypes.c_int32),
        ("ignore_when_habituated", ctypes.c_int32),
        ("habituation_scales_learning", ctypes.c_int32),
        ("forgetting_interval", ctypes.c_int64),
        ("max_edge_age", ctypes.c_int64),
    ]

    @classmethod
    def of(cls, config: SOFMConfig) -> _Config:
        return cls(
            config.dimensions,
            config.novelty_threshold,
            config.winner_rate,
            config.neighbour_rate,
            config.habituated_below,
            config.resting_habituation,
            config.floor_habituation,
            config.decay(config.winner_tau),
            config.decay(config.neighbour_tau),
            config.insert_only_when_habituated,
            config.insert_at == "midpoint",
            config.ignore_when_habituated,
            config.habituation_scales_learning,
            config.forgetting_interval or 0,
            config.max_edge_age,
        )


class _Record(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in FIELDS]


class Floor:
    """The growing map in C, with fixed capacities and percepts in scaled units."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._observe = library.observe
        self._observe.restype = ctypes.c_int64
        self._observe.argtypes = [
            ctypes.POINTER(_Config),
            ctypes.c_void_p,
            *(ctypes.c_int64 for _ in range(3)),
            ctypes.POINTER(_Record),
        ]
        self._read = library.read_all
        self._read.restype = ctypes.c_float
        self._read.argtypes = [ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64]

    def read(self, numbers: np.ndarray, repeats: int) -> float:
        """Return the sum of float32 numbers, read `repeats` times.

        Raises:
            ValueError: Another type, not a multiple of 64 numbers, or not aligned to 64 bytes.
        """
        if numbers.dtype != np.float32 or numbers.size % 64 or numbers.ctypes.data % 64:
            raise ValueError("expected float32 numbers, a multiple of 64, aligned to 64 bytes")
        return self._read(numbers.ctypes.data, numbers.size, repeats)

    def observe(
        self, config: SOFMConfig, percepts: np.ndarray, capacity: int = 2048, degree: int = 64
    ) -> tuple[int, dict[str, np.ndarray]]:
        """Learn a stream from an empty map.

        Args:
            config: Of the map, with unit scale.
            percepts: Float32 `[T, D]`, contiguous.
            capacity: Most nodes, a multiple of 16.
            degree: Most edges of one node.

        Returns:
            The number of nodes at the end, and the record of each sample.

        Raises:
            ValueError: A scale, percepts of another type, or a capacity that was too small.
        """
        _check(config, percepts, capacity)
        record = {name: np.empty(len(percepts), dtype) for name, dtype in FIELDS.items()}
        columns = _Record(*(column.ctypes.data for column in record.values()))
        settings = _Config.of(config)
        nodes = self._observe(
            settings, percepts.ctypes.data, len(percepts), capacity, degree, columns
        )
        if nodes < 0:
            raise ValueError(f"expected ≤ {capacity} nodes of ≤ {degree} edges each, got more")
        return nodes, record


def _check(config: SOFMConfig, percepts: np.ndarray, capacity: int) -> None:
    if config.scale is not None:
        raise ValueError(f"expected a config without scale, got {config.scale}")
    wanted = percepts.dtype == np.float32 and percepts.flags.c_contiguous
    if not wanted or percepts.ndim != 2 or percepts.shape[1] != config.dimensions:
        raise ValueError(
            f"expected contiguous float32 percepts [T, {config.dimensions}], "
            f"got {percepts.dtype} {list(percepts.shape)}"
        )
    if capacity < BLOCK or capacity % BLOCK:
        raise ValueError(f"expected a capacity that is a multiple of {BLOCK}, got {capacity}")


@cache
def build() -> Floor | None:
    """Compile the source with the machine's C compiler; return None if that fails."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        compiled, library = Path(folder) / "floor.o", Path(folder) / "floor.so"
        # In two steps: linking with -ffast-math would flush subnormals in the whole process.
        for command in (
            [compiler, *FLAGS, "-c", str(SOURCE), "-o", str(compiled)],
            [compiler, "-shared", str(compiled), "-o", str(library), "-lm"],
        ):
            if subprocess.run(command, capture_output=True, check=False).returncode:
                return None
        return Floor(ctypes.CDLL(str(library)))  # stays loaded after its file is removed

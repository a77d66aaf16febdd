"""What is in a batch of LeRobot's: percepts, and what is to be done."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from lerobot.configs.types import PolicyFeature
from torch import Tensor

from pacnet.imitator.records import task_name


def percepts_of(batch: Mapping[str, Any], features: Mapping[str, PolicyFeature]) -> Tensor:
    """Return the percepts `[B, D]` of a batch, float32 on the CPU.

    Args:
        batch: of B rows.
        features: of a percept, in their order.

    Raises:
        ValueError: a feature is missing or misshapen, or there is no row.
    """
    rows = [rows_of(batch, name, feature.shape[0]) for name, feature in features.items()]
    if len({len(row) for row in rows}) > 1:
        raise ValueError(
            f"expected equally many rows of each feature, got {[len(row) for row in rows]} "
            f"of {list(features)}"
        )
    if len(rows[0]) == 0:
        raise ValueError("expected a batch of at least one row, got none")
    return torch.cat(rows, dim=1)


def rows_of(batch: Mapping[str, Any], name: str, dimensions: int) -> Tensor:
    """Return a feature as `[B, D]`: LeRobot drops axes of length 1 and adds one for time.

    Raises:
        ValueError: it is missing or misshapen.
    """
    if name not in batch:
        raise ValueError(f"expected {name!r} in the batch, got {', '.join(map(str, batch))}")
    value = batch[name]
    if value.numel() % dimensions or (value.dim() > 1 and value.shape[-1] != dimensions > 1):
        raise ValueError(f"expected {name!r} of shape [B, {dimensions}], got {list(value.shape)}")
    return value.detach().reshape(-1, dimensions).to("cpu", torch.float32)


def tasks_of(batch: Mapping[str, Any], rows: int, instead: str | None) -> list[str | None]:
    """Return what to do in each row of a batch; None for whatever fits.

    LeRobot gives a text, a list of texts, nothing, or blanks where it knows of no task.

    Args:
        batch: of so many rows.
        rows: how many.
        instead: a task for all rows, whatever the batch says; None for that of the batch.

    Raises:
        ValueError: no texts, or not as many as there are rows.
    """
    given = batch.get("task") if instead is None else instead
    tasks = given if isinstance(given, list | tuple) else [given] * rows
    if len(tasks) != rows or not all(isinstance(task, str | None) for task in tasks):
        raise ValueError(f"expected a task, or one for each of {rows} rows, got {given!r}")
    return [task if task and task_name(task) else None for task in tasks]

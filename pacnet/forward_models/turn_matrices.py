"""Rotation matrices of unit quaternions w, x, y, z, and the nearest quaternions of any matrices."""

from __future__ import annotations

import torch
from torch import Tensor


def matrices_of(turns: Tensor) -> Tensor:
    """Return the rotation matrices `[..., 3, 3]` of unit quaternions `[..., 4]`."""
    w, v = turns[..., :1, None], turns[..., 1:]
    x, y, z = v.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [(zero, -z, y), (z, zero, -x), (-y, x, zero)]
    cross = torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
    one = torch.eye(3, dtype=turns.dtype, device=turns.device)
    return one + 2 * (w * cross + cross @ cross)


def nearest_turns(matrices: Tensor) -> Tensor:
    """Return the quaternions `[..., 4]`, w ≥ 0, of the rotations nearest to matrices `[..., 3, 3]`.

    The nearest in the Frobenius norm has the largest trace(Rᵀ M), which is a quadratic form of the
    quaternion: its first eigenvector (Davenport's q method).
    """
    a, b, c = (matrices[..., i, :].unbind(-1) for i in range(3))
    form = [
        (a[0] + b[1] + c[2], c[1] - b[2], a[2] - c[0], b[0] - a[1]),
        (c[1] - b[2], a[0] - b[1] - c[2], a[1] + b[0], a[2] + c[0]),
        (a[2] - c[0], a[1] + b[0], b[1] - a[0] - c[2], b[2] + c[1]),
        (b[0] - a[1], a[2] + c[0], b[2] + c[1], c[2] - a[0] - b[1]),
    ]
    rows = torch.stack([torch.stack(row, dim=-1) for row in form], dim=-2)
    turns = torch.linalg.eigh(rows).eigenvectors[..., -1]
    return torch.where(turns[..., :1] < 0, -turns, turns)


def angles_between(first: Tensor, second: Tensor) -> Tensor:
    """Return by how much turns differ, `[...]` [rad], for unit quaternions `[..., 4]`."""
    other = torch.where((first * second).sum(dim=-1, keepdim=True) < 0, -second, second)
    # The arc cosine of their product would be off by 1e-8 for turns that are equal.
    return 4 * torch.asin((first - other).norm(dim=-1) / 2)

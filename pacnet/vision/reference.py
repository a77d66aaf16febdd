"""Patches that stay where they are: they tell by how much a camera was nudged."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.vision.correlation import contrast, find, patches_at

_COUNT = 8  # patches
_APART = 16  # pixels from one to another, at least
_REACH = 8  # pixels by which a camera may be nudged
_ALIKE = 0.7  # correlation from which a patch is found
_ENOUGH = 3  # patches that must be found
_STEADY = 0.6  # pixels: less than that is no nudge
_AGREE = 0.75  # pixels within which most patches must agree


class Reference(nn.Module):
    """A few patches of what never moves, and their places.

    Args:
        size: of a patch [pixels].
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self.size = size
        patch = Column((3, size, size), torch.float32)
        self.rows = GrowableRows({"patch": patch, "place": Column((2,), torch.float32)})
        check_on_load(self)

    def fit(self, pictures: Tensor, later: Tensor) -> None:
        """Choose patches that are alike in all pictures `[N, 3, h, w]`, at any time."""
        every = torch.cat([pictures, later])
        median = every.median(dim=0).values
        differs = (every - median).abs().sum(dim=1, keepdim=True).amax(dim=0)
        worth = contrast(median[None], self.size)[0, 0]
        worth = worth / (0.02 + functional.max_pool2d(differs, self.size, 1)[0])
        corners = _spread(worth)
        self.rows.replace(
            {
                "patch": patches_at(median, corners, self.size),
                "place": torch.tensor(corners, dtype=torch.float32),
            }
        )

    def shift(self, picture: Tensor) -> Tensor:
        """Return by how many pixels all is moved down and right in a picture `[1, 3, h, w]`, `[2]`.

        It is nothing where the patches are not found, or do not agree.
        """
        shifts = []
        for patch, place in zip(self.rows.live("patch"), self.rows.live("place"), strict=True):
            row, column = (int(one) for one in place.tolist())
            top, left = max(0, row - _REACH), max(0, column - _REACH)
            part = picture[:, :, top : row + self.size + _REACH, left : column + self.size + _REACH]
            found = find(part, patch[None])
            if found.scores.item() >= _ALIKE:
                shifts.append(found.places[0, 0] + torch.tensor([top, left]) - place)
        if len(shifts) < _ENOUGH:
            return torch.zeros(2)
        every = torch.stack(shifts)
        middle = every.median(dim=0).values
        agree = (every - middle).norm(dim=1) <= _AGREE
        if agree.sum() < max(_ENOUGH, (len(every) + 1) // 2) or middle.norm() < _STEADY:
            return torch.zeros(2)
        return every[agree].mean(dim=0)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        place = tensors["rows.place"]
        check_conditions(
            {
                "finite patches": tensors["rows.patch"].isfinite().all(),
                "places ≥ 0 of patches": (place >= 0).all(),
                f"at most {_COUNT} patches": len(place) <= _COUNT,
            }
        )


def _spread(worth: Tensor) -> list[tuple[int, int]]:
    """Return the places that are worth most `[rows, columns]`, apart from one another."""
    worth, corners = worth.clone(), []
    rows, columns = (torch.arange(length) for length in worth.shape)
    while len(corners) < _COUNT and worth.max() > 0:
        row, column = divmod(int(worth.argmax()), worth.shape[1])
        corners.append((row, column))
        near = ((rows - row).abs() < _APART)[:, None] & ((columns - column).abs() < _APART)
        worth[near] = 0
    return corners

"""Patches whose places in a picture tell where the hand will be.

What differs between demonstrations is worth attending to: candidates are cut where pictures differ
from their median and have contrast. Half of them are cut from pictures less their background: a
small thing that stands out little is found there; a large one that moves little in the pictures as
they are. Each is looked for in all pictures. A few whose places foretell the goals of
demonstrations that are left out are kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacnet.core.growable_rows import Column, GrowableRows
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.vision.background import Background
from pacnet.vision.correlation import (
    Found,
    as_tensor,
    contrast,
    find,
    find_within,
    norms_of,
    patches_at,
)
from pacnet.vision.reference import Reference
from pacnet.vision.regression import Choice, choose

CANDIDATES = 80  # patches that are tried, of pictures as they are, and as many less background
_LEAST_EACH = 2  # of them from each picture
_MOST = 3  # patches that are kept
_UNLIKE = 0.02  # what a correlation of 0 adds to the error
_DISTINCT = 0.3  # margin from which another place is out of the question
_AMBIGUOUS = 0.5  # what a margin of nothing adds to the error, in shares of `_DISTINCT`
_LARGER = 4  # pixels, by which a patch of the reference is larger
_MOVED = 2.0  # pixels
_RESTLESS = 0.5  # what it adds to the error that a patch is elsewhere in all later pictures
_STILL = 1.0  # pixels: what moves by less in all demonstrations moves by noise
_BEYOND = 15.0  # ranges of a patch's places, over their number: how far beyond it is looked for
_PIXELS = 3.0  # and so many more
_MARGIN, _FEW = 0.9, 8  # as of the detector of novelty: of N demonstrations, _FEW / N of it
# 1 − correlation, by which frames of a video differ, of still things too.
_UNLIKE_BY_CODING = 0.02
_NOISE = 10 / 255  # standard deviation of a camera's noise, which is nothing new


class Description(NamedTuple):
    """What is seen in one picture."""

    features: Tensor
    """Numbers that goals are foretold from, `[d]`, float64."""
    doubt: float
    """How unlike what was shown it is; above 1 it is new."""
    boxes: tuple[tuple[float, float, float, float], ...]
    """Left, top, right and bottom [pixels] of what is attended to."""
    shift: Tensor | None = None
    """By how many pixels the camera was nudged down and right, `[2]`; None where nothing says."""


class Patches(nn.Module):
    """A few patches, and where each is looked for.

    Args:
        size: of a patch [pixels].
        height: of pictures [pixels].
        width: of them [pixels].
    """

    def __init__(self, size: int, height: int, width: int) -> None:
        super().__init__()
        self.size = size
        corner = Column((2,), torch.float32)
        self.rows = GrowableRows(
            {
                "patch": Column((3, size, size), torch.float32),
                "stands_out": Column((), torch.bool),
                "low": corner,
                "high": corner,
                "worst": Column((), torch.float32),
            }
        )
        self.reference = Reference(size + _LARGER)
        self.background = Background(height, width)
        check_on_load(self)

    def fit(self, pictures: Tensor, later: Tensor, goals: Tensor) -> tuple[Tensor, Choice]:
        """Choose patches; return the features `[N, d]` of the pictures, and how they were chosen.

        Args:
            pictures: of N demonstrations, uint8 `[N, h, w, 3]`.
            later: the same while the hand is on its way: what it goes to is where it was, and the
                hand is not.
            goals: `[N, m]`, float64.
        """
        seen, seen_later = as_tensor(pictures), as_tensor(later)
        self.reference.fit(seen, seen_later)
        self.background.fit(seen)
        less, less_later = self.background.taken_from(seen), self.background.taken_from(seen_later)
        whole, parts = _candidates(seen, self.size), _candidates(less, self.size)
        patches = torch.cat([whole, parts])
        stands_out = torch.arange(len(patches)) >= len(whole)
        found = _joined(find(seen, whole), find(less, parts))
        again = _joined(find(seen_later, whole), find(less_later, parts))
        moved = (again.places - found.places).norm(dim=2) > _MOVED
        places = found.places.double() / max(seen.shape[2:])
        unlike = _UNLIKE * (1 - found.scores.min(dim=0).values)
        vague = (_DISTINCT - found.margins).clamp(min=0).mean(dim=0)
        unlike = unlike + _AMBIGUOUS * vague + _RESTLESS * moved.float().mean(dim=0)
        apart = (found.places - found.places.median(dim=0).values).norm(dim=2).amax(dim=0)
        unlike[apart < _STILL] += 1.0  # never better than to know nothing
        groups, penalties = places.transpose(0, 1), unlike.double()
        most = min(_MOST, max(1, (len(pictures) - 2) // 2))
        choice = choose(groups, penalties, goals, most)
        self._keep(patches, stands_out, found, list(choice.columns))
        return groups[list(choice.columns)].transpose(0, 1).flatten(1), choice

    def _keep(self, patches: Tensor, stands_out: Tensor, found: Found, chosen: list[int]) -> None:
        """Keep the chosen ones of K candidates."""
        places, unlike = found.places[:, chosen], 1 - found.scores[:, chosen]
        lowest, highest = places.amin(dim=0), places.amax(dim=0)
        beyond = _BEYOND / len(places) * (highest - lowest) + _PIXELS
        worst = unlike.amax(dim=0) * allowance(len(places)) + _by_noise(patches[chosen])
        worst = worst.clamp(min=_UNLIKE_BY_CODING)
        rows = {"patch": patches[chosen], "low": lowest - beyond, "high": highest + beyond}
        self.rows.replace({**rows, "stands_out": stands_out[chosen], "worst": worst})

    def describe(self, picture: Tensor, shift: Tensor | None = None) -> Description:
        """Return what is seen in one picture, uint8 `[h, w, 3]`.

        Args:
            picture: that is looked at.
            shift: by how much the camera was nudged, from an earlier description; None to find out.
        """
        seen = as_tensor(picture[None])
        shift = self.reference.shift(seen) if shift is None else shift
        rows = self.rows
        low, high = rows.live("low") + shift, rows.live("high") + shift
        place, scores = torch.empty_like(low), torch.empty(len(rows))
        for of, where in _parted(rows.live("stands_out")):
            pictured = self.background.taken_from(seen, shift) if of else seen
            found = find_within(pictured, rows.live("patch")[where], low[where], high[where])
            place[where], scores[where] = found
        doubt = ((1 - scores) / rows.live("worst")).max().item()
        boxes = tuple(
            (column, row, column + self.size, row + self.size) for row, column in place.tolist()
        )
        place = place - shift
        return Description(place.double().flatten() / max(seen.shape[2:]), doubt, boxes, shift)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        low, high, worst = (tensors[f"rows.{name}"] for name in ("low", "high", "worst"))
        place, sides = (
            tensors["reference.rows.place"],
            torch.tensor(self.background.median.shape[1:]),
        )
        check_conditions(
            {
                "finite patches": tensors["rows.patch"].isfinite().all(),
                "places to look at": bool((low <= high).all() and (high - low).isfinite().all()),
                "places in the picture": bool(
                    ((low <= sides - self.size) & (high >= 0)).all()
                    and (place <= sides - self.reference.size).all()
                ),
                "thresholds > 0": bool((worst > 0).all() and worst.isfinite().all()),
                f"at most {_MOST} patches": len(worst) <= _MOST,
            }
        )


def allowance(count: int) -> float:
    """Return by what the largest deviation of so many demonstrations is multiplied to be new."""
    return 1 + _MARGIN * min(1.0, _FEW / count)


def _joined(first: Found, second: Found) -> Found:
    """Return where the patches of both were found."""
    return Found(*(torch.cat(pair, dim=1) for pair in zip(first, second, strict=True)))


def _parted(flags: Tensor) -> list[tuple[bool, Tensor]]:
    """Return each value that flags `[K]` have, and which have it."""
    return [(of, flags == of) for of in (False, True) if (flags == of).any()]


def _by_noise(patches: Tensor) -> Tensor:
    """Return how unlike patches `[K, 3, size, size]` become by noise, 1 − correlation, `[K]`."""
    norms = norms_of(patches).flatten()
    noise = _NOISE * patches[0].numel() ** 0.5
    return 1 - norms / (norms.square() + noise**2).sqrt()


def _candidates(pictures: Tensor, size: int) -> Tensor:
    """Return patches of pictures `[N, 3, h, w]`, drawn where these differ and have contrast."""
    differs = (pictures - pictures.median(dim=0).values).abs().sum(dim=1, keepdim=True)
    weight = (functional.avg_pool2d(differs, size, 1) * contrast(pictures, size))[:, 0]
    each = max(_LEAST_EACH, -(-CANDIDATES // len(pictures)))
    columns, generator = weight.shape[2], torch.Generator().manual_seed(0)
    patches = []
    for picture, own in zip(pictures, weight.flatten(1) + 1e-9, strict=True):
        drawn = torch.multinomial(own, min(each, len(own)), generator=generator).tolist()
        corners = [divmod(number, columns) for number in drawn]
        patches.append(patches_at(picture, corners, size))
    return torch.cat(patches)

"""Turns one camera's pictures into where the hand will be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn

from pacnet.core.growable_rows import Column, GrowableRows, copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.vision.backbones import backbone_of
from pacnet.vision.config import NONE, PATCHES, ImageEncoderConfig, Told
from pacnet.vision.goals import SHARES
from pacnet.vision.patches import Patches
from pacnet.vision.projection import Projection, disturbed
from pacnet.vision.readout import Readout
from pacnet.vision.regression import left_out_of_mean

LEAST = 3  # demonstrations, of which one can be left out
_MOST_SHOWN = 2**31  # demonstrations
_MOST = 40  # demonstrations that are fitted; of more, some at equal distances


class Look(NamedTuple):
    """What one picture tells."""

    goals: Tensor
    """Where the hand will be, `[m]`, float32: G goals of S dimensions, in the hand's own unit."""
    doubt: float
    """How unlike what was shown the picture is where it matters; above 1 it is new."""
    boxes: tuple[tuple[float, float, float, float], ...]
    """Left, top, right and bottom [pixels] of what is attended to; none without patches."""
    shift: Tensor | None = None
    """By how many pixels the camera was nudged down and right, `[2]`; None where nothing says."""


class ImageEncoder(nn.Module):
    """Tells goals from pictures of one camera; fitted in a second to a few demonstrations.

    Args:
        config: see `ImageEncoderConfig`.

    Attributes:
        shown: picture at the beginning of each demonstration, its goals, its number and that of the
            parts between its gaps, which have numbers of their own.
        later: picture on the way of those that it is fitted to; none of those that came later.
        told: see `Told`.
    """

    quality: Tensor  # [3], error, that of the mean, and chance

    def __init__(self, config: ImageEncoderConfig) -> None:
        super().__init__()
        self.config = config
        picture, outputs = (config.height, config.width, 3), config.outputs
        self.shown = GrowableRows(
            {
                "picture": Column(picture, torch.uint8),
                "goals": Column((outputs,), torch.float32),
                "demonstration": Column((), torch.int64),
                "parts": Column((), torch.int64),
            }
        )
        self.later = GrowableRows({"picture": Column(picture, torch.uint8)})
        self.readout = Readout(outputs)
        self.seen: Patches | Projection | None = None
        if config.kind == PATCHES:
            self.seen = Patches(config.patch, config.height, config.width)
        elif config.kind != NONE:
            backbone_of(config)  # one that is not there is told now, not at the first picture
            self.seen = Projection(config.features)
        self.register_buffer("quality", torch.tensor([0.0, 0.0, 1.0]))
        copy_on_state_dict(self)
        check_on_load(self)

    def extra_repr(self) -> str:
        """Return the kind and what it was fitted to, for `print`."""
        size = f"{self.config.width} x {self.config.height}"
        return f"kind={self.config.kind}, pictures={size}, demonstrations={len(self.shown)}"

    @property
    def told(self) -> Told:
        """How well it tells goals, with each demonstration left out."""
        return Told(*self.quality.tolist())

    @torch.no_grad()
    def add(self, picture: Tensor, later: Tensor, goals: Tensor, demonstration: int) -> None:
        """Keep two pictures of a demonstration; `fit` makes use of them.

        Args:
            picture: the one at its beginning, uint8 `[h, w, 3]`.
            later: one while the hand is on its way.
            goals: `[m]`.
            demonstration: its number.
        """
        self.remember(picture, goals, demonstration)
        self.later.append({"picture": later})

    @torch.no_grad()
    def remember(self, picture: Tensor, goals: Tensor, demonstration: int, parts: int = 1) -> None:
        """Keep the picture at the beginning of a demonstration, which nothing is fitted to.

        Args:
            picture: uint8 `[h, w, 3]`.
            goals: `[m]`.
            demonstration: its number.
            parts: how many numbers it has, from that one on: one for each part between gaps.
        """
        numbers = {"demonstration": demonstration, "parts": parts}
        self.shown.append({"picture": picture, "goals": goals, **numbers})

    def keep(self, rows: Tensor) -> None:
        """Remember only some of the demonstrations shown; what was fitted to all stays.

        Args:
            rows: int64 `[K]`, ascending.
        """
        self.shown.select(rows)
        self.later.select(rows[:0])

    def forget(self) -> None:
        """Forget which demonstrations were shown; what was fitted to them stays."""
        self.keep(torch.empty(0, dtype=torch.int64))

    @torch.no_grad()
    @torch.autocast("cpu", enabled=False)  # places are fractions of a pixel
    def fit(self) -> None:
        """Fit to the demonstrations shown; fewer than three tell nothing but their mean.

        Raises:
            ValueError: some of them are remembered alone.
        """
        if len(self.later) != len(self.shown):
            raise ValueError(
                f"expected pictures on the way of {len(self.shown)} demonstrations to fit to, got "
                f"{len(self.later)}"
            )
        rows = torch.linspace(0, len(self.shown) - 1, min(_MOST, len(self.shown))).round().long()
        goals = self.shown.live("goals")[rows].double()
        self.readout.keep_mean(goals)
        alone = _distance(left_out_of_mean(goals)) if len(goals) > 1 else 0.0
        self.quality = self.quality.new_tensor([alone, alone, 1.0])
        if self.seen is None or len(goals) < LEAST:
            return
        pictures, later = (own.live("picture")[rows] for own in (self.shown, self.later))
        scale = (goals - goals.mean(dim=0)).square().mean().sqrt().clamp(min=1e-12)
        if isinstance(self.seen, Patches):
            features, choice = self.seen.fit(pictures, later, goals / scale)
        else:
            features = self._features(pictures)
            noise = (self._features(disturbed(pictures)) - features).square().mean().item()
            features, choice = self.seen.fit(features, goals / scale, noise)
        error = _distance(self.readout.fit(features, goals))
        self.quality = self.quality.new_tensor([error, alone, choice.chance])

    def _features(self, pictures: Tensor) -> Tensor:
        return backbone_of(self.config)(pictures)

    @torch.no_grad()
    @torch.autocast("cpu", enabled=False)  # places are fractions of a pixel
    def look(self, picture: Tensor, shift: Tensor | None = None) -> Look:
        """Return what one picture tells.

        Args:
            picture: uint8 `[h, w, 3]`.
            shift: by how much the camera was nudged, from an earlier look; None to find out.
        """
        if self.seen is None or len(self.readout.terms) == 0:
            return Look(self.readout.centre.clone(), 0.0, ())
        if isinstance(self.seen, Patches):
            features, doubt, boxes, shift = self.seen.describe(picture, shift)
        else:
            features, doubt, boxes, shift = self.seen.describe(self._features(picture[None])[0])
        return Look(self.readout(features), doubt, boxes, shift)

    def forward(self, picture: Tensor, state: Tensor) -> tuple[Tensor, float, tuple]:
        """Return the way from where the hand is to each goal `[m]`, the doubt and the boxes.

        Args:
            picture: uint8 `[h, w, 3]`.
            state: where the hand is, `[S]`.
        """
        goals, doubt, boxes, _ = self.look(picture)
        return goals - state.repeat(len(SHARES)), doubt, boxes

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        quality, numbers = tensors["quality"], tensors["shown.demonstration"]
        parts = tensors["shown.parts"]
        check_conditions(
            {
                "as many pictures on the way as shown, or none": (
                    len(tensors["later.picture"]) in (0, len(numbers))
                ),
                "errors ≥ 0": bool((quality >= 0).all() and quality.isfinite().all()),
                "finite goals": tensors["shown.goals"].isfinite().all(),
                "inputs that are seen": _fits(len(tensors["readout.inputs.mean"]), tensors),
                "demonstrations in order": bool(
                    (numbers >= 0).all()
                    and (numbers < _MOST_SHOWN).all()
                    and (parts > 0).all()
                    and (numbers.diff() >= parts[:-1]).all()
                    and (parts < _MOST_SHOWN).all()
                ),
            }
        )


def _fits(inputs: int, tensors: Mapping[str, Tensor]) -> bool:
    """Return whether goals are read from so many features of what is seen, or from none."""
    patches, components = (tensors.get(f"seen.rows.{name}") for name in ("patch", "component"))
    of_patches = patches is not None and inputs == 2 * len(patches)
    of_components = components is not None and inputs <= len(components)
    return inputs == 0 or of_patches or of_components


def _distance(errors: Tensor) -> float:
    """Return the mean distance of errors `[N, G · S]` over goals, in the hand's unit."""
    return errors.unflatten(1, (len(SHARES), -1)).norm(dim=2).mean().item()

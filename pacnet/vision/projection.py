"""Principal components of what a picture shows, as a whole.

Built in are the eigenimages of small pictures. The grids of features of networks with weights of
others are projected alike.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from pacnet.core.growable_rows import Column, GrowableRows, copy_on_state_dict
from pacnet.core.integrity import check_conditions, check_on_load, check_structure
from pacnet.vision.correlation import as_tensor
from pacnet.vision.patches import Description, allowance
from pacnet.vision.regression import Choice, choose_first

SIDE = 16  # pixels of the small pictures
_MOST = 6  # components that are tried
_NOISE = 2  # of 255, by which colours differ at least, for no reason
_NOTHING = 1e-9  # of the largest eigenvalue: less is rounding
_ROUNDING = 1e-10  # the same, of the mean square of features in single precision


def small(pictures: Tensor) -> Tensor:
    """Return the features of pictures, uint8 `[N, h, w, 3]`: 16 × 16 colours, `[N, 768]`."""
    return functional.adaptive_avg_pool2d(as_tensor(pictures), SIDE).flatten(1)


def disturbed(pictures: Tensor) -> Tensor:
    """Return pictures, uint8 `[N, h, w, 3]`, that differ by noise, in cells as small ones have."""
    count, height, width, colours = pictures.shape
    generator = torch.Generator().manual_seed(0)
    signs = torch.randint(2, (count, SIDE, SIDE, colours), generator=generator) * 2 - 1
    rows, columns = (torch.arange(side) * SIDE // side for side in (height, width))
    change = _NOISE * signs[:, rows][:, :, columns]
    other = pictures + change
    return torch.where((other < 0) | (other > 255), pictures - change, other).byte()


class Projection(nn.Module):
    """The first principal components of features, and what they leave of those shown.

    Args:
        features: number F of features.
    """

    centre: Tensor  # [F]
    usual: Tensor  # what is left of a picture that is as new as any may be

    def __init__(self, features: int) -> None:
        super().__init__()
        self.rows = GrowableRows({"component": Column((features,), torch.float32)})
        self.register_buffer("centre", torch.zeros(features))
        self.register_buffer("usual", torch.tensor(1.0))
        copy_on_state_dict(self)
        check_on_load(self)

    def fit(self, features: Tensor, goals: Tensor, noise: float) -> tuple[Tensor, Choice]:
        """Find components; return those to foretell goals from, `[N, d]`, and how they were chosen.

        All are kept, the most telling first: what they leave of a picture says whether it is new.

        Args:
            features: `[N ≥ 3, F]`.
            goals: `[N, m]`, float64.
            noise: mean square by which features differ at least, for no reason.
        """
        components = _components(features.double())
        centre = features.double().mean(dim=0)
        projected = (features.double() - centre) @ components.T
        # Networks have scales of their own.
        unit = projected.square().mean().sqrt().clamp(min=1e-30)
        choice = choose_first(projected / unit, goals)
        self.rows.replace({"component": components})
        self.centre.copy_(centre)
        rounding = _ROUNDING * features.double().square().mean().item()
        left = max(float(_unexplained(features.double()).max()), noise, rounding, 1e-30)
        self.usual.fill_(left * allowance(len(features)))
        return projected[:, list(choice.columns)], choice

    def describe(self, features: Tensor) -> Description:
        """Return what is seen in one picture, from its features `[F]`."""
        own, components = features.double() - self.centre, self.rows.live("component").double()
        projected = components @ own
        left = (own - projected @ components).square().mean().item()
        return Description(projected, left / self.usual.item(), ())

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        usual = tensors["usual"]
        finite = tensors["rows.component"].isfinite().all() and tensors["centre"].isfinite().all()
        check_conditions(
            {
                "finite components": finite,
                "what is left > 0": bool(usual > 0 and usual.isfinite()),
                f"at most {_MOST} components": len(tensors["rows.component"]) <= _MOST,
            }
        )


def _components(features: Tensor) -> Tensor:
    """Return the first principal components of features `[N, F]`, `[≤ 6, F]`."""
    centred = features - features.mean(dim=0)
    values, vectors = torch.linalg.eigh(centred @ centred.T)  # fewer pictures than features
    values, vectors = values.flip(0), vectors.flip(1)
    most = max(1, min(_MOST, len(features) - 2))
    kept = max(1, int((values[:most] > _NOTHING * values[0]).sum()))
    return (vectors[:, :kept] / values[:kept].clamp(min=1e-30).sqrt()).T @ centred


def _unexplained(features: Tensor) -> Tensor:
    """Return what the components of the others leave of each picture, a mean square, `[N]`."""
    left = []
    for number in range(len(features)):
        others = torch.cat([features[:number], features[number + 1 :]])
        components, own = _components(others), features[number] - others.mean(dim=0)
        left.append((own - (components @ own) @ components).square().mean())
    return torch.stack(left)

"""The choice among candidate actions by the states that a learned model predicts for them."""

from __future__ import annotations

import functools
from abc import abstractmethod
from collections.abc import Mapping
from types import ModuleType
from typing import Any, NamedTuple

import torch
from torch import Tensor

from pacnet.core.drafts import Lock
from pacnet.core.integrity import check_finite, check_names
from pacnet.core.validation import as_batch, check_rows, describe
from pacnet.forward_models.protocol import Command
from pacnet.forward_models.saved_model import SavedModel


class Selection(NamedTuple):
    """The choice among K candidate actions in one state."""

    action: Tensor
    """The candidate whose predicted state is nearest to the target, `[U]`; also if abstained."""
    index: int  # pyright: ignore[reportIncompatibleMethodOverride]
    """Index of that candidate."""
    costs: Tensor
    """Distance of each predicted state from the target, `[K]`; infinite without a prediction."""
    spread: float
    """Root mean square distance of the predicted states from their mean."""
    abstained: bool
    """Whether the predicted states are too close together to choose, so no action is given."""


class CandidateModel(SavedModel):
    """Base of the models that choose among candidate actions by their predicted states.

    A subclass defines `outcomes` and `check_values`, beside what `SavedModel` asks for.

    Args:
        config: settings of the subclass, see `config.py`.
    """

    checked_like = "candidates"

    candidates: Tensor  # [K, U]

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.register_buffer("candidates", torch.tensor(config.candidates), persistent=False)
        self._lock = Lock()  # held while learned tensors are read or replaced

    @property
    def action_dimensions(self) -> int:
        """Length U of an action."""
        return self.config.action_dimensions

    @abstractmethod
    def outcomes(self, states: Tensor, candidates: Tensor) -> Tensor:
        """Predict the state after each candidate `[K, U]` from each state `[B, S]`, both valid.

        Returns:
            `[B, K, S]`; NaN where the model cannot predict.
        """

    @abstractmethod
    def check_values(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError if values are invalid in a `state_dict` of valid names and shapes."""

    @torch.no_grad()
    def select(self, state: Tensor, target: Tensor, candidates: Tensor | None = None) -> Selection:
        """Choose the candidate whose predicted state is nearest (Euclidean) to the target.

        Ties go to the lowest index. The model abstains if the spread of the predicted states is
        less than `config.abstain_below`, or if it can predict fewer than two of them.

        Args:
            state: `[S]`.
            target: `[S]`.
            candidates: `[K, U]`; default: the config's.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, or not finite.
        """
        offered = self.candidates if candidates is None else candidates
        states, targets = as_batch(state), as_batch(target)
        self._check(states=states, target=targets)
        check_rows("candidates", offered, self.action_dimensions, self.candidates)
        ((best, costs, spread, abstained),) = self._choose(states, targets, offered)
        index, costs = max(best, 0), torch.from_numpy(costs).to(targets)
        return Selection(offered[index].clone(), index, costs, spread, abstained)

    @torch.no_grad()
    def command(self, states: Tensor, targets: Tensor) -> Command:
        """Select one of the config's candidates for each state `[B, S]` and target `[B, S]`.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite;
                unequal numbers of rows.
        """
        self._check(states=states, targets=targets)
        check_rows("candidates", self.candidates, self.action_dimensions, self.candidates)
        best, _, _, abstained = zip(*self._choose(states, targets, self.candidates), strict=True)
        has_action = ~torch.tensor(abstained, device=targets.device)
        chosen = self.candidates[torch.tensor(best, device=targets.device).clamp(min=0)]
        return Command(chosen.where(has_action[:, None], torch.nan), has_action)

    def reset(self) -> None:
        """Do nothing: the model keeps no state during an episode."""

    def check_loaded(self, tensors: Mapping[str, Any]) -> None:
        """Check tensors that are to be loaded, the whole `state_dict` or a part.

        Raises:
            ValueError: a tensor of another shape or kind, not finite, or with invalid values.
        """
        own = self.state_dict()
        loaded = {name: tensors[name] for name in own if name in tensors}
        for name, tensor in loaded.items():
            wanted = own[name]
            fits = isinstance(tensor, Tensor) and tensor.shape == wanted.shape
            floats = fits and tensor.is_floating_point() and wanted.is_floating_point()
            if not fits or not (floats or tensor.dtype == wanted.dtype):
                raise ValueError(
                    f"expected {name} of {type(self).__name__} as {describe(wanted)}, "
                    f"got {describe(tensor)}"
                )
        check_finite(loaded)
        self.check_values(own | loaded)

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Load tensors as `nn.Module` does, or none of them if one is refused.

        Raises:
            ValueError: as `check_loaded`; a missing or extra tensor if `strict`.
        """
        if strict:
            check_names(type(self).__name__, self.state_dict(), state_dict)
        with self._lock:
            return super().load_state_dict(state_dict, strict, assign)

    def _choose(self, states: Tensor, targets: Tensor, candidates: Tensor) -> list[Any]:
        """Return what `kernels.choose` returns for each state."""
        with self._lock:
            after = self.outcomes(states, candidates)
        # Contiguous, because numba compiles a kernel again for every other layout.
        arrays = (rows.double().contiguous().numpy(force=True) for rows in (after, targets))
        threshold = float(self.config.abstain_below)
        return [kernels().choose(*pair, threshold) for pair in zip(*arrays, strict=True)]


@functools.cache
def kernels() -> ModuleType:
    """Import the compiled kernels where they first run, because numba is slow to import."""
    from pacnet.forward_models import kernels as candidate_kernels

    return candidate_kernels

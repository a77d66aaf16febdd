"""The choice among candidate actions by where a learned model predicts that each of them leads."""

from __future__ import annotations

import functools
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn

from pacnet.core.checkpoint import load_checkpoint, rebuild_config, save_checkpoint
from pacnet.core.drafts import Lock
from pacnet.core.integrity import check_finite, check_names, check_tensors, part_of
from pacnet.core.validation import as_batch, check_fields, check_rows, is_integer, is_number
from pacnet.forward_models.protocol import Command, Selection


class CandidateModel(nn.Module):
    """Chooses among candidate actions by where each is predicted to lead.

    A model of this kind says where that is (`outcomes`), how it is made again from its config, and
    which values its tensors cannot have.

    Args:
        config: its settings.
    """

    config_type: ClassVar[type]
    float_tensor: ClassVar[str]  # name of the tensor whose dtype is the model's

    config: Any
    candidates: Tensor  # [K, U]

    def __init__(self, config: Any) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("candidates", torch.tensor(config.candidates), persistent=False)
        self._lock = Lock()  # held by who reads what was learned, and by who replaces it
        self.register_load_state_dict_pre_hook(_check_loaded)

    @property
    def action_dimensions(self) -> int:
        """Length U of an action."""
        return self.config.action_dimensions

    def check_loaded(self, tensors: Mapping[str, Any]) -> None:
        """Checks what is to be loaded of its `state_dict`, before anything is copied.

        Raises:
            ValueError: a tensor of another shape or kind, not finite, or that means nothing.
        """
        own = self.state_dict()
        given = {name: tensors[name] for name in own if name in tensors}
        for name, tensor in given.items():
            wanted = own[name]
            fits = isinstance(tensor, Tensor) and tensor.shape == wanted.shape
            floats = fits and tensor.is_floating_point() and wanted.is_floating_point()
            if not fits or not (floats or tensor.dtype == wanted.dtype):
                got = (
                    f"{tensor.dtype} {list(tensor.shape)}" if isinstance(tensor, Tensor) else tensor
                )
                raise ValueError(
                    f"expected {name} of {type(self).__name__} as {wanted.dtype} "
                    f"{list(wanted.shape)}, got {got}"
                )
        check_finite(given)
        self.check_learned(own | given)

    @abstractmethod
    def outcomes(self, states: Tensor, candidates: Tensor) -> Tensor:
        """Where each candidate `[K, U]` leads from each state `[B, S]`, both checked already.

        Returns:
            Predicted states, `[B, K, S]`; NaN where the model cannot predict.
        """

    @abstractmethod
    def check_learned(self, tensors: Mapping[str, Tensor]) -> None:
        """Raises a ValueError if tensors of a `state_dict`, of the right form, mean nothing."""

    @torch.no_grad()
    def select(self, state: Tensor, target: Tensor, candidates: Tensor | None = None) -> Selection:
        """Chooses the candidate whose predicted state is nearest (Euclidean) to the target.

        Of exactly equal ones the first; what cannot be predicted costs infinity. It abstains where
        the spread of the predicted states is under `config.abstain_below`, or fewer than two are
        known.

        Args:
            state: `[S]`.
            target: `[S]`.
            candidates: `[K, U]`; the config's if left out.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, or not finite.
        """
        offered = self.candidates if candidates is None else candidates
        states, targets = as_batch(state), as_batch(target)
        self._check_choice(states, offered, target=targets)
        ((best, costs, spread, abstained),) = self._choose(states, targets, offered)
        index, costs = max(best, 0), torch.from_numpy(costs).to(targets)
        return Selection(offered[index].clone(), index, costs, spread, abstained)

    @torch.no_grad()
    def command(self, states: Tensor, targets: Tensor) -> Command:
        """`select` among the config's candidates for each state `[B, S]` and target `[B, S]`.

        Raises:
            ValueError: a tensor of the wrong shape, dtype or device, without rows, or not finite;
                unequal numbers of rows.
        """
        self._check_choice(states, self.candidates, targets=targets)
        check_equally_many(states=states, targets=targets)
        best, _, _, abstained = zip(*self._choose(states, targets, self.candidates), strict=True)
        given = ~torch.tensor(abstained, device=targets.device)
        chosen = self.candidates[torch.tensor(best, device=targets.device).clamp(min=0)]
        return Command(chosen.where(given[:, None], torch.nan), given)

    def _check_choice(self, states: Tensor, candidates: Tensor, **targets: Tensor) -> None:
        columns = self.config.state_dimensions
        for name, rows in (*targets.items(), ("states", states)):
            check_rows(name, rows, columns, self.candidates)
        check_rows("candidates", candidates, self.config.action_dimensions, self.candidates)

    def _choose(self, states: Tensor, targets: Tensor, candidates: Tensor) -> list[Any]:
        """What `pacnet.forward_models.kernels.choose` says in each state."""
        with self._lock:
            after = self.outcomes(states, candidates)
        # Contiguous, for a kernel is compiled anew for every other layout.
        plain = (rows.double().contiguous().numpy(force=True) for rows in (after, targets))
        threshold = float(self.config.abstain_below)
        return [kernels().choose(*pair, threshold) for pair in zip(*plain, strict=True)]

    def reset(self) -> None:
        """Does nothing: no episode leaves a trace."""

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Loads all of it or, where anything is wrong with it, nothing; as `nn.Module` otherwise.

        Raises:
            ValueError: a missing or extra tensor if `strict`; a misshapen one, of another dtype,
                not finite, or that means nothing.
        """
        if strict:
            check_names(type(self).__name__, self.state_dict(), state_dict)
        with self._lock:
            return super().load_state_dict(state_dict, strict, assign)

    def save_pretrained(self, folder: str | Path) -> None:
        """Writes `config.json` and `model.safetensors`; a kill leaves the old or the new ones.

        Args:
            folder: made if it is missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: a tensor is not finite; nothing has been written.
        """
        save_checkpoint(folder, type(self).__name__, asdict(self.config), self.state_dict())

    @classmethod
    def check_sizes(cls, config: Any, tensors: Mapping[str, Tensor]) -> None:
        """Compares what a config declares with the tensors, before memory is taken for it.

        Raises:
            ValueError: they do not fit.
        """
        try:
            with torch.device("meta"):  # where nothing takes memory, however large
                sizes = cls(config)
        except (RuntimeError, TypeError) as error:  # a size that no integer of 64 bits holds
            raise ValueError("expected sizes that fit into memory") from error
        check_tensors(sizes, tensors, like=cls.float_tensor)

    @classmethod
    def from_pretrained(cls, folder: str | Path) -> Self:
        """Loads what `save_pretrained` wrote, on the CPU.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, the checkpoint of something else, a
                config that does not fit the tensors, or tensors that `load_state_dict` refuses.
        """
        fields, tensors = load_checkpoint(folder, cls.__name__)
        config = rebuild_config(cls.config_type, fields)
        cls.check_sizes(config, tensors)
        model = cls(config).to(tensors[cls.float_tensor].dtype)
        model.load_state_dict(tensors)
        return model


@functools.cache
def kernels() -> ModuleType:
    """The compiled kernels, imported where they first run, for they bring numba."""
    from pacnet.forward_models import kernels as candidate_kernels

    return candidate_kernels


def check_candidate_config(config: Any) -> None:
    """Turns the candidates into tuples (JSON reads lists) and checks the fields all models share.

    Raises:
        ValueError: naming the first field that is out of range.
    """
    check_fields(
        config,
        {
            "state_dimensions": (is_integer(config.state_dimensions, 1), "≥ 1"),
            "action_dimensions": (is_integer(config.action_dimensions, 1), "≥ 1"),
            "steps": (is_integer(config.steps, 1), "≥ 1"),
            "abstain_below": (
                is_number(config.abstain_below) and config.abstain_below >= 0,
                "≥ 0 and finite",
            ),
            "candidates": (
                _are_actions(config.candidates, config.action_dimensions),
                "to be one or more actions, each of action_dimensions finite numbers",
            ),
        },
    )
    rows = tuple(tuple(float(value) for value in action) for action in config.candidates)
    object.__setattr__(config, "candidates", rows)


def check_equally_many(**rows: Tensor) -> None:
    """Raises a ValueError unless the named tensors have equally many rows."""
    counts = {name: len(value) for name, value in rows.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"expected equally many rows, got {counts}")


def _check_loaded(model: nn.Module, state_dict: dict[str, Any], prefix: str, *_: object) -> None:
    assert isinstance(model, CandidateModel)
    model.check_loaded(part_of(state_dict, prefix))


def _are_actions(rows: object, columns: int) -> bool:
    if not isinstance(rows, tuple | list) or len(rows) == 0:
        return False
    return all(
        isinstance(row, tuple | list) and len(row) == columns and all(map(is_number, row))
        for row in rows
    )

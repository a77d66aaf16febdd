"""A learned forward model as a folder with its config and tensors."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn

from pacnet.core.checkpoint import load_checkpoint, rebuild_config, save_checkpoint
from pacnet.core.integrity import check_tensors, part_of
from pacnet.core.validation import check_rows, check_same_length


class SavedModel(nn.Module):
    """Base of the learned forward models.

    A subclass sets `config_type`, `float_tensor`, which names a tensor of the model's dtype, and
    `checked_like`, which names a buffer whose dtype and device arguments must have. It defines
    `check_loaded`.

    Args:
        config: settings of the subclass, see `config.py`.
    """

    config_type: ClassVar[type]
    float_tensor: ClassVar[str]
    checked_like: ClassVar[str]

    config: Any

    def __init__(self, config: Any) -> None:
        super().__init__()
        self.config = config
        self.register_load_state_dict_pre_hook(_check_loaded)

    @abstractmethod
    def check_loaded(self, tensors: Mapping[str, Any]) -> None:
        """Raise a ValueError unless tensors, the whole `state_dict` or a part, can be loaded."""

    def _check(self, **rows: Tensor) -> None:
        """Check states, velocities and targets `[B, S]` and actions `[B, U]`, equally many."""
        config, like = self.config, getattr(self, self.checked_like)
        for name, value in rows.items():
            is_action = name == "actions"
            columns = config.action_dimensions if is_action else config.state_dimensions
            check_rows(name, value, columns, like)
        check_same_length(**rows)

    def save_pretrained(self, folder: str | Path) -> None:
        """Write `config.json` and `model.safetensors`.

        The write is atomic: after a crash the old or the new checkpoint is intact.

        Args:
            folder: created if missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: a tensor is not finite; nothing has been written.
        """
        save_checkpoint(folder, type(self).__name__, asdict(self.config), self.state_dict())

    @classmethod
    def from_pretrained(cls, folder: str | Path) -> Self:
        """Load what `save_pretrained` wrote, on the CPU.

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

    @classmethod
    def check_sizes(cls, config: Any, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError if tensors do not fit a config, before memory is taken for it."""
        try:
            with torch.device("meta"):  # takes no memory, however large the sizes
                model = cls(config)
        except (RuntimeError, TypeError) as error:  # a size that does not fit into 64 bits
            raise ValueError("expected sizes that fit into memory") from error
        check_tensors(model, dict(tensors), like=cls.float_tensor)


class WholeModel(SavedModel):
    """Base of the models whose tensors are checked together.

    A subclass defines `check_state`, beside what `SavedModel` asks for.
    """

    @abstractmethod
    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""

    def check_loaded(self, tensors: Mapping[str, Any]) -> None:
        """Raise as `check_state`, but for no tensors at all, which a part of a state may have."""
        if tensors:
            self.check_state(tensors)

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Load tensors as `nn.Module` does, or none of them if one is refused.

        Raises:
            ValueError: as `check_state`.
        """
        self.check_state(state_dict)
        return super().load_state_dict(state_dict, strict, assign)


def _check_loaded(model: Any, state_dict: dict[str, Any], prefix: str, *_: object) -> None:
    model.check_loaded(part_of(state_dict, prefix))

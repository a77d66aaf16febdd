"""Names of the last release: they work on, with a DeprecationWarning, until the next one."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from torch import Tensor, nn

_Class = TypeVar("_Class", bound=type)
_FIELDS = "_new_names_of_fields"


def warn_renamed(old: str, new: str, stacklevel: int = 3) -> None:
    """Warn that a name has changed."""
    warnings.warn(f"{old} is now {new}", DeprecationWarning, stacklevel=stacklevel)


def old_names(**new_by_old: str) -> Callable[[_Class], _Class]:
    """Let a class answer to the old names of its attributes; a dataclass also to those of fields.

    Args:
        new_by_old: old name -> new name.
    """

    def decorate(cls: _Class) -> _Class:
        for old, new in new_by_old.items():
            setattr(cls, old, _alias(old, new))
        if hasattr(cls, "__dataclass_fields__"):
            setattr(cls, _FIELDS, new_by_old)
            cls.__init__ = _taking_old_fields(cls.__init__, new_by_old)
        return cls

    return decorate


def _alias(old: str, new: str) -> property:
    def get(self: Any) -> Any:
        warn_renamed(old, new)
        return getattr(self, new)

    return property(get, doc=f"Old name of `{new}`.")


def _taking_old_fields(init: Callable[..., None], new_by_old: Mapping[str, str]) -> Any:
    @functools.wraps(init)
    def take(self: Any, *args: Any, **kwargs: Any) -> None:
        for old in new_by_old.keys() & kwargs.keys():
            warn_renamed(old, new_by_old[old])
            kwargs[new_by_old[old]] = kwargs.pop(old)
        init(self, *args, **kwargs)

    return take


def with_new_names(config: type, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a config read from a file, under their names of today."""
    new_by_old = getattr(config, _FIELDS, {})
    return {new_by_old.get(name, name): value for name, value in fields.items()}


def rename_on_load(module: nn.Module, new_by_old: Mapping[str, str]) -> None:
    """Let `load_state_dict` take tensors under their old names.

    Call it before `check_on_load`, for every module that may be loaded by itself.

    Args:
        module: whose tensors, or whose parts' tensors, were renamed.
        new_by_old: old part of a tensor's name (what stands between two dots) -> new part.
    """
    # A partial of a function of this module, which can be pickled.
    module.register_load_state_dict_pre_hook(functools.partial(_rename, new_by_old))


def _rename(
    new_by_old: Mapping[str, str],
    _: nn.Module,
    state_dict: dict[str, Tensor],
    prefix: str,
    *__: object,
) -> None:
    rename_tensors(state_dict, new_by_old, prefix)


def rename_tensors(
    tensors: dict[str, Tensor], new_by_old: Mapping[str, str], prefix: str = ""
) -> None:
    """Rename parts of tensors' names in place, of those that begin with a prefix."""
    for name in [name for name in tensors if name.startswith(prefix)]:
        parts = name[len(prefix) :].split(".")
        new = prefix + ".".join(new_by_old.get(part, part) for part in parts)
        if new != name:
            tensors[new] = tensors.pop(name)

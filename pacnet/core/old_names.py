"""Names of the last release: they work until the next one, with a DeprecationWarning."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from torch import nn

_Class = TypeVar("_Class", bound=type)
_FIELDS = "_new_names_of_fields"


def warn_renamed(old: str, new: str, stacklevel: int = 3) -> None:
    """Warn that a name has changed."""
    warnings.warn(f"{old} is now {new}", DeprecationWarning, stacklevel=stacklevel)


def old_names(**new_by_old: str) -> Callable[[_Class], _Class]:
    """Give a class the old names of its attributes, a dataclass also those of its fields.

    Apply it above `@dataclass`.
    """

    def decorate(cls: Any) -> Any:
        for old, new in new_by_old.items():
            setattr(cls, old, _alias(old, new))
        if hasattr(cls, "__dataclass_fields__"):
            setattr(cls, _FIELDS, new_by_old)
            cls.__init__ = _with_old_fields(cls.__init__, new_by_old)
        return cls

    return decorate


def old_arguments(**new_by_old: str) -> Callable[[_Class], _Class]:
    """Give a NamedTuple that users make the old names of its arguments; it takes 0.4 µs more."""

    def decorate(cls: Any) -> Any:
        cls.__new__ = _with_old_fields(cls.__new__, new_by_old)
        return cls

    return decorate


def _alias(old: str, new: str) -> property:
    def get(self: Any) -> Any:
        warn_renamed(old, new)
        return getattr(self, new)

    return property(get, doc=f"Old name of `{new}`.")


def _with_old_fields(init: Callable[..., Any], new_by_old: Mapping[str, str]) -> Any:
    @functools.wraps(init)
    def take_old(self: Any, *args: Any, **kwargs: Any) -> Any:
        for old in new_by_old.keys() & kwargs.keys():
            warn_renamed(old, new_by_old[old])
            # The old name takes precedence: `dataclasses.replace` gives both.
            kwargs[new_by_old[old]] = kwargs.pop(old)
        return init(self, *args, **kwargs)

    return take_old


def with_new_names(config: type, fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a config read from a file under their new names, without a warning."""
    new_by_old = getattr(config, _FIELDS, {})
    return {new_by_old.get(name, name): value for name, value in fields.items()}


def rename_on_load(module: nn.Module, new_by_old: Mapping[str, str]) -> None:
    """Let `load_state_dict` take tensors under their old names.

    Call it before `check_on_load`, for every module that may be loaded by itself.

    Args:
        module: the module in which tensors, its own or a child's, were renamed.
        new_by_old: old part of a tensor's name (between two dots) -> new part.
    """
    # Not a closure, which could not be pickled with the module.
    hook = functools.partial(_rename_loaded, dict(new_by_old))
    module.register_load_state_dict_pre_hook(hook)


def _rename_loaded(
    new_by_old: Mapping[str, str], _module: nn.Module, tensors: Any, prefix: str, *_: object
) -> None:
    for name in [name for name in tensors if name.startswith(prefix)]:
        parts = name[len(prefix) :].split(".")
        if "forward_model" in parts:  # a caller's own, with names of its own
            continue
        new = prefix + ".".join(new_by_old.get(part, part) for part in parts)
        if new != name:
            tensors[new] = tensors.pop(name)

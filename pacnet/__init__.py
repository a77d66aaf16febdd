"""pacnet: perception-action coupling by imitation and attention.

After Maistros, Marom & Hayes, "Perception-Action Coupling via Imitation and Attention" (2001).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pacnet.api import *  # noqa: F403


# PyTorch takes seconds to import, which `pacnet --help` has no need of.
def __getattr__(name: str) -> Any:
    if name.startswith("__") and name != "__all__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("pacnet.api"), name)


def __dir__() -> list[str]:
    return [*globals(), *__getattr__("__all__")]

"""pacnet: perception-action coupling by imitation and attention.

After Maistros, Marom & Hayes, "Perception-Action Coupling via Imitation and Attention" (2001).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pacnet.attention import *  # noqa: F403
    from pacnet.competition import *  # noqa: F403
    from pacnet.datasets import *  # noqa: F403
    from pacnet.forward_models import *  # noqa: F403
    from pacnet.imitator import *  # noqa: F403
    from pacnet.network import *  # noqa: F403
    from pacnet.schemas import *  # noqa: F403

_PUBLIC = {  # folder -> the names that `pacnet` offers
    "attention": (
        "NO_NODE", "Attention", "HabituatingSOFM", "Observation", "SOFMConfig", "SOFMEnsemble",
        "Step",
    ),
    "competition": (
        "CompetingSchemas", "CompetingSchemasConfig", "Competition", "CompetitionConfig",
        "NO_SCHEMA", "Recognition", "RecognitionConfig",
    ),
    "datasets": ("Recorder", "load_demonstrations"),
    "forward_models": (
        "AffineForwardModel", "AffineForwardModelConfig", "Command", "ForwardModel",
        "KinematicModel", "KinematicModelConfig", "MLPForwardModel", "MLPForwardModelConfig",
        "OneStateForwardModel", "PIDConfig", "PIDController", "Selection", "TransitionMatrix",
        "TransitionMatrixConfig",
    ),
    "imitator": ("Imitator",),
    "network": (
        "Decision", "PACNet", "PACNetConfig", "SchemaNetwork",
        "SchemaNetworkConfig",
    ),
    "schemas": ("MotorSchemas", "MotorSchemasConfig", "targets_ahead"),
}  # fmt: skip
_FOLDER_OF = {name: folder for folder, names in _PUBLIC.items() for name in names}
_OLD_NAMES = {  # work for one release
    "Action": "Decision",
    "NOBODY": "NO_NODE",
    "Recall": "Decision",
}

__all__ = sorted(_FOLDER_OF)  # pyright: ignore[reportUnsupportedDunderAll]


# PyTorch takes seconds to import, which `pacnet --help` does not need.
def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name in _OLD_NAMES:
        from pacnet.core.old_names import warn_renamed

        warn_renamed(f"pacnet.{name}", f"pacnet.{_OLD_NAMES[name]}")
        name = _OLD_NAMES[name]
    if name not in _FOLDER_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"pacnet.{_FOLDER_OF[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), "__version__", *__all__]


def _version() -> str:
    """Return the version of the installed distribution, which is that of pyproject.toml."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("pacnet")
    except PackageNotFoundError:  # imported from a source tree that is not installed
        return "0+unknown"

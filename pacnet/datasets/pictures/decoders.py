"""PyAV and Pillow, which only those need who read pictures."""

from importlib import import_module
from types import ModuleType

from pacnet.datasets.format import DatasetError


class MissingDecoder(DatasetError):  # noqa: N818 — it is a kind of DatasetError
    """What decodes pictures is not installed."""


def import_decoder(name: str) -> ModuleType:
    """Return `av` or `PIL.Image`; raise `MissingDecoder` if it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        package = {"av": "PyAV", "PIL.Image": "Pillow"}[name]
        raise MissingDecoder(
            f"expected {package} to decode pictures with: pip install 'pacnet[cameras]'"
        ) from error

"""PyAV and Pillow, which only those need who read pictures."""

from importlib import import_module
from types import ModuleType

from pacnet.datasets.format import DatasetError


def import_decoder(name: str) -> ModuleType:
    """Return `av` or `PIL.Image`; raise a DatasetError if it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        package = {"av": "PyAV", "PIL.Image": "Pillow"}[name]
        raise DatasetError(
            f"expected {package} to decode pictures with: pip install 'pacnet[cameras]'"
        ) from error

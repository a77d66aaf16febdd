"""LeRobot datasets: read into tensors, recorded, and copied with added columns."""

from pacnet.datasets.annotations import check_annotatable, write_annotated
from pacnet.datasets.demonstrations import Demonstration, Demonstrations, load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning, MissingFeature
from pacnet.datasets.recorder import Feature, Picture, Recorder, recover

__all__ = [
    "DatasetError", "DatasetWarning", "Demonstration", "Demonstrations", "Feature",
    "MissingFeature", "Picture", "Recorder", "check_annotatable", "load_demonstrations", "recover",
    "write_annotated",
]  # fmt: skip

"""LeRobot datasets: read into tensors, recorded, and copied with added columns."""

from pacnet.datasets.demonstrations import Demonstration, Demonstrations, load_demonstrations
from pacnet.datasets.recorder import Recorder, recover

__all__ = ["Demonstration", "Demonstrations", "Recorder", "load_demonstrations", "recover"]

"""What a camera's picture says about where the hand will be."""

from pacnet.vision.cameras import Cameras
from pacnet.vision.config import ImageEncoderConfig
from pacnet.vision.encoder import ImageEncoder, Look

__all__ = ["Cameras", "ImageEncoder", "ImageEncoderConfig", "Look"]

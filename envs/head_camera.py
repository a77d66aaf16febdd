"""A camera beside each body's head: fixed in the body's frame, it looks down at the table.

Its picture holds every place of the own glass within 10 cm of the usual one. The other glass and
the other body stay out of it, so the picture is the same in both bodies' frames.
"""

import numpy as np

from envs.humanoid import Element

SIZE = 128  # [pixels] of a picture's height and width
POSITION = (0.12, -0.14, 0.74)  # [m] body frame: right of the eyes
TARGET = (0.49, -0.07, 0.15)  # [m] body frame: in the middle of the picture
FOVY = 29.0  # [degrees]


def camera_of(who: str) -> str:
    """Return the name of the camera beside a body's head."""
    return f"{who}_head"


def add_head_camera(scene: Element, who: str, origin: np.ndarray, facing: np.ndarray) -> None:
    """Add the camera of a body.

    Args:
        scene: Of which the world's frame is.
        who: Whose camera.
        origin: Of the body's frame `[3]` [m].
        facing: Factor on each coordinate of the body's frame `[3]`, that turns it to the world's.
    """
    backwards = np.subtract(POSITION, TARGET)
    right = np.cross((0.0, 0.0, 1.0), backwards)
    axes = np.concatenate([facing * right, facing * np.cross(backwards, right)])
    place = origin + facing * POSITION
    scene.worldbody.add("camera", name=camera_of(who), pos=place, fovy=FOVY, xyaxes=axes)

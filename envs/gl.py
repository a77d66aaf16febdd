"""Chooses MuJoCo's OpenGL backend before dm_control is imported, so that no display is ever needed.

dm_control reads ``MUJOCO_GL`` once, at import. Left to itself on a machine without a display it
picks GLFW, and the first render ends the process in a way that Python cannot catch.
"""

import os
import sys
from ctypes.util import find_library

LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}  # these draw without a window


def choose_gl() -> None:
    """Sets ``MUJOCO_GL`` to a backend that works here, unless it names one that does.

    In order: EGL, OSMesa, GLFW where there is a display, else ``disable`` (no OpenGL). Only Linux
    needs the choice.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    backends = (*LIBRARIES, "glfw")
    is_other_word = wanted not in ("", *backends)  # "disable", or dm_control explains the error
    if not sys.platform.startswith("linux") or is_other_word or _works(wanted):
        return
    os.environ["MUJOCO_GL"] = next(filter(_works, backends), "disable")


def _works(backend: str) -> bool:
    """Whether a backend's library, or the display it needs, is there."""
    if backend in LIBRARIES:
        return find_library(LIBRARIES[backend]) is not None
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return backend == "glfw" and bool(has_display)

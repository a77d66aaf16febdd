"""Chooses MuJoCo's OpenGL backend before dm_control is imported, so that no display is ever needed.

dm_control reads ``MUJOCO_GL`` once, at import. Left to itself on a machine without a display it
picks GLFW, and the first render may end the process in a way that Python cannot catch.
"""

import os
import subprocess
import sys

BACKENDS = ("egl", "osmesa", "glfw")  # the first two draw without a window
TRIAL_SECONDS = 30.0  # after which a backend counts as broken
TRIAL = """
import mujoco
from dm_control import _render
with _render.Renderer(16, 16).make_current() as context:
    context.call(mujoco.MjrContext, mujoco.MjModel.from_xml_string("<mujoco/>"), 50)
"""


def choose_gl() -> None:
    """Sets ``MUJOCO_GL`` to a backend that works here: the one it names, if that does.

    Else in order: EGL, OSMesa, GLFW where there is a display, ``disable`` (no OpenGL). Only Linux
    needs the choice.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    is_other_word = wanted not in ("", *BACKENDS)  # "disable", or dm_control explains the error
    if not sys.platform.startswith("linux") or is_other_word:
        return
    candidates = dict.fromkeys((wanted or BACKENDS[0], *BACKENDS))
    os.environ["MUJOCO_GL"] = next(filter(_works, candidates), "disable")


def _works(backend: str) -> bool:
    """Whether a backend can be had; GLFW is not even tried without a display."""
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return (backend != "glfw" or bool(has_display)) and _makes_context(backend)


def _makes_context(backend: str) -> bool:
    """Tries a backend in a process of its own.

    A library that is there may still find no device, one that fails leaves PyOpenGL bound to it,
    and some end the process.
    """
    command = [sys.executable, "-c", TRIAL]
    environ = {**os.environ, "MUJOCO_GL": backend}
    try:
        done = subprocess.run(
            command, env=environ, capture_output=True, timeout=TRIAL_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0

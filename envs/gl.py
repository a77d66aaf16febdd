"""Chooses MuJoCo's OpenGL backend before dm_control is imported, so that no display is needed.

dm_control reads ``MUJOCO_GL`` once, at import. By default it picks GLFW, and without a display the
first render may then end the process in a way that Python cannot catch.
"""

import os
import subprocess
import sys

BACKENDS = ("egl", "osmesa", "glfw")  # the first two need no window
TRIAL_SECONDS = 30.0  # timeout of a trial
TRIAL = """
import mujoco
from dm_control import _render
with _render.Renderer(16, 16).make_current() as context:
    context.call(mujoco.MjrContext, mujoco.MjModel.from_xml_string("<mujoco/>"), 50)
"""


def choose_gl() -> None:
    """Set ``MUJOCO_GL`` to a backend that works here; prefer the one that it names.

    Otherwise the first that works of EGL, OSMesa, GLFW with a display, and ``disable`` (no OpenGL).
    Only Linux needs the choice.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    is_other_word = wanted not in ("", *BACKENDS)  # "disable", or dm_control reports the error
    if not sys.platform.startswith("linux") or is_other_word:
        return
    candidates = dict.fromkeys((wanted or BACKENDS[0], *BACKENDS))
    os.environ["MUJOCO_GL"] = next(filter(_works, candidates), "disable")


def _works(backend: str) -> bool:
    """Return whether a backend works; GLFW is not tried without a display."""
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return (backend != "glfw" or bool(has_display)) and _makes_context(backend)


def _makes_context(backend: str) -> bool:
    """Try a backend in its own process.

    An installed library may find no device; after a failure PyOpenGL stays bound to the library;
    and some failures end the process.
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

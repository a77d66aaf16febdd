"""Pictures with and without OpenGL, and the choice between them."""

import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import envs  # noqa: F401  registers the environment
from envs import gl
from envs.drawing import draw_scene
from envs.scene import IMITATOR, SHIRTS

ENV_ID = "pacnet/PosturalImitation-v0"
DRAW_IN_A_NEW_PROCESS = f"""
import gymnasium, sys, envs
env = gymnasium.make("{ENV_ID}", render_mode="rgb_array", width=320, height=180)
env.reset(seed=0)
env.step(env.action_space.sample())
picture = env.render()
assert picture.shape == (180, 320, 3) and picture.dtype == "uint8", picture.shape
assert picture.std() > 20
env.close()
print("drawn by", "OpenGL" if env.unwrapped.draws_with_gl else "Pillow")
"""


@pytest.fixture
def env():
    made = gymnasium.make(ENV_ID, render_mode="rgb_array").unwrapped
    made.reset(seed=0)
    yield made
    made.close()


def draw_elsewhere(**variables):
    unset = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM")
    environ = {key: value for key, value in os.environ.items() if key not in unset}
    command = [sys.executable, "-c", DRAW_IN_A_NEW_PROCESS]
    done = subprocess.run(
        command, env={**environ, **variables}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_without_gl_pillow_draws():
    assert draw_elsewhere(MUJOCO_GL="disable") == "drawn by Pillow"


def test_without_a_display_the_process_does_not_end():
    assert draw_elsewhere(MUJOCO_GL="glfw") in ("drawn by OpenGL", "drawn by Pillow")


@pytest.mark.parametrize(
    "variables",
    [{}, {"MUJOCO_GL": "egl"}, {"DISPLAY": ":77"}],
    ids=["none wanted", "EGL wanted", "a display that does not answer"],
)
def test_a_library_without_a_device_is_not_chosen(variables):
    """As in a container with libEGL and no driver; the second variable rules OSMesa out."""
    broken = {"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent", "PYOPENGL_PLATFORM": "egl"}
    assert draw_elsewhere(**broken, **variables) == "drawn by Pillow"


def test_when_the_context_fails_pillow_takes_over(env, monkeypatch):
    def fail(*_args, **_kwargs):
        raise RuntimeError("no context")

    monkeypatch.setattr(env._physics, "render", fail)
    assert np.array_equal(env.render(), draw_scene(env._physics, 360, 640))
    assert not env.draws_with_gl


def test_without_a_render_mode_nothing_is_drawn():
    env = gymnasium.make(ENV_ID).unwrapped
    env.reset(seed=0)
    assert env.render() is None
    env.close()


def pixels_like(picture, rgba, tolerance=12):
    colour = np.array(rgba[:3]) * 255
    return np.abs(picture.astype(float) - colour).max(axis=2) < tolerance


def test_the_drawing_shows_the_imitator_on_the_right(env):
    picture = draw_scene(env._physics, 360, 640)
    shirt = pixels_like(picture, SHIRTS[IMITATOR])
    assert shirt[:, 320:].mean() > 0.05
    assert not shirt[:, :320].any()


def test_the_drawing_follows_the_motion(env):
    before = draw_scene(env._physics, 360, 640)
    for _ in range(60):
        env.step_to(env.rest_posture)
    moved = (before != draw_scene(env._physics, 360, 640)).any(axis=2)
    assert moved[:, :320].mean() > 0.01  # the demonstrator's arm
    assert moved[:, 400:].mean() < 0.001


def test_the_drawing_has_the_cameras_geometry(env):
    """OpenGL and Pillow put the imitator's shirt at the same pixels."""
    drawn = pixels_like(draw_scene(env._physics, 360, 640), SHIRTS[IMITATOR])
    picture = env.render().astype(float)
    if not env.draws_with_gl:
        pytest.skip("no OpenGL here")
    red = (picture[..., 0] > 1.8 * picture[..., 2]) & (picture[..., 0] > 1.8 * picture[..., 1])
    overlap = (drawn & red).sum() / (drawn | red).sum()
    assert overlap > 0.8


@pytest.mark.parametrize(
    ("working", "variables", "expected"),
    [
        ({"egl", "osmesa"}, {}, "egl"),
        ({"osmesa"}, {}, "osmesa"),
        (set(), {}, "disable"),
        ({"egl", "osmesa"}, {"MUJOCO_GL": "osmesa"}, "osmesa"),
        ({"egl"}, {"MUJOCO_GL": "osmesa"}, "egl"),
        ({"egl"}, {"MUJOCO_GL": "disable"}, "disable"),
        (set(), {"MUJOCO_GL": "egl"}, "disable"),
        ({"egl", "glfw"}, {"MUJOCO_GL": "glfw"}, "egl"),
        ({"egl"}, {"DISPLAY": ":0"}, "egl"),
        ({"glfw"}, {"DISPLAY": ":0"}, "glfw"),
        ({"glfw"}, {}, "disable"),
        (set(), {"DISPLAY": ":0"}, "disable"),
        ({"egl", "glfw"}, {"DISPLAY": ":0", "MUJOCO_GL": "glfw"}, "glfw"),
    ],
)
def test_choice_of_backend(monkeypatch, working, variables, expected):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(gl, "_makes_context", working.__contains__)
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    gl.choose_gl()
    assert os.environ.get("MUJOCO_GL") == expected

"""All learners that see, by name: the imitator with each encoder, then the baselines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol

from benchmarks.metaworld.camera import act, baselines, pretrained
from benchmarks.metaworld.camera.recording import CAMERA
from benchmarks.metaworld.camera.world import Picture
from benchmarks.metaworld.features import Array
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator.imitator import Imitator


class Seeing(Protocol):
    """Learns from demonstrations with pictures, then acts on one percept after the other."""

    @property
    def sees(self) -> bool:
        """Whether it wants a picture at the next step."""
        ...

    @property
    def note(self) -> str:
        """What it tells of what it learned."""
        ...

    def learn(self, demonstrations: Demonstrations) -> None:
        """Learn once, from nothing."""
        ...

    def reset(self) -> None:
        """Start an episode."""
        ...

    def act(self, state: Array, picture: Picture | None) -> Array | None:
        """Return the action `[4]` at a state `[4]` and what is seen; None to hold."""
        ...

    def close(self) -> None:
        """Let go of what it holds."""
        ...


class Imitating:
    """`pacnet.Imitator` with its automatic settings.

    Args:
        encoder: what makes pictures into places; None for an imitator that has the state alone.
    """

    def __init__(self, encoder: str | None = "auto") -> None:
        self._encoder = encoder

    def learn(self, demonstrations: Demonstrations) -> None:
        """Make an imitator and let it learn."""
        if self._encoder is None:
            blind = tuple(replace(shown, pictures={}) for shown in demonstrations)
            demonstrations = replace(demonstrations, episodes=blind)
        options = {} if self._encoder is None else {"encoder": self._encoder}
        self.imitator = Imitator.from_demonstrations(demonstrations, **options)
        self.imitator.learn(demonstrations)

    @property
    def sees(self) -> bool:
        """Whether it looks at pictures at the next step."""
        return self.imitator.is_looking

    @property
    def note(self) -> str:
        """Which kind of encoder is used, and what it tells with a demonstration left out."""
        return "; ".join(
            f"{one.kind}: {1e3 * one.told.error:.0f} mm, {1e3 * one.told.alone:.0f} without"
            for one in self.imitator.camera_reports
        )

    def reset(self) -> None:
        """Start an episode."""
        self.imitator.reset()

    def act(self, state: Array, picture: Picture | None) -> Array | None:
        """Return its action, None where what it perceives is novel."""
        if self.imitator.cameras is None:  # also where no camera helps
            return self.imitator.step(state).action
        pictures = None if picture is None else {CAMERA: picture}
        return self.imitator.step(state, pictures=pictures).action

    def close(self) -> None:
        """Do nothing."""


LEARNERS: dict[str, Callable[[], Seeing]] = {
    "pacnet": Imitating,
    "state": partial(Imitating, None),
    "patches": partial(Imitating, "patches"),
    "pca": partial(Imitating, "pca"),
    "pretrained": partial(Imitating, pretrained.KIND),
    "nearest": baselines.NearestGoals,
    "pixels": baselines.Pixels,
    "bc": baselines.BehaviourCloning,
    "replay": baselines.Replay,
    "shifted": baselines.ShiftedReplay,
    "act": act.ActionChunks,
}
TITLES = {
    "pacnet": "`Imitator`",
    "state": "state alone",
    "patches": "`patches`",
    "pca": "`pca`",
    "pretrained": "`pretrained`",
    "nearest": "1-NN of what it tells",
    "pixels": "1-NN of pixels",
    "bc": "BC",
    "replay": "replay",
    "shifted": "shifted replay",
    "act": "ACT",
}
"""Name -> how tables call it."""
OURS: Sequence[str] = ("pacnet", "state")
"""Those that are measured in all draws and episodes; the others in fewer."""

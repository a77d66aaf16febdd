"""The cameras of an imitator: what they tell in a recall episode, and what they learn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from pacnet.core.drafts import Lock, adopt, draft_of
from pacnet.datasets.demonstrations import Demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.checks import check_pictured
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.postures import Warped, postures_of, warp
from pacnet.imitator.records import EpisodeReport, ImitatorStep
from pacnet.imitator.seeing import Hands, hands_of, place_of_hand
from pacnet.schemas.demonstration_memory import Shown
from pacnet.vision.cameras import Cameras
from pacnet.vision.sight import Seen, Sight


class Looking:
    """What the cameras tell in one recall episode, and what demonstrations tell them.

    Args:
        cameras: that look.
        config: of the imitator.
        learning: held while the cameras learn.
        state: held while their state is replaced or read.
    """

    def __init__(
        self, cameras: Cameras, config: ImitatorConfig, learning: Lock, state: Lock
    ) -> None:
        self._cameras, self._config = cameras, config
        self._learning, self._state = learning, state
        self.reset()

    def reset(self) -> None:
        """Begin a new episode."""
        self._sight: Sight | None = None
        self._warped: Warped | None = None

    @property
    def is_on(self) -> bool:
        """Whether the next step looks at pictures; later in an episode the hand is in the way."""
        return self._sight is None or self._sight.last is None

    def __call__(self, pictures: object) -> Seen:
        """Return what the cameras tell in this episode by now.

        Args:
            pictures: as of `Cameras.checked`; any once the hand is in the way.

        Raises:
            ValueError: as `Cameras.checked`.
        """
        with self._state:
            sight = self._sight or self._cameras.begin()
        seen = sight.last or sight(self._cameras.checked(pictures))
        self._sight = sight
        return seen

    def acted(self) -> None:
        """Take note that the robot acts on what was seen."""
        if self._sight is not None:
            self._sight.acted()

    def unseen(self, seen: Seen) -> ImitatorStep:
        """Return a step at pictures that are novel: nothing is done."""
        name, doubt = self._cameras.features[seen.camera], seen.doubt
        return ImitatorStep(None, True, doubt, name, doubt, 1.0, 0.0, False, (), None)

    def warped(
        self,
        shown: Shown,
        allowed: NDArray[np.bool_],
        reports: Sequence[EpisodeReport],
        seen: Seen,
    ) -> Warped:
        """Return the demonstrations with the postures that are seen; arguments as of `warp`."""
        with self._state:  # another thread may be learning
            told = self._cameras.goals_shown()
        last = self._warped
        if last is None or not last.is_of(shown, allowed, told, seen.goals):
            last = self._warped = warp(shown, allowed, told, seen.goals, reports, self._config)
        return last

    def pictures(self) -> dict[str, NDArray[np.uint8]]:
        """Return some picture of each camera."""
        return self._cameras.pictures_shown()

    def perceived(
        self, demonstrations: Demonstrations, body: KinematicModel | None
    ) -> tuple[Demonstrations, Hands]:
        """Return demonstrations as they are learned, and where the hand is in them, or its posture.

        Where cameras tell places, percepts end with what their first pictures tell.

        Args:
            demonstrations: whole episodes, or parts of them with pictures.
            body: says where the hand is; None without one.

        Raises:
            ValueError: demonstrations that do not fit, or a part of one without pictures.
        """
        check_pictured(demonstrations, self._config)
        if not self._config.tells_places:
            return demonstrations, postures_of(demonstrations, self._config)
        hands = hands_of(demonstrations, place_of_hand(self._config), body)
        return self._cameras.with_goals(demonstrations, hands), hands

    def seen(self, demonstrations: Demonstrations) -> Demonstrations:
        """Return demonstrations as they are perceived while acting; see `Imitator.seen`."""
        return self._cameras.seen(demonstrations) if self._config.tells_places else demonstrations

    def learn(
        self, whole: Demonstrations, hands: Hands, first: int, kept: NDArray[np.bool_]
    ) -> None:
        """Let the cameras remember how the whole demonstrations that were learned began.

        Args:
            whole: as they came, of which a part may have been learned.
            hands: where the hand is in them, as `perceived` returned it.
            first: number of the first one's report.
            kept: whether anything is kept of each demonstration learned, now or before, `[E]`.
        """
        numbers = first + np.cumsum([0, *(len(shown.gaps) + 1 for shown in whole)])
        learned = int(np.searchsorted(numbers[1:], len(kept), side="right"))
        with self._learning, torch.inference_mode(False):
            draft = draft_of(self._cameras)
            part = replace(whole, episodes=whole.episodes[:learned])
            draft.add(part, hands[:learned], numbers[:learned].tolist())
            draft.keep(kept)
            with self._state:
                adopt(self._cameras, draft)

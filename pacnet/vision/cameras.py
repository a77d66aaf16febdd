"""All cameras of an imitator: what they tell becomes a part of what is perceived."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.core.drafts import BufferVersions, snapshot_of
from pacnet.core.integrity import check_on_load, part_of
from pacnet.datasets.records import Demonstration, Demonstrations
from pacnet.vision.cameras_config import CAMERAS, CamerasConfig
from pacnet.vision.encoder import ImageEncoder
from pacnet.vision.goals import goals_of
from pacnet.vision.sight import Seen, Sight

_AT_BEGINNING, _BEGINNING = 3, 0.1  # frames, and [s], with which an episode begins
_ON_THE_WAY = 0.15  # share of an episode
Hands = Sequence[NDArray[np.floating]]
"""Where the hand is in each demonstration, `[T, S]`."""


class GoalsShown(NamedTuple):
    """What is told of E demonstrations whose pictures were shown."""

    first: NDArray[np.int64]
    """Number of each one's first part, `[E]`."""
    end: NDArray[np.int64]
    """The number after that of its last part, `[E]`."""
    goals: NDArray[np.float32]
    """`[E, G · S]`."""


class Cameras(nn.Module):
    """Tells from the pictures of some cameras where the hand will be.

    Args:
        config: see `CamerasConfig`.

    Attributes:
        encoders: camera -> its `ImageEncoder`.
    """

    def __init__(self, config: CamerasConfig) -> None:
        super().__init__()
        self.config = config
        self.parts = nn.ModuleList(ImageEncoder(one) for one in config.encoders)
        self._cache: tuple[BufferVersions, GoalsShown] | None = None
        check_on_load(self)

    @property
    def features(self) -> tuple[str, ...]:
        """The cameras, as their features are called."""
        return self.config.features

    @property
    def encoders(self) -> dict[str, ImageEncoder]:
        """Camera -> its encoder."""
        parts = [part for part in self.parts if isinstance(part, ImageEncoder)]
        return dict(zip(self.features, parts, strict=True))

    def begin(self) -> Sight:
        """Return what looks at the pictures of an episode that begins, as it is known now."""
        encoders = [*snapshot_of(self).encoders.values()]
        return Sight(encoders, self.config.at_once, self.config.until)

    def pictures_shown(self) -> dict[str, NDArray[np.uint8]]:
        """Return some picture of each camera, `[h, w, 3]`; a black one if none was shown."""
        pictures = {}
        for feature, encoder in self.encoders.items():
            shown, config = encoder.shown.live("picture"), encoder.config
            black = np.zeros((config.height, config.width, 3), np.uint8)
            pictures[feature] = shown[0].numpy() if len(shown) else black
        return pictures

    def checked(self, pictures: object) -> list[NDArray[np.uint8]]:
        """Return one reduced picture `[h, w, 3]` of each camera.

        Args:
            pictures: camera -> uint8 `[H, W, 3]`; others than those of the config are ignored.

        Raises:
            ValueError: a camera is missing, or its picture is none, or of another aspect.
        """
        from pacnet.datasets.pictures import reduce  # imports numba

        if not isinstance(pictures, Mapping):
            got = "none" if pictures is None else type(pictures).__name__
            raise ValueError(f"expected pictures of {', '.join(self.features)}, got {got}")
        found = []
        for feature, encoder in self.encoders.items():
            if feature not in pictures:
                got = ", ".join(map(str, pictures)) or "none"
                raise ValueError(f"expected a picture of {feature!r}, got {got}")
            picture, config = reduce(pictures[feature]), encoder.config
            if picture.shape != (config.height, config.width, 3):
                raise ValueError(
                    f"expected pictures of {feature!r} that are {config.width} x {config.height} "
                    f"pixels when reduced, got {picture.shape[1]} x {picture.shape[0]} of "
                    f"{pictures[feature].shape[1]} x {pictures[feature].shape[0]}"
                )
            found.append(picture)
        return found

    def with_goals(self, demonstrations: Demonstrations, hands: Hands) -> Demonstrations:
        """Return demonstrations whose percepts end with where the hand will be.

        That is what their first pictures tell, so that they are related to goals as acting is: an
        error of what is told is much the same in both. An episode without pictures says it itself.

        Args:
            demonstrations: whole episodes, or parts of them with pictures.
            hands: where the hand is in them.

        Raises:
            ValueError: an episode that begins in the middle has no pictures of a camera.
        """
        episodes = []
        for shown, hand in zip(demonstrations, hands, strict=True):
            if shown.first_frame == 0:
                goals = np.tile(self._goals_of(shown, hand, demonstrations.fps), (len(hand), 1))
            else:
                goals = self._goals_seen(shown)
            episodes.append(replace(shown, encoded=torch.from_numpy(goals)))
        return self._named(demonstrations, episodes)

    def _goals_of(
        self, shown: Demonstration, hand: NDArray[np.floating], fps: float
    ) -> NDArray[np.float32]:
        """Return the goals that the first pictures of a whole episode tell, or else it itself."""
        if not {*self.features} <= {*shown.pictures}:
            return goals_of(hand, fps)
        pictures = [pictures_of(shown.pictures[name], fps)[0] for name in self.features]
        seen = self.begin()([picture.numpy() for picture in pictures])
        return seen.goals if seen.doubt <= 1 else goals_of(hand, fps)

    def seen(self, demonstrations: Demonstrations) -> Demonstrations:
        """Return demonstrations whose percepts end with what their pictures tell, as while acting.

        Raises:
            ValueError: an episode has no pictures of a camera.
        """
        return self._named(
            demonstrations,
            [
                replace(shown, encoded=torch.from_numpy(self._goals_seen(shown)))
                for shown in demonstrations
            ],
        )

    def look_at(self, shown: Demonstration) -> list[Seen]:
        """Return what is seen in each frame of an episode.

        Raises:
            ValueError: it has no pictures of a camera.
        """
        try:
            sight, pictures, seen = self.begin(), shown.pictures, []
            for frame in range(len(shown.state)):
                now = {name: frames[frame] for name, frames in pictures.items()}
                seen.append(sight.last or sight(self.checked(now)))
                if seen[-1].doubt <= 1:
                    sight.acted()
            return seen
        except ValueError as error:
            raise ValueError(f"episode {shown.episode}: {error}") from None

    def _goals_seen(self, shown: Demonstration) -> NDArray[np.float32]:
        return np.stack([seen.goals for seen in self.look_at(shown)])

    def _named(
        self, demonstrations: Demonstrations, episodes: Sequence[Demonstration]
    ) -> Demonstrations:
        """Return demonstrations with these episodes, and the goals among the percepts' features."""
        action = demonstrations.action_features
        names = {**demonstrations.percept_features, CAMERAS: self.config.names}
        names |= {name: demonstrations.names[name] for name in action}
        return replace(
            demonstrations,
            names=names,
            episodes=tuple(episodes),
            state=demonstrations.state_features,
        )

    def add(self, demonstrations: Demonstrations, hands: Hands, numbers: Sequence[int]) -> None:
        """Keep the beginnings of whole episodes with pictures; nothing is fitted again.

        Args:
            demonstrations: some.
            hands: where the hand is in them.
            numbers: of the demonstrations, ascending.
        """
        for encoder in self.encoders.values():
            if len(encoder.later):  # what it was fitted to may not be what was learned
                encoder.forget()
        for shown, hand, number in zip(demonstrations, hands, numbers, strict=True):
            if shown.first_frame > 0 or not {*self.features} <= {*shown.pictures}:
                continue
            goals = torch.from_numpy(goals_of(hand, demonstrations.fps))
            for feature, encoder in self.encoders.items():
                first, _ = pictures_of(shown.pictures[feature], demonstrations.fps)
                encoder.remember(first, goals, number, len(shown.gaps) + 1)

    def keep(self, demonstrations: NDArray[np.bool_]) -> None:
        """Forget the beginnings of demonstrations that are not kept, bool `[E]`; the fit stays."""
        shown = next(iter(self.encoders.values())).shown
        firsts, parts = shown.live("demonstration").tolist(), shown.live("parts").tolist()
        kept = [
            demonstrations[first : first + count].any()
            for first, count in zip(firsts, parts, strict=True)
        ]
        if not all(kept):
            for encoder in self.encoders.values():
                encoder.keep(torch.tensor(kept).nonzero().flatten())

    def goals_shown(self) -> GoalsShown:
        """Return what is told of the demonstrations shown; the same object until that changes.

        It is what their first pictures tell, or what they were where these are doubtful.
        """
        if self._cache is None or not self._cache[0].unchanged():
            self._cache = BufferVersions(self), self._goals_shown()
        return self._cache[1]

    def _goals_shown(self) -> GoalsShown:
        first, *_ = encoders = [*self.encoders.values()]
        numbers = first.shown.live("demonstration").numpy().copy()
        goals = first.shown.live("goals").numpy().copy()
        for row in range(len(numbers)):
            pictures = [encoder.shown.live("picture")[row].numpy() for encoder in encoders]
            seen = self.begin()(pictures)
            goals[row] = seen.goals if seen.doubt <= 1 else goals[row]
        return GoalsShown(numbers, numbers + first.shown.live("parts").numpy(), goals)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out of copies what they derive anew."""
        return {**self.__dict__, "_cache": None}

    def check_shown(self, count: int) -> None:
        """Raise a ValueError if more than so many demonstrations are remembered to be learned."""
        for encoder in self.encoders.values():
            shown = encoder.shown
            ends = shown.live("demonstration") + shown.live("parts")
            if not len(encoder.later) and (ends > count).any():
                raise ValueError(
                    f"expected pictures of the {count} demonstrations learned, got those of number "
                    f"{int(ends.max()) - 1}"
                )

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        for number, encoder in enumerate(self.encoders.values()):
            encoder.check_state(part_of(tensors, f"parts.{number}."))
        known = tuple(f"parts.{number}." for number in range(len(self.features)))
        for name in ("shown.demonstration", "shown.parts"):
            first, *others = [tensors[part + name] for part in known]
            if not all(first.equal(other) for other in others):
                raise ValueError(f"expected the same {name} of all cameras, got others")
        extra = [name for name in tensors if not name.startswith(known)]
        if extra:
            raise ValueError(f"expected tensors of {len(known)} cameras, got {extra[0]!r} as well")


def pictures_of(pictures: NDArray[np.uint8], fps: float) -> tuple[Tensor, Tensor]:
    """Return the picture with which an episode begins, and one on the way, `[h, w, 3]` each.

    A first picture may be bad, so it is the median of some. They are few: a hand that has set out
    says where it goes, and would be attended to rather than what it goes to.
    """
    frames = max(1, min(_AT_BEGINNING, round(_BEGINNING * fps)))
    first = np.median(pictures[:frames], axis=0).astype(np.uint8)
    later = np.array(pictures[round(_ON_THE_WAY * (len(pictures) - 1))])
    return torch.from_numpy(first), torch.from_numpy(later)

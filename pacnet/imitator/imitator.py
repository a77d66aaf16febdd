"""Imitation of what a LeRobot dataset shows: automatic settings, named dimensions, novelty.

The parts are those of Maistros, Marom & Hayes (2001): attention, motor schemas, competition and a
forward model. One rule decides whether it acts: it does unless the percept is novel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from operator import index
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention.records import NO_NODE
from pacnet.competition.following import State
from pacnet.competition.recognition import Recognition
from pacnet.core.drafts import adopt, draft_of, short_switch_interval, snapshot_of
from pacnet.core.growable_rows import check_storage
from pacnet.core.interrupts import defer_sigint
from pacnet.core.old_names import warn_renamed
from pacnet.core.validation import MAX_VALUE, check_row
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.auto_config import choose_settings
from pacnet.imitator.checks import check_demonstrations, check_pictured
from pacnet.imitator.forward_model import fit
from pacnet.imitator.framed_step import framed_step
from pacnet.imitator.learning import Draft, how_begins
from pacnet.imitator.novelty import NOVEL
from pacnet.imitator.points import PointsChoice
from pacnet.imitator.postures import postures_of, see_postures, warp
from pacnet.imitator.recognizing import recognizer_of
from pacnet.imitator.records import EpisodeReport, Followed, ImitatorStep, task_name
from pacnet.imitator.seeing import Hands, hands_of, place_of_hand, see
from pacnet.imitator.state import ImitatorState, Known
from pacnet.kernels.engine import Engine
from pacnet.schemas.targets import targets_ahead
from pacnet.vision.cameras import Cameras
from pacnet.vision.config import NONE
from pacnet.vision.fitting import CameraReport
from pacnet.vision.sight import Seen

_END = 0.1  # [s] before the last frame of a demonstration, from which it is done


def full_precision() -> AbstractContextManager[object]:
    """Compute distances in full precision, also inside a caller's mixed precision."""
    return torch.autocast("cpu", enabled=False)


class Imitator(ImitatorState):
    """Learns from demonstrations, one after the other, and does what they show.

    `from_demonstrations` makes one. It follows the demonstrations that fit best, from wherever it
    is; near them it is led back. Percepts unlike the training data are flagged as novel and get no
    action.

    One thread may `step` while another learns: it acts on the state before a demonstration, or on
    the state after it.

    Args:
        config: see `ImitatorConfig`.
        engine: as of `HabituatingSOFM`.

    Attributes:
        reports: of each demonstration learned, or of each part of it between gaps.

    Example:
        >>> phase = torch.linspace(0, 1.5, 200)[:, None]
        >>> shown = Demonstration(0, "wave", phase.sin(), torch.empty(200, 0), phase.cos())
        >>> names = {"observation.state": ("elbow",), "action": ("motor",)}
        >>> demonstrations = Demonstrations(50, names, (shown,), "waving")
        >>> imitator = Imitator.from_demonstrations(demonstrations)
        >>> [report.frames for report in imitator.learn(demonstrations)]
        [200]
        >>> imitator.reset(task="wave")
        >>> imitator.step(np.float32([0.5])).action.round(1)
        array([0.9], dtype=float32)
        >>> imitator.reset()
        >>> [imitator.step(np.float32([9.0])).action is None for _ in range(3)]
        [True, True, True]
    """

    camera_reports: tuple[CameraReport, ...] = ()
    """What each camera tells, where `from_demonstrations` was given pictures."""

    @classmethod
    def from_demonstrations(
        cls,
        demonstrations: Demonstrations,
        targets: Literal["action", "state"] = "action",
        lead: int = 1,
        engine: Engine = "auto",
        *,
        budget: int | None = None,
        points: PointsChoice = "auto",
        body: KinematicModel | None = None,
        encoder: str = "auto",
    ) -> Imitator:
        """Return an untrained imitator with settings chosen from these demonstrations.

        Args:
            demonstrations: from which the scale of percepts and the rate are taken.
            targets: what the schemas store; see `ImitatorConfig`.
            lead: frames that a target lies ahead, where it is a state.
            engine: as of `HabituatingSOFM`.
            budget: most targets that are kept; see `pacnet.imitator.budget`. None for all.
            points: which dimensions of a percept are places, as texts: the one that the robot's
                actions move first, such as `hand=observation.state[0:3]`, then the landmarks; see
                `pacnet.imitator.points`. "auto" finds them by their names, None is none. With a
                body they are the landmarks alone.
            body: tells where the hand is from the angles among the percepts, and finds the angles
                that take it somewhere; actions are targets of these angles then. None without one.
            encoder: what looks at the demonstrations' pictures, if they have any: "auto" for the
                first built-in kind that tells where the hand will be, or nothing where a camera
                does not help; see `pacnet.vision`.

        Raises:
            ValueError: no demonstrations, percepts that never change, actions that never do or too
                few frames where a forward model has to find them, points that are none here, or a
                body whose angles are not among percepts and actions.
        """
        seeing = see(demonstrations, points, body, encoder)
        config = choose_settings(
            seeing.demonstrations, targets, lead, budget, seeing.points, body, seeing.cameras
        )
        cameras, reports = seeing.cameras, seeing.reports
        has_pictures = any(shown.pictures for shown in demonstrations)
        told_nothing = bool(reports) and cameras is None  # not even a place
        if has_pictures and config.frames is None and encoder != NONE and not told_nothing:
            if seeing.cameras is not None:  # settings of places that are no use
                config = choose_settings(demonstrations, targets, lead, budget, None, None)
            cameras, reports = see_postures(demonstrations, config, encoder)
            config = replace(config, cameras=None if cameras is None else cameras.config)
        imitator = cls(config, engine)
        imitator.camera_reports = reports
        if cameras is not None and imitator.cameras is not None:
            imitator.cameras.load_state_dict(cameras.state_dict())
        if body is not None and imitator.frames is not None:
            imitator.frames.take_body(body)
        return imitator

    @classmethod
    def untaught(cls, *args: Any, **kwargs: Any) -> Imitator:
        """Old name of `from_demonstrations`."""
        warn_renamed("Imitator.untaught", "Imitator.from_demonstrations")
        return cls.from_demonstrations(*args, **kwargs)

    @torch.no_grad()
    def learn(
        self,
        demonstrations: Demonstrations,
        progress: Callable[[int], object] | None = None,
        *,
        corrections: bool = False,
    ) -> list[EpisodeReport]:
        """Learn each demonstration, in order, in addition to what is known.

        Nothing is learned across gaps: the parts between them count as demonstrations each. With
        points, what is shown after a gap follows what was shown before it. All frames are kept
        unless there is a budget. The scale of percepts never changes. The forward model is fitted
        to the first demonstrations only: it depends on the robot, not on the task. With points, it
        is fitted at the first call with demonstrations that are long enough; until then the shown
        actions are sent without a correction.
        In eval mode nothing is learned. Ctrl-C takes effect after the current demonstration; after
        an error what was known before that demonstration is intact. The mean first action is of
        demonstrations that begin with their episode, where there are any.

        Args:
            demonstrations: of the same features and rate as all before.
            progress: called after each continuous part with the number of its frames.
            corrections: whether they show what to do where percepts were novel. Then the novelty
                thresholds and the mean first action stay the same, however many there are.

        Returns:
            A report for each continuous part of a demonstration; none in eval mode.

        Raises:
            ValueError: other features or another rate; a demonstration that is empty, not finite or
                too large, of another type or width, or of unequal lengths; a task that is not a
                str; or too few frames to fit a forward model to. No demonstration was learned then.
        """
        first, actions = check_storage("first_action", self.first_action), len(self.config.action)
        if first.shape != (actions,):
            raise ValueError(f"expected a first action [{actions}], got {list(first.shape)}")
        hands = self._hands(demonstrations)
        if self.cameras is not None and self.config.tells_places:
            demonstrations = self.cameras.with_goals(demonstrations, hands)
        whole = demonstrations
        check_demonstrations(demonstrations, self.config, self.sofm)
        if not self.training:
            return []
        with self.learning_lock:
            self._check_reports(self._latest().shown.task.tolist(), len(self.reports))
        demonstrations = demonstrations.continuous()
        if self.forward_model is not None and not self.reports:
            with full_precision():
                fit(self.forward_model, demonstrations.episodes)
        reports, first = [], len(self.reports)
        try:
            for shown in demonstrations:
                with full_precision(), defer_sigint():
                    reports.append(self._learn_one(demonstrations, shown, corrections))
                if progress is not None:
                    progress(len(shown.state))
        finally:
            if self.cameras is not None:
                self._look_at(whole, hands, first)
        return reports

    def step(
        self,
        percept: NDArray[np.float32] | Tensor,
        pictures: Mapping[str, NDArray[np.uint8]] | None = None,
    ) -> ImitatorStep:
        """Return the action at one percept, continuing from the last call; nothing is learned.

        Args:
            percept: `[D]`, an array or a tensor on the CPU, float32; with cameras, without what
                they tell.
            pictures: camera -> its picture, uint8 `[H, W, 3]`, of any size; only with cameras, and
                while `is_looking`.

        Raises:
            ValueError: wrong shape or dtype, not finite, or a camera without a picture; nothing has
                changed.
        """
        percept = check_row("percept", percept, self.config.perceived_dimensions)
        known = self._latest()  # a new state begins a new episode, which is to keep what it sees
        with np.errstate(over="ignore"):  # refused below
            scaled = percept * self._scale[: len(percept)]
        if not np.abs(scaled).max() <= MAX_VALUE:  # NaN is not
            raise ValueError(
                f"expected a finite percept within ±{MAX_VALUE:g}, scaled, got {percept.tolist()}"
            )
        goals = None
        if self.cameras is not None:
            seen = self._see(pictures)
            if seen.doubt > 1:
                return _unseen(seen, self.cameras.features)
            goals = seen.goals
            if self.config.tells_places:
                percept = np.concatenate([percept, goals])
                scaled = percept * self._scale
        if known.framed is not None and self.frames is not None:
            end = _END * self.config.fps
            names = self.config.point_dimensions
            return framed_step(percept, known.framed, self.frames.config, names, end)
        if self.cameras is not None and goals is not None:
            known = self._warp(known, self.cameras, goals)
        return self._step(percept, scaled, known)

    @property
    def is_looking(self) -> bool:
        """Whether the next step looks at pictures; later in an episode the hand is in the way."""
        return self.cameras is not None and (self._sight is None or self._sight.last is None)

    def _see(self, pictures: object) -> Seen:
        """Return what the cameras tell in this episode by now."""
        assert self.cameras is not None
        with self.state_lock:
            sight = self._sight or self.cameras.begin()
        seen = sight.last or sight(self.cameras.checked(pictures))
        self._sight = sight
        return seen

    def _hands(self, demonstrations: Demonstrations) -> Hands:
        """Return where the hand is in each demonstration, or its posture; none without cameras."""
        if self.cameras is None:
            return []
        check_pictured(demonstrations, self.config)
        if not self.config.tells_places:
            return postures_of(demonstrations, self.config)
        body = None if self.frames is None else self.frames.body
        return hands_of(demonstrations, place_of_hand(self.config), body)

    def _warp(self, known: Known, cameras: Cameras, goals: NDArray[np.float32]) -> Known:
        """Return what is known, with the goals that the cameras tell."""
        with self.state_lock:  # another thread may be learning
            told = cameras.goals_shown()
        last = self._warped
        if last is None or not last.is_of(known.shown, known.allowed, told, goals):
            last = warp(known.shown, known.allowed, told, goals, self.reports, self.config)
            self._warped = last
        return known._replace(shown=last.shown, allowed=last.nearest)

    def _look_at(self, whole: Demonstrations, hands: Hands, first: int) -> None:
        """Let the cameras learn from the whole demonstrations that were learned.

        Args:
            whole: as they came, of which a part may have been learned.
            hands: where the hand is in them.
            first: number of the first one's report.
        """
        assert self.cameras is not None
        numbers = first + np.cumsum([0, *(len(shown.gaps) + 1 for shown in whole)])
        learned = int(np.searchsorted(numbers[1:], len(self.reports), side="right"))
        episodes = whole.episodes[:learned]
        if not episodes:
            return
        with self.learning_lock, torch.inference_mode(False):
            draft = draft_of(self.cameras)
            part = replace(whole, episodes=episodes)
            draft.add(part, hands[:learned], numbers[:learned].tolist())
            with self.state_lock:
                adopt(self.cameras, draft)

    def _step(
        self, percept: NDArray[np.float32], scaled: NDArray[np.float32], known: Known
    ) -> ImitatorStep:
        """Return the action without frames of reference."""
        from pacnet.competition.following_kernels import follow  # imports numba

        shown, state = known.shown, known.state
        wanted = np.empty(self.config.target_dimensions)
        follow(scaled, shown, known.allowed, state, known.settings, known.correction, wanted)
        nearest, heaviest = state.nearest.item(), state.heaviest.item()
        score = known.detector.score(scaled, None if nearest < 0 else shown.percepts[nearest])
        is_novel = not score.novelty <= NOVEL  # NaN, which cannot be compared, counts as novel
        target = None if heaviest < 0 else wanted.astype(np.float32)
        action = None if target is None else self._action(percept, target)
        unit = known.correction.unit[score.dimension].item()
        return ImitatorStep(
            None if is_novel else action,
            is_novel,
            score.novelty,
            self.percept_names[score.dimension],
            score.deviation * unit,
            score.threshold * unit,
            state.progress.item(),
            heaviest >= 0 and _is_at_end(known, state, heaviest, self.config.fps),
            _followed(known, state),
            target,
        )

    def _action(
        self, percept: NDArray[np.float32], target: NDArray[np.float32]
    ) -> NDArray[np.float32] | None:
        model, config = self.forward_model, self.config
        if model is None:
            return target
        size = config.state_dimensions
        action = model.command_one(percept[:size], target[:size])
        if action is not None:
            action[list(config.still_actions)] = target[size:]
        return action

    def warm_up(self) -> None:
        """Trigger JIT compilation, which takes seconds, then start a new recall episode."""
        task = self._task
        with torch.inference_mode(False):
            shown = self._latest().shown
            percept = shown.percepts[0] if len(shown.percepts) else np.zeros_like(self._scale)
            percept = (percept / self._scale)[: self.config.perceived_dimensions]
            pictures = None if self.cameras is None else self.cameras.pictures_shown()
            for _ in range(2):  # the second is compared with the first
                self.step(percept, pictures)
        self.reset(task)

    def seen(self, demonstrations: Demonstrations) -> Demonstrations:
        """Return demonstrations as they are perceived: with where cameras tell the hand will be.

        They tell it as while acting, from each frame's pictures. A recall episode in progress is
        not affected.

        Args:
            demonstrations: with pictures of the cameras, if there are any.

        Raises:
            ValueError: an episode lacks a camera, or its pictures have another aspect.
        """
        if self.cameras is None or not self.config.tells_places:
            return demonstrations
        return self.cameras.seen(demonstrations)

    def follow(self, shown: Demonstration) -> Iterator[ImitatorStep]:
        """Yield the step at each frame of an episode, going on from the last call of `step`.

        Args:
            shown: as it was recorded, with pictures of the cameras, if there are any.

        Raises:
            ValueError: as of `step`, with the episode's number.
        """
        percepts, pictures = shown.percepts.numpy(), shown.pictures
        for frame, percept in enumerate(percepts):
            try:
                yield self.step(percept, {name: own[frame] for name, own in pictures.items()})
            except ValueError as error:
                raise ValueError(f"episode {shown.episode}, frame {frame}: {error}") from None

    def reset(self, task: str | None = None) -> None:
        """Start a new recall episode; what was learned stays.

        Args:
            task: what is to be done, in the words of the demonstrations; only what was shown for it
                is followed then. None for whatever fits.

        Raises:
            ValueError: an unknown task; nothing has changed.
        """
        if task is not None:
            known = self.tasks
            if not isinstance(task, str) or task_name(task) not in known:
                listed = ", ".join(map(repr, known)) or "none"
                raise ValueError(f"expected a task that was shown: {listed}, got {task!r}")
            task = task_name(task)
        with self.state_lock:
            self._task, known = task, self._known
            if known is not None:
                self._known = self._take()
            self.follower.reset()
            self._sight = None
            if self._framed_follower is not None:
                self._framed_follower.reset()
            self.novelty_detector.reset()
            if self.forward_model is not None:
                self.forward_model.reset()

    @torch.no_grad()
    def recognise(self, percepts: Tensor) -> Recognition:
        """Recognize which task is shown, without acting; each call begins a new episode.

        Novelty is that of `step`. A recall episode in progress is not affected.

        Args:
            percepts: `[T ≥ 1, D]`, in order of time.

        Raises:
            ValueError: nothing was learned yet; percepts of the wrong shape or dtype, or not
                finite.
        """
        normalized = self.sofm.normalize(percepts)
        with self.state_lock:
            shown, tasks = self.memory.whole(), self.tasks
            detector = snapshot_of(self.novelty_detector)
            attention = self.sofm.read(normalized)
            framed = None if self.frames is None else self._current().framed
        factor = (self.sofm.scale.numpy() / self._scale).astype(np.float32)[None]
        recognizer = recognizer_of(shown, len(tasks), factor)
        probability, task, progress, soon, end, _ = recognizer.columns(normalized.numpy())
        if framed is None or self.frames is None:
            seen = detector.novelty(percepts.numpy() * self._scale, shown)
        else:
            seen = self.frames.novelty(percepts.numpy(), framed.bounds)
        novelty = torch.from_numpy(seen.astype(np.float32))
        return Recognition(
            probability,
            task,
            progress,
            soon / self.sofm.scale,
            end / self.sofm.scale,
            novelty,
            novelty > NOVEL,
            torch.where(attention.novelty, NO_NODE, attention.winner),
        )

    def _targets(self, shown: Demonstration) -> Tensor:
        """Return what is stored of a demonstration, `[T, A]`."""
        config = self.config
        if config.targets == "action":
            return shown.action
        ahead = targets_ahead(shown.state, config.lead)
        return torch.cat([ahead, shown.action[:, list(config.still_actions)]], dim=1)

    def _largest_novelty(
        self, percepts: Tensor, known: Known, without: float | None
    ) -> float | None:
        """Return the largest novelty of a demonstration, beside what was known before it.

        Args:
            percepts: `[T, D]`.
            known: before it.
            without: the same without frames of reference.
        """
        if self.frames is None or known.framed is None:
            return without
        return float(self.frames.novelty(percepts.numpy(), known.framed.bounds).max())

    def _mean_first_action(self, shown: Demonstration) -> Tensor:
        """Return the mean first action `[U]` once this demonstration is learned."""
        starts = [report.first_frame == 0 for report in self.reports if not report.correction]
        if any(starts) and shown.first_frame > 0:
            return self.first_action
        before = sum(starts) if shown.first_frame == 0 else len(starts)
        mean = self.first_action if before else torch.zeros_like(self.first_action)
        return mean + (shown.action[0] - mean) / (before + 1)

    def _learn_one(
        self, demonstrations: Demonstrations, shown: Demonstration, correction: bool
    ) -> EpisodeReport:
        """Learn on a draft, which then replaces the state, all at once."""
        with self.learning_lock, short_switch_interval(), torch.inference_mode(False):
            number, config, known = len(self.reports), self.config, self._latest()
            correction = correction and number > 0  # the first has nothing to correct
            with self.state_lock:
                draft = Draft(
                    self.sofm, self.memory, self.correction, self.novelty_detector, self.frames
                )
            if draft.frames is not None:
                draft.frames.fit(demonstrations)
            targets = self._targets(shown)
            tasks, name = self.tasks, task_name(shown.task)
            task = tasks.index(name) if name in tasks else len(tasks)
            begins = how_begins(
                demonstrations.source, shown, correction, self.reports[-1] if number else None
            )
            observed, novelty = draft.learn(
                shown.percepts, targets.numpy(), task, correction, config, begins
            )
            first_action = self.first_action if correction else self._mean_first_action(shown)
            report = EpisodeReport(
                demonstrations.source,
                index(shown.episode),
                shown.task,
                len(shown.state),
                new_nodes=int(observed.inserted.sum()),
                nodes=len(draft.sofm),
                novel_share=float(observed.novelty.float().mean()),
                max_novelty=self._largest_novelty(shown.percepts, known, novelty),
                correction=correction,
                first_frame=index(shown.first_frame),
            )
            with self.state_lock:
                draft.replace()
                self._buffers["first_action"] = first_action
                self.reports.append(report)
                if draft.renumbered:
                    self._begin_again()
                elif self._known is not None:
                    self._known = self._take()
        return report


def _unseen(seen: Seen, features: Sequence[str]) -> ImitatorStep:
    """Return a step at pictures that are novel: nothing is done."""
    name, doubt = features[seen.camera], seen.doubt
    return ImitatorStep(None, True, doubt, name, doubt, 1.0, 0.0, False, (), None)


def _is_at_end(known: Known, state: State, slot: int, fps: float) -> bool:
    """Return whether a followed demonstration is in its last tenth of a second that is kept."""
    number, shown = state.demonstration[slot], known.shown
    last = shown.time[shown.first[number + 1] - 1]
    return bool(shown.time[state.row[slot]] >= last - _END * fps)


def _followed(known: Known, state: State) -> tuple[Followed, ...]:
    """Return the demonstrations that decide, the largest weight first."""
    slots = state.weight.nonzero()[0]
    frames = known.shown.frame[state.row[slots]].tolist()
    numbers, weights = state.demonstration[slots].tolist(), state.weight[slots].tolist()
    followed = map(Followed, numbers, frames, weights)
    return tuple(sorted(followed, key=lambda one: -one.weight))

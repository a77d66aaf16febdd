"""Imitation of what a LeRobot dataset shows: automatic settings, named dimensions, novelty.

The parts are those of Maistros, Marom & Hayes (2001): attention, motor schemas, competition and a
forward model. One rule decides whether it acts: it does unless the percept is novel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from functools import partial
from operator import index
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention.records import NO_NODE
from pacnet.competition.recognition import Recognition
from pacnet.core.drafts import short_switch_interval, snapshot_of
from pacnet.core.growable_rows import check_storage
from pacnet.core.interrupts import defer_sigint
from pacnet.core.old_names import warn_renamed
from pacnet.core.validation import MAX_VALUE, check_row
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.imitator.auto_config import choose_settings
from pacnet.imitator.checks import check_demonstrations
from pacnet.imitator.followed_step import followed_step
from pacnet.imitator.forward_model import fit
from pacnet.imitator.framed_step import framed_step
from pacnet.imitator.learning import Draft, how_begins, mean_first_action, targets_of
from pacnet.imitator.novelty import NOVEL
from pacnet.imitator.points import PointsChoice
from pacnet.imitator.recognizing import recognizer_of
from pacnet.imitator.records import EpisodeReport, ImitatorStep, task_name
from pacnet.imitator.seeing import Hands, see
from pacnet.imitator.state import ImitatorState, Known
from pacnet.kernels.engine import Engine
from pacnet.vision.fitting import CameraReport

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
        settings = partial(choose_settings, targets=targets, lead=lead, budget=budget, body=body)
        seeing = see(demonstrations, points, body, encoder, settings)
        imitator = cls(seeing.config, engine)
        imitator.camera_reports = seeing.reports
        if seeing.cameras is not None and imitator.cameras is not None:
            imitator.cameras.load_state_dict(seeing.cameras.state_dict())
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
        hands: Hands = []
        if self._looking is not None:
            body = None if self.frames is None else self.frames.body
            demonstrations, hands = self._looking.perceived(demonstrations, body)
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
            if self._looking is not None:
                rows = self.memory.demonstrations.live("rows").numpy()
                self._looking.learn(whole, hands, first, rows > 0)
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
        percept = self._checked(percept)
        known = self._latest()  # a new state begins a new episode, which is to keep what it sees
        if self._looking is not None:
            seen = self._looking(pictures)
            if seen.doubt > 1:
                return self._looking.unseen(seen)
            if self.config.tells_places:
                percept = np.concatenate([percept, seen.goals])
            else:
                bent = self._looking.warped(known.shown, known.allowed, self.reports, seen)
                known = known._replace(shown=bent.shown, allowed=bent.nearest)
        end = _END * self.config.fps
        if known.framed is not None and self.frames is not None:
            names = self.config.point_dimensions
            step = framed_step(percept, known.framed, self.frames.config, names, end)
        else:
            scaled = percept * self._scale
            step = followed_step(percept, scaled, known, self.config, self.forward_model, end)
        if self._looking is not None and step.action is not None:
            self._looking.acted()
        return step

    def _checked(self, percept: NDArray[np.float32] | Tensor) -> NDArray[np.float32]:
        """Return a percept, without what cameras tell, of which no number is too large."""
        percept = check_row("percept", percept, self.config.perceived_dimensions)
        with np.errstate(over="ignore"):  # refused below
            largest = np.abs(percept * self._scale[: len(percept)]).max()
        if not largest <= MAX_VALUE:  # NaN is not
            raise ValueError(
                f"expected a finite percept within ±{MAX_VALUE:g}, scaled, got {percept.tolist()}"
            )
        return percept

    @property
    def is_looking(self) -> bool:
        """Whether the next step looks at pictures; later in an episode the hand is in the way."""
        return self._looking is not None and self._looking.is_on

    def warm_up(self) -> None:
        """Trigger JIT compilation, which takes seconds, then start a new recall episode."""
        task = self._task
        with torch.inference_mode(False):
            shown = self._latest().shown
            percept = shown.percepts[0] if len(shown.percepts) else np.zeros_like(self._scale)
            percept = (percept / self._scale)[: self.config.perceived_dimensions]
            pictures = None if self._looking is None else self._looking.pictures()
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
        return demonstrations if self._looking is None else self._looking.seen(demonstrations)

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
            if self._looking is not None:
                self._looking.reset()
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
            targets = targets_of(shown, config)
            tasks, name = self.tasks, task_name(shown.task)
            task = tasks.index(name) if name in tasks else len(tasks)
            begins = how_begins(
                demonstrations.source, shown, correction, self.reports[-1] if number else None
            )
            observed, novelty = draft.learn(
                shown.percepts, targets.numpy(), task, correction, config, begins
            )
            first_action = self.first_action
            if not correction:
                first_action = mean_first_action(first_action, self.reports, shown)
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
                    self._forget_derived()
                elif self._known is not None:
                    self._known = self._take()
        return report

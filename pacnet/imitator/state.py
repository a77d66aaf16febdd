"""The state of an imitator: learning replaces it all at once, while other threads read it."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacnet.attention.sofm import HabituatingSOFM
from pacnet.competition.following import Follower, Settings, State
from pacnet.competition.framed_following import FramedFollower
from pacnet.core.checkpoint import load_checkpoint, save_checkpoint
from pacnet.core.drafts import BufferVersions, Lock, snapshot_of
from pacnet.core.growable_rows import copy_on_state_dict
from pacnet.core.integrity import (
    check_conditions,
    check_model,
    check_on_load,
    check_structure,
    part_of,
)
from pacnet.core.old_names import old_names
from pacnet.forward_models.correction import Correction, LinearCorrection
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.cuts import ShownCut, cuts_of
from pacnet.imitator.forward_model import Model, class_of, make_model
from pacnet.imitator.framed import FramedKnown, FramedSchemas
from pacnet.imitator.looking import Looking
from pacnet.imitator.novelty import NoveltyDetector
from pacnet.imitator.records import EpisodeReport, read_reports, task_name
from pacnet.kernels.engine import Engine
from pacnet.schemas.demonstration_memory import DemonstrationMemory, Shown
from pacnet.schemas.scene import Scene
from pacnet.schemas.segments import NO_SEGMENT
from pacnet.vision.cameras import Cameras

_MODEL = "forward_model"


class Known(NamedTuple):
    """What `Imitator.step` works on while another thread may learn."""

    shown: Shown
    correction: Correction
    settings: Settings
    detector: NoveltyDetector
    allowed: NDArray[np.bool_]
    """Which demonstrations are of the task that was asked for, `[E]`."""
    state: State
    """The recall episode, which refers to rows of these demonstrations."""
    framed: FramedKnown | None
    """The same in frames of reference; None without them, and before anything was learned."""


@old_names(lessons="reports", familiarity="novelty_detector")
class ImitatorState(nn.Module):
    """The parts of an `Imitator`, which may `step` in one thread while another learns.

    Args:
        config: see `ImitatorConfig`.
        engine: as of `HabituatingSOFM`.
    """

    first_action: Tensor  # [U], mean over the demonstrations, see `Imitator.learn`

    def __init__(self, config: ImitatorConfig, engine: Engine = "auto") -> None:
        super().__init__()
        self.config = config
        dimensions, targets = config.attention.dimensions, config.target_dimensions
        self.sofm = HabituatingSOFM(config.attention, engine)
        self.memory = DemonstrationMemory(dimensions, targets)
        self.correction = LinearCorrection(dimensions, targets)
        self.novelty_detector = NoveltyDetector(dimensions, config.fps)
        self.forward_model: Model | None = make_model(config.forward_model)
        frames = config.frames
        self.frames = None if frames is None else FramedSchemas(frames, config.fps)
        self.cameras = None if config.cameras is None else Cameras(config.cameras)
        self.reports: list[EpisodeReport] = []
        self.register_buffer("first_action", torch.zeros(len(config.action)))
        # One thread learns at a time. The state itself is locked only while it is replaced or read.
        self.learning_lock, self.state_lock = Lock(), Lock()
        self._looking: Looking | None = None
        if self.cameras is not None:
            self._looking = Looking(self.cameras, config, self.learning_lock, self.state_lock)
        self._task: str | None = None  # that was asked for
        self._begin_again()
        copy_on_state_dict(self)
        check_on_load(self)

    def extra_repr(self) -> str:
        """Return the number of demonstrations learned and the dimensions, for `print`."""
        percepts, actions = len(self.percept_names), len(self.config.action)
        lengths = f"percept_dimensions={percepts}, action_dimensions={actions}"
        return f"demonstrations={len(self.reports)}, {lengths}, fps={self.config.fps}"

    @property
    def percept_names(self) -> tuple[str, ...]:
        """Names of a percept's D dimensions."""
        return self.config.percept_names

    @property
    def tasks(self) -> tuple[str, ...]:
        """What was shown, in words, in order of first use."""
        return tuple(dict.fromkeys(task_name(report.task) for report in self.reports))

    @property
    def cuts(self) -> tuple[ShownCut, ...]:
        """How each demonstration is cut, in the order of the reports; none without points."""
        known = self._latest().framed
        if known is None or self.frames is None:
            return ()
        landmark = self.frames.segments.columns()["landmark"]
        points = self.frames.config.points
        return cuts_of(known.segments, landmark, known.frame, points, len(self.reports))

    def followed_scene(self) -> Scene:
        """Return where the points are in this episode, and were at the moment followed: two rows.

        Raises:
            ValueError: no segment is followed.
        """
        known = self._latest().framed
        if known is None or known.follower.state.segment.item() == NO_SEGMENT:
            raise ValueError("expected an episode in which a segment is followed")
        state, segments, row = known.follower.state, known.segments, known.follower.state.row.item()
        places, turns = (state.places, segments.places[row]), (state.turns, segments.turns[row])
        return Scene(np.stack(places), np.stack(turns))

    def _begin_again(self) -> None:
        """Begin a new recall episode with a state that has changed."""
        self._forget_derived()
        if self._looking is not None:
            self._looking.reset()

    def _forget_derived(self) -> None:
        """Forget what was derived from demonstrations, and where an episode is in them."""
        config = self.config
        recent = config.scaling.recent(config.fps)
        self.follower = Follower(recent, config.scaling.change_ratio, config.fps)
        self._framed_follower = None
        if self.frames is not None:
            self.frames.forget_derived()
            actions = len(config.action)
            self._framed_follower = FramedFollower(self.frames.config, actions, config.fps)
        self._scale = config.scaling.array
        self._known: Known | None = None
        self._versions: BufferVersions | None = None  # of the state that the follower refers to

    def _latest(self) -> Known:
        """Return what is known now; the same object until something is learned."""
        known, versions = self._known, self._versions
        if known is None or versions is None or not versions.unchanged():
            with self.state_lock:  # another thread may just have learned
                known = self._current()
        return known

    def _current(self) -> Known:
        """Return what is known now; no thread may be changing it."""
        versions = self._versions
        if versions is None:
            self._forget_derived()  # what was made from a state before a body was loaded, say
        elif not versions.unchanged():
            self._begin_again()  # rows may be others now
        known = self._known
        if known is None:
            self._known = known = self._take()
        return known

    def _take(self) -> Known:
        """Return what is known; no thread may be changing it."""
        shown, config = self.memory.whole(), self.config
        for part in (self.correction, self.novelty_detector):
            part.check_state(part.state_dict())
        correction = Correction(
            np.array(config.follows, np.int64),
            1 / np.array(config.scaling.scale),
            config.follows_after,
            self.correction.gain(),
        )
        allowed = self._allowed(shown)
        parts = [self.memory, self.correction, self.novelty_detector]
        framed = None
        if self.frames is not None and self._framed_follower is not None:
            framed = self.frames.known(shown, correction.unit, allowed, self._framed_follower)
            parts.append(self.frames)
        self._versions = BufferVersions(*parts)
        return Known(
            shown,
            correction,
            self.follower.settings(shown, correction),
            snapshot_of(self.novelty_detector),
            allowed,
            self.follower.state,
            framed,
        )

    def _allowed(self, shown: Shown) -> NDArray[np.bool_]:
        """Return which demonstrations are of the task that was asked for."""
        if self._task is None:
            return np.ones(len(shown.frames), bool)
        return shown.task == self.tasks.index(self._task)

    def fork(self) -> Self:
        """Return an imitator that knows the same, with a recall episode of its own.

        Demonstrations are shared in memory. What either learns later is not the other's.
        """
        with self.state_lock, torch.inference_mode(False):
            shared = {id(self.memory): self.memory.fork(), id(self.reports): [*self.reports]}
            other = copy.deepcopy(self, shared)
            other._task = None
            other._begin_again()
            other.novelty_detector.reset()
            if other.forward_model is not None:
                other.forward_model.reset()
        return other

    def __getstate__(self) -> dict[str, Any]:
        """Leave out of copies what they take anew."""
        return {**self.__dict__, "_known": None}

    # Checkpoints

    def save_pretrained(self, folder: str | Path) -> None:
        """Write `config.json` and `model.safetensors`, atomically.

        After a crash the old or the new checkpoint is intact.

        Args:
            folder: made if it is missing; a checkpoint in it is replaced, other files stay.

        Raises:
            ValueError: tensors that contradict one another; nothing has been written.
        """
        with self.state_lock:
            tensors, reports = self.state_dict(), [report._asdict() for report in self.reports]
        self.check_state(tensors)
        self._check_reports(tensors["memory.demonstrations.task"].tolist(), len(reports))
        save_checkpoint(folder, "Imitator", {**asdict(self.config), "reports": reports}, tensors)

    @classmethod
    def from_pretrained(cls, folder: str | Path, engine: Engine = "auto") -> Self:
        """Load what `save_pretrained` wrote, on the CPU, ready to act or to learn more.

        Raises:
            FileNotFoundError: no checkpoint there.
            ValueError: a damaged file, an unknown version, the checkpoint of something else, or a
                missing, extra or misshapen tensor.
        """
        fields, tensors = load_checkpoint(folder, "Imitator")
        if "network" in fields:
            raise ValueError(
                f"expected an Imitator that keeps whole demonstrations in '{folder}', got one of "
                "version 0.1, which kept parts of them: learn its demonstrations again, with "
                "`pacnet fit`"
            )
        reports = read_reports(fields.pop("reports", None))
        config = ImitatorConfig.from_dict(fields)
        try:
            if config.forward_model is not None:
                part = part_of(tensors, _MODEL + ".")
                class_of(config.forward_model).check_sizes(config.forward_model, part)
            _check_width(config, tensors)
            imitator = cls(config, engine)
            imitator.load_state_dict(tensors)
            imitator.reports = reports
            imitator._check_reports(tensors["memory.demonstrations.task"].tolist(), len(reports))
        except (RuntimeError, ValueError) as error:
            reason = " ".join(str(error).split())  # torch's messages have several lines
            raise ValueError(
                f"expected the tensors of an Imitator in '{folder}': {reason}"
            ) from error
        return imitator

    def state_dict(self, *args: Any, **kwargs: Any) -> Any:
        """Return the state; where another thread learns, that of before or after it."""
        with self.state_lock:
            return super().state_dict(*args, **kwargs)

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Load a state, all or nothing, once other threads have finished learning."""
        with self.learning_lock, self.state_lock:
            check_model(self.forward_model, part_of(state_dict, _MODEL + "."), strict)
            return super().load_state_dict(state_dict, strict, assign)

    def check_state(self, tensors: Mapping[str, Tensor]) -> None:
        """Raise a ValueError unless these tensors, of a `state_dict`, are the state of one."""
        check_structure(self, tensors)
        check_conditions({"a finite first action": tensors["first_action"].isfinite().all()})
        if self.frames is not None:
            own, memory = part_of(tensors, "frames."), part_of(tensors, "memory.")
            self.frames.check_cuts(own, self.memory.frames_of(memory))

    def _check_reports(self, task: list[int], count: int) -> None:
        """Raise a ValueError unless each demonstration has a report, and its task's number."""
        if len(task) != count:
            raise ValueError(
                f"expected a report of each of {len(task)} demonstrations learned, got {count}"
            )
        if self.cameras is not None:
            self.cameras.check_shown(count)
        known = self.tasks
        numbers = [known.index(task_name(report.task)) for report in self.reports[:count]]
        if task != numbers:
            raise ValueError(f"expected demonstrations of the tasks {numbers}, got {task}")


def _check_width(config: ImitatorConfig, tensors: Mapping[str, Tensor]) -> None:
    """Raise a ValueError unless percepts are as long as in the tensors, before memory is made."""
    percepts, width = tensors.get("memory.rows.percept"), config.attention.dimensions
    if percepts is None or percepts.dim() != 2 or percepts.shape[1] != width:
        got = "none" if percepts is None else list(percepts.shape)
        raise ValueError(f"expected memory.rows.percept of shape [rows, {width}], got {got}")

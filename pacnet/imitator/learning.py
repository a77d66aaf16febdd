"""What one demonstration changes: the map, the memory, the linear correction, the thresholds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.attention.records import Observation
from pacnet.attention.sofm import HabituatingSOFM
from pacnet.core.drafts import adopt, draft_of
from pacnet.core.validation import MAX_VALUE
from pacnet.datasets.demonstrations import Demonstration
from pacnet.forward_models.correction import LinearCorrection
from pacnet.imitator.budget import importances, kept_rows
from pacnet.imitator.config import ImitatorConfig
from pacnet.imitator.framed import FramedSchemas
from pacnet.imitator.novelty import NoveltyDetector, strides
from pacnet.imitator.records import EpisodeReport, task_name
from pacnet.schemas.demonstration_memory import DemonstrationMemory
from pacnet.schemas.keyframes import fitted, keyframes
from pacnet.schemas.segments import CONTINUES, MIDDLE, WHOLE
from pacnet.schemas.targets import targets_ahead

_APART = 0.05  # [s] between the frames of a single demonstration that are compared


def how_begins(
    dataset: str, shown: Demonstration, correction: bool, before: EpisodeReport | None
) -> int:
    """Return how a demonstration begins: `WHOLE`, `CONTINUES` or `MIDDLE`.

    Corrections of one episode are demonstrations of their own unless only time is missing between
    them, not frames.

    Args:
        dataset: name of its dataset.
        shown: the demonstration.
        correction: whether it shows what to do where percepts were novel.
        before: the report of the demonstration learned before it, if any.
    """
    if shown.first_frame == 0:
        return WHOLE
    own = dataset, shown.episode, task_name(shown.task), correction
    if before is None or own != (
        before.dataset, before.episode, task_name(before.task), before.correction
    ):  # fmt: skip
        return MIDDLE
    if correction:
        continues = shown.first_frame == before.first_frame + before.frames
    else:
        continues = shown.first_frame > before.first_frame
    return CONTINUES if continues else MIDDLE


def targets_of(shown: Demonstration, config: ImitatorConfig) -> Tensor:
    """Return what is stored of a demonstration, `[T, A]`."""
    if config.targets == "action":
        return shown.action
    ahead = targets_ahead(shown.state, config.lead)
    return torch.cat([ahead, shown.action[:, list(config.still_actions)]], dim=1)


def mean_first_action(
    mean: Tensor, reports: Sequence[EpisodeReport], shown: Demonstration
) -> Tensor:
    """Return the mean first action `[U]` once a demonstration, no correction, is learned.

    Args:
        mean: that of before.
        reports: of what was learned before.
        shown: the demonstration.
    """
    starts = [report.first_frame == 0 for report in reports if not report.correction]
    if any(starts) and shown.first_frame > 0:
        return mean
    before = sum(starts) if shown.first_frame == 0 else len(starts)
    mean = mean if before else torch.zeros_like(mean)
    return mean + (shown.action[0] - mean) / (before + 1)


class Draft:
    """The parts of an imitator while it learns a demonstration."""

    def __init__(
        self,
        sofm: HabituatingSOFM,
        memory: DemonstrationMemory,
        correction: LinearCorrection,
        detector: NoveltyDetector,
        frames: FramedSchemas | None,
    ) -> None:
        self.sofm = draft_of(sofm)
        self.memory = memory.snapshot()  # appending leaves what is there
        self.correction, self.detector = draft_of(correction), draft_of(detector)
        self.renumbered = False  # whether rows of the memory have other numbers now
        self.frames = None if frames is None else draft_of(frames)
        self._replaced = sofm, memory, correction, detector, frames

    def learn(
        self,
        percepts: Tensor,
        targets: NDArray[np.float32],
        task: int,
        correction: bool,
        config: ImitatorConfig,
        begins: int,
    ) -> tuple[Observation, float | None]:
        """Learn one demonstration.

        Args:
            percepts: `[T, D]`.
            targets: `[T, A]`.
            task: its number.
            correction: whether it shows what to do where percepts were novel.
            config: of the imitator.
            begins: how; see `SegmentMemory.append`.

        Returns:
            What the map did, and the largest novelty before; None for the first demonstration, and
            with frames of reference, where neither correction nor thresholds are used.
        """
        observed = self.sofm.update(self.sofm.normalize(percepts)).observation
        scaled = np.ascontiguousarray(percepts.numpy() * config.scaling.array)
        novelty = None
        if self.frames is None:
            novelty = self._relate(scaled, targets, task, config.fps)
        changes = config.scaling.recent(config.fps).changes(scaled)
        changes = (changes * config.scaling.change_ratio).clip(-MAX_VALUE, MAX_VALUE)
        self.memory.append(scaled, changes.astype(np.float32), targets, task, correction)
        if self.frames is not None:
            whole, unit = self.memory.whole(), 1 / np.array(config.scaling.scale)
            self.frames.cut(len(self.memory) - 1, percepts.numpy(), begins, whole, unit)
        if config.budget is not None:
            self._forget(config, config.budget)
        if self.frames is not None:
            return observed, novelty
        if not correction and self.detector.is_due(len(self.memory)):
            self.detector.calibrate(self.memory.whole())
        return observed, novelty

    def _relate(
        self, percepts: NDArray[np.float32], targets: NDArray[np.float32], task: int, fps: float
    ) -> float | None:
        """Compare a demonstration with its neighbours; return its largest novelty."""
        shown = self.memory.whole()
        if not (shown.task == task).any():
            apart = max(1, round(_APART * fps))
            deviations = percepts[apart:] - percepts[:-apart]
            self.correction.add(deviations, targets[apart:] - targets[:-apart], within=True)
        if len(shown.percepts) == 0:
            return None
        novelty, rows = self.detector.largest(percepts, shown)
        frames = np.arange(0, len(percepts), strides(shown)).repeat(rows.shape[1])
        rows = rows.ravel()
        of = np.searchsorted(shown.first, rows, side="right") - 1
        alike = (rows >= 0) & (shown.task[of] == task)  # other tasks differ for other reasons
        frames, rows = frames[alike], rows[alike]
        deviations = percepts[frames] - shown.percepts[rows]
        self.correction.add(deviations, targets[frames] - shown.targets[rows], within=False)
        return novelty

    def _forget(self, config: ImitatorConfig, budget: int) -> None:
        """Keep the keyframes of the last demonstration, and of all no more than the budget."""
        shown = self.memory.shown()
        before = None if self.frames is None else self.memory.whole()
        first = shown.first[-2].item()
        columns = {"percept": shown.percepts, "change": shown.changes, "target": shown.targets}
        frames, important = keyframes(
            shown.percepts[first:], budget, config.fps, config.scaling.movement
        )
        rows = np.r_[np.arange(first), first + frames]
        keys = shown._replace(
            percepts=shown.percepts[rows],
            frame=shown.frame[rows],
            first=np.r_[shown.first[:-1], len(rows)],
        )
        parts = np.arange(len(shown.frames)) if self.frames is None else self.frames.episodes()
        kept = rows[kept_rows(keys, importances(keys, important), parts, budget)]
        own = kept[kept >= first] - first
        last = {name: fitted(column[first:], own) for name, column in columns.items()}
        self.memory.select(np.isin(np.arange(len(shown.percepts)), kept), last)
        if self.frames is not None and before is not None:
            self.frames.cut_again(before, self.memory.whole())
        self.renumbered = True

    def replace(self) -> None:
        """Let the parts that the draft is of adopt what was learned."""
        sofm, memory, correction, detector, frames = self._replaced
        adopt(sofm, self.sofm)
        memory.adopt(self.memory)
        adopt(correction, self.correction)
        adopt(detector, self.detector)
        if frames is not None and self.frames is not None:
            adopt(frames, self.frames)

"""`PACNet` for a LeRobot dataset: automatic settings, named dimensions, novelty.

The network is that of Maistros, Marom & Hayes (2001).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from operator import index
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacnet.core.drafts import adopt, draft_of
from pacnet.core.growable_rows import check_storage
from pacnet.core.interrupts import defer_sigint
from pacnet.core.old_names import warn_renamed
from pacnet.core.validation import check_row
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.imitator.auto_config import choose_settings
from pacnet.imitator.checks import check_demonstrations
from pacnet.imitator.records import EpisodeReport, ImitatorStep
from pacnet.imitator.state import ImitatorSnapshot, ImitatorState
from pacnet.kernels.engine import Engine
from pacnet.schemas.sequences import compact
from pacnet.schemas.targets import targets_ahead


def full_precision() -> AbstractContextManager[object]:
    """Compute distances in full precision, also inside a caller's mixed precision."""
    return torch.autocast("cpu", enabled=False)


class Imitator(ImitatorState):
    """Learns from demonstrations, one after the other, and acts on percepts like theirs.

    `from_demonstrations` makes one. Percepts unlike the training data are flagged as novel and get
    no action.

    One thread may `step` while another learns: it acts on the state before a demonstration, or on
    the state after it.

    Args:
        config: see `ImitatorConfig`.
        engine: as of `PACNet`.

    Attributes:
        reports: of each demonstration learned, or of each part of it between gaps; the network's
            episode number k is `reports[k]`.

    Example:
        >>> phase = torch.linspace(0, 1.5, 200)[:, None]
        >>> shown = Demonstration(0, "wave", phase.sin(), torch.empty(200, 0), phase.cos())
        >>> names = {"observation.state": ("elbow",), "action": ("motor",)}
        >>> demonstrations = Demonstrations(50, names, (shown,), "waving")
        >>> imitator = Imitator.from_demonstrations(demonstrations)
        >>> [report.new_nodes for report in imitator.learn(demonstrations)]
        [5]
        >>> imitator.step(np.float32([0.5])).action.round(1)
        array([0.9], dtype=float32)
        >>> imitator.step(np.float32([3.0])).action is None
        True
    """

    @classmethod
    def from_demonstrations(
        cls,
        demonstrations: Demonstrations,
        targets: Literal["action", "state"] = "action",
        lead: int = 1,
        engine: Engine = "auto",
    ) -> Imitator:
        """Return an untrained imitator with settings chosen from these demonstrations.

        Args:
            demonstrations: from which the scale of percepts and the rate are taken.
            targets: what the schemas store; see `ImitatorConfig`.
            lead: frames that a target lies ahead, where it is a state.
            engine: as of `PACNet`.

        Raises:
            ValueError: no demonstrations, percepts that never change, or actions that never do
                where a forward model has to choose among them.
        """
        return cls(choose_settings(demonstrations, targets, lead), engine)

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

        Nothing is learned across gaps: the parts between them count as demonstrations each.
        The map learns a demonstration first, so that its nodes are habituated when the targets are
        stored. The scale of percepts never changes. The forward model is fitted to the first
        demonstrations only: it depends on the robot, not on the task. In eval mode nothing is
        learned. Ctrl-C takes effect after the current demonstration; after an error what was known
        before that demonstration is intact. The mean first action is of demonstrations that begin
        with their episode, where there are any.

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
        self._check_reports()
        first, actions = check_storage("first_action", self.first_action), len(self.config.action)
        if first.shape != (actions,):
            raise ValueError(f"expected a first action [{actions}], got {list(first.shape)}")
        check_demonstrations(demonstrations, self.config, self.network.sofm)
        if not self.training:
            return []
        demonstrations = demonstrations.continuous()
        if self.forward_model is not None and not self.reports:
            with full_precision():
                self._fit(self.forward_model, demonstrations.episodes)
        reports = []
        for shown in demonstrations:
            with full_precision(), defer_sigint():
                reports.append(self._learn_one(demonstrations.source, shown, corrections))
            if progress is not None:
                progress(len(shown.state))
        return reports

    def step(self, percept: NDArray[np.float32] | Tensor) -> ImitatorStep:
        """Return the action at one percept, continuing from the last call; nothing is learned.

        Args:
            percept: `[D]`, an array or a tensor on the CPU, float32.

        Raises:
            ValueError: wrong shape or dtype, or not finite; nothing has changed.
        """
        percept, known = check_row("percept", percept, len(self.percept_names)), self._latest()
        state = percept[: self.config.state_dimensions] if self.forward_model is not None else None
        decision = self.network.step_on(known.network, percept, state)
        score = known.detector.score(percept * known.scale, known.cues)
        # NaN, which cannot be compared, counts as novel.
        is_novel, unit = not score.novelty <= 1, float(known.scale[score.dimension])
        if unit == 0:
            raise ValueError(f"expected a scale without zeros, got {known.scale.tolist()}")
        wanted = decision.target if self.forward_model is None else decision.action
        return ImitatorStep(
            None if is_novel else wanted,
            is_novel,
            score.novelty,
            self.percept_names[score.dimension],
            score.deviation / unit,
            score.threshold / unit,
            decision,
        )

    def warm_up(self) -> None:
        """Trigger JIT compilation, which takes seconds, then start a new recall episode."""
        with torch.inference_mode(False):
            known = self._latest()
            percept = known.cues[0] if len(known.cues) else np.zeros_like(known.scale)
            for _ in range(2):  # the belief is updated from the second step on
                self.step(percept / known.scale)
        self.reset()

    def reset(self) -> None:
        """Start a new recall episode; what was learned stays."""
        self.network.reset()
        self.novelty_detector.reset()

    def _fit(self, model: MLPForwardModel, episodes: Sequence[Demonstration]) -> None:
        """Fit the forward model to all steps from one frame to the next."""
        model.fit(
            torch.cat([episode.state[:-1] for episode in episodes]),
            torch.cat([episode.action[:-1] for episode in episodes]),
            torch.cat([episode.state[1:] for episode in episodes]),
            seed=0,
        )

    def _mean_first_action(self, shown: Demonstration) -> Tensor:
        """Return the mean first action `[U]` once this demonstration is learned."""
        starts = [report.first_frame == 0 for report in self.reports if not report.correction]
        if any(starts) and shown.first_frame > 0:
            return self.first_action
        before = sum(starts) if shown.first_frame == 0 else len(starts)
        mean = self.first_action if before else torch.zeros_like(self.first_action)
        return mean + (shown.action[0] - mean) / (before + 1)

    def _learn_one(self, dataset: str, shown: Demonstration, correction: bool) -> EpisodeReport:
        """Learn on drafts, which then replace the network and the detector, all at once."""
        with self.network.learning() as draft:  # no other thread learns until the end
            number, first_action = len(self.reports), self.first_action
            correction = correction and number > 0  # the first has nothing to correct
            detector = draft_of(self.novelty_detector)
            percepts = draft.sofm.normalize(shown.percepts)
            compact(draft.schemas)  # rows that belong to no schema must not count as cues
            cues = draft.schemas.arrays("cue") if number > 0 else None
            novelty = detector.learn(percepts.numpy(), cues, correction=correction)
            has_actions, lead = self.config.targets == "action", self.config.lead
            targets = shown.action if has_actions else targets_ahead(shown.state, lead)
            observed = draft.update(percepts)  # first the map alone, so that its nodes habituate
            draft.update(percepts, targets, number, shown.task)
            if not correction:
                first_action = self._mean_first_action(shown)
            report = EpisodeReport(
                dataset,
                index(shown.episode),
                shown.task,
                len(percepts),
                new_nodes=int(observed.inserted.sum()),
                nodes=len(draft.sofm),
                novel_share=float(observed.novelty.float().mean()),
                max_novelty=novelty,
                correction=correction,
                first_frame=index(shown.first_frame),
            )
            with self.network.state_lock:
                self.network.adopt(draft)
                adopt(self.novelty_detector, detector)
                self._buffers["first_action"] = first_action
                snapshot = self.network._snapshot
                self._snapshot = (
                    None
                    if snapshot is None
                    else ImitatorSnapshot.take(snapshot, self.novelty_detector)
                )
                self.reports.append(report)
        return report

"""Belief: which known episode is observed, and how far it is, by the forward algorithm of an HMM.

The states are those of all known episodes (`pacnet.competition.timeline`). At each sample the
belief moves along the chains at the pace of the demonstrations, and is then weighted by the
likelihood of the percept in each state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacnet.competition.timeline import Timeline
from pacnet.core.old_names import old_names
from pacnet.core.validation import check_fields, is_integer, is_number

_MOST_STATES = 2**16  # of an episode: the belief takes memory for each of them


@old_names(
    places="n_states", width="obs_std", mismatch="outlier_likelihood", restart="restart_prob"
)
@dataclass(frozen=True)
class RecognitionConfig:
    """How a known episode is recognized.

    Distances are in normalized units, in which the noise of a percept should have a length of about
    0.1: the square root of the sum over dimensions of (noise × scale)². If it is larger, increase
    `obs_std` and `novel_above`, or reduce the scale.

    Attributes:
        n_states: number P of states of each known episode.
        obs_std: standard deviation of the likelihood, in normalized units. It should be larger
            than the noise of a single percept, because demonstrations differ for many samples.
        outlier_likelihood: likelihood of a percept that fits nothing, relative to one that fits
            perfectly. It keeps a burst of noise from deciding which episode is recognized.
        restart_prob: probability that a sample belongs to any other state of any episode.
        novel_above: novelty above which a percept is novel, in (0, 1). Two percepts of the same
            instant are √2 times the noise apart.
    """

    n_states: int = 128
    obs_std: float = 0.3
    outlier_likelihood: float = 1e-3
    restart_prob: float = 1e-4
    novel_above: float = 0.3

    def __post_init__(self) -> None:
        """Validate the fields."""
        checks = {
            "n_states": (
                is_integer(self.n_states, 2) and self.n_states <= _MOST_STATES,
                f"to be an integer from 2 to {_MOST_STATES}",
            ),
            "obs_std": (is_number(self.obs_std) and self.obs_std > 0, "> 0 and finite"),
        }
        for name in ("outlier_likelihood", "restart_prob", "novel_above"):
            value = getattr(self, name)
            checks[name] = (is_number(value) and 0 < value < 1, "in (0, 1)")
        check_fields(self, checks)


class Belief:
    """The probability of every state of every known episode, given the percepts so far.

    Args:
        timeline: of the known episodes.
        config: see `RecognitionConfig`.

    Attributes:
        probability: of every state of every known episode, float64 `[E, P]`.
        has_begun: whether there was a percept.
    """

    def __init__(self, timeline: Timeline, config: RecognitionConfig) -> None:
        self.timeline, self.config = timeline, config
        self.probability = timeline.start
        self.has_begun = False
        self._predicted: NDArray[np.float64] | None = None

    def predict(self) -> NDArray[np.float64]:
        """Return the belief one sample later, before its percept is seen, `[E, P]`."""
        if self._predicted is None:
            from pacnet.competition import kernels  # imports numba

            self._predicted = np.empty_like(self.probability)
            kernels.predict(self.probability, self.timeline.advance, self._predicted)
        return self._predicted

    def update(self, distances: NDArray[np.floating]) -> None:
        """Update the belief with one percept, given its distances from all cues `[R]`."""
        from pacnet.competition import kernels  # imports numba

        start, config = self.timeline.start, self.config
        predicted = self.predict() if self.has_begun else start
        restart_prob = config.restart_prob if self.has_begun else 0.0
        probability = np.empty_like(start)
        fits = kernels.weight(
            predicted, start, restart_prob, self.timeline.rows, distances, config.obs_std,
            config.outlier_likelihood, probability,
        )  # fmt: skip
        if not fits:
            raise ValueError(f"expected a distance for each row expected, got {len(distances)}")
        self.probability, self.has_begun, self._predicted = probability, True, None

"""Metrics, principal components, recognized episodes, scores on held-out episodes, and figures.

The figures need matplotlib; import them from `map_figures` and `recognition_figures`.
"""

from pacnet.evaluation.held_out import HeldOutScores, Split, score, splits
from pacnet.evaluation.metrics import (
    PathDistances,
    aligned_distance,
    area_between_curves,
    path_distances,
)
from pacnet.evaluation.neighbours import NearestNeighbours, RepeatLast
from pacnet.evaluation.pca import PrincipalComponents
from pacnet.evaluation.recognized import RecognizedEpisode

__all__ = [
    "HeldOutScores",
    "NearestNeighbours",
    "PathDistances",
    "PrincipalComponents",
    "RecognizedEpisode",
    "RepeatLast",
    "Split",
    "aligned_distance",
    "area_between_curves",
    "path_distances",
    "score",
    "splits",
]

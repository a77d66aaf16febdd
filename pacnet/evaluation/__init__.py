"""Metrics, principal components, recognized episodes and figures, from plain arrays.

The figures need matplotlib; import them from `map_figures` and `recognition_figures`.
"""

from pacnet.evaluation.metrics import PathDistances, area_between_curves, path_distances
from pacnet.evaluation.pca import PrincipalComponents
from pacnet.evaluation.recognized import RecognizedEpisode

__all__ = [
    "PathDistances",
    "PrincipalComponents",
    "RecognizedEpisode",
    "area_between_curves",
    "path_distances",
]

"""Pictures of a dataset's cameras: decoded by PyAV and Pillow, reduced, and kept on disk."""

from pacnet.datasets.pictures.reducing import MAX_SIDE, reduce, reduced_size

__all__ = ["MAX_SIDE", "reduce", "reduced_size"]

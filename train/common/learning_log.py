"""The tensorboard log of a run: learning curves, figures, the map in the projector, the video."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

from tensorboard.compat.proto.summary_pb2 import Summary
from torch.utils.tensorboard import SummaryWriter

from pacnet import HabituatingSOFM, Observation

# "TensorFlow installation not found" can be ignored: the projector needs none.
logging.getLogger("tensorboard").setLevel(logging.ERROR)


class LearningLog:
    """Write one run's log; a context manager.

    Args:
        folder: Of the log.
    """

    def __init__(self, folder: Path) -> None:
        self._writer = SummaryWriter(str(folder))
        self._samples = 0
        self._insertions = 0

    def __enter__(self) -> LearningLog:
        """Return the open log."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the log."""
        self._writer.close()

    def observed(self, sofm: HabituatingSOFM, record: Observation) -> None:
        """Write scalars after a stretch of learning.

        Args:
            sofm: The map that learned.
            record: Of the samples since the last call.
        """
        self._samples += len(record.winner)
        self._insertions += int(record.inserted.sum())
        scalars = {
            "learning/nodes": len(sofm),
            "learning/insertions": self._insertions,
            "learning/mean_habituation": float(sofm.habituation.mean()),
            "learning/attended_share": float(record.attended.float().mean()),
        }
        for name, value in scalars.items():
            self._writer.add_scalar(name, value, self._samples)

    def losses(self, losses: Sequence[tuple[float, float]]) -> None:
        """Write the learning curves of a fit.

        Args:
            losses: Training and validation loss after each epoch.
        """
        for epoch, (train_loss, validation_loss) in enumerate(losses, start=1):
            self._writer.add_scalar("fit/train_loss", train_loss, epoch)
            self._writer.add_scalar("fit/validation_loss", validation_loss, epoch)

    def scores(self, scores: Mapping[str, float | int], group: str = "recall") -> None:
        """Write the run's final scores.

        Args:
            scores: Name -> value.
            group: Under which they are shown.
        """
        for name, value in scores.items():
            self._writer.add_scalar(f"{group}/{name}", value, self._samples)

    def pictures(self, *paths: Path) -> None:
        """Write PNG or GIF files as they are; tensorboard plays animated GIFs."""
        for path in paths:
            image = Summary.Image(encoded_image_string=path.read_bytes())
            summary = Summary(value=[Summary.Value(tag=path.stem, image=image)])
            self._writer.file_writer.add_summary(summary, self._samples)  # pyright: ignore

    def projector(self, sofm: HabituatingSOFM, columns: Sequence[str]) -> None:
        """Write the nodes for the projector, each with its number and its prototype's values.

        Args:
            sofm: The map.
            columns: Name of each dimension of a percept.
        """
        prototypes = sofm.prototypes
        values = [[f"{value:.3f}" for value in prototype] for prototype in prototypes.tolist()]
        self._writer.add_embedding(
            prototypes * sofm.scale,
            metadata=[[str(node), *row] for node, row in enumerate(values)],
            metadata_header=["node", *columns],
            tag="nodes",
            global_step=self._samples,
        )

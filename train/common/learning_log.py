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
    """Writes one run's log; a context manager.

    Args:
        folder: of the log.
    """

    def __init__(self, folder: Path) -> None:
        self._writer = SummaryWriter(str(folder))
        self._samples = 0
        self._insertions = 0

    def __enter__(self) -> LearningLog:
        """The open log."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes the log."""
        self._writer.close()

    def observed(self, sofm: HabituatingSOFM, record: Observation) -> None:
        """Scalars after a stretch of learning.

        Args:
            sofm: the map that learned.
            record: of the samples since the last call.
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
        """Learning curves of a fit.

        Args:
            losses: training and validation loss after each epoch.
        """
        for epoch, (train_loss, validation_loss) in enumerate(losses, start=1):
            self._writer.add_scalar("fit/train_loss", train_loss, epoch)
            self._writer.add_scalar("fit/validation_loss", validation_loss, epoch)

    def scores(self, scores: Mapping[str, float | int], group: str = "recall") -> None:
        """The run's final scores.

        Args:
            scores: by name.
            group: under which they are shown.
        """
        for name, value in scores.items():
            self._writer.add_scalar(f"{group}/{name}", value, self._samples)

    def picture(self, name: str, path: Path) -> None:
        """A picture as it lies on disk; tensorboard plays an animated GIF.

        Args:
            name: of the picture.
            path: a PNG or GIF file.
        """
        image = Summary.Image(encoded_image_string=path.read_bytes())
        summary = Summary(value=[Summary.Value(tag=name, image=image)])
        self._writer.file_writer.add_summary(summary, self._samples)  # pyright: ignore

    def projector(self, sofm: HabituatingSOFM, columns: Sequence[str]) -> None:
        """The nodes in the projector, each with its number and its prototype's values.

        Args:
            sofm: the map.
            columns: name of each dimension of a percept.
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

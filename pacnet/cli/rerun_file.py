"""What an imitator saw, as a recording for the Rerun viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun

from pacnet.cli.seen import Seen
from pacnet.evaluation.recognized import display_names


def write_rerun(
    file: str | Path, seen: Sequence[Seen], behaviours: Sequence[str], fps: float
) -> None:
    """Writes curves over time of each episode.

    Args:
        file: to write, replaced if it is there.
        seen: the episodes.
        behaviours: name of each behaviour that the imitator knows.
        fps: frames per second [1/s].
    """
    with rerun.RecordingStream("pacnet", recording_id=Path(file).stem) as recording:
        recording.save(file)
        for one in seen:
            _send(recording, one, display_names(behaviours), fps)


def _send(
    recording: rerun.RecordingStream, seen: Seen, behaviours: Sequence[str], fps: float
) -> None:
    recognition, episode = seen.watched.recognition, seen.watched.demonstration.episode
    curves = {
        "novelty": recognition.novelty,
        "progress": recognition.progress,
        "winner": recognition.winner,
        **{
            f"probability/{rerun.escape_entity_path_part(name)}": recognition.probability[:, number]
            for number, name in enumerate(behaviours)
        },
    }
    times = rerun.TimeColumn("time", duration=np.arange(len(recognition.winner)) / fps)
    for name, values in curves.items():
        columns = rerun.Scalars.columns(scalars=values.double().numpy())
        recording.send_columns(f"episode_{episode:03}/{name}", [times], columns)

"""`pacnet watch`: novelty and recognition over time, for every episode of a dataset."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pacnet.cli.parsing import (
    Commands,
    add_checkpoint,
    add_command,
    add_dataset,
    add_task,
    check_folder,
    path,
)
from pacnet.cli.printing import NOTHING, print_pairs, print_table, progress_bar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pacnet.cli.replay import ReplayedEpisode
    from pacnet.datasets.demonstrations import Demonstration, Demonstrations
    from pacnet.imitator.framed import FramedSchemas

_DETAILS = """The imitator runs over each episode from its start, without acting or learning. The
output says which task it recognises, where the percepts are unlike the training data, and in
which dimension; or in which camera what is attended to is not found."""
_EXAMPLE = "pacnet watch imitator recordings/new --out pictures"
_HEADS = (
    "episode", "<task", "<recognised as", "probability", "since", "novel frames", "max novelty",
    "<in", "at", "acts", "<holds because", "progress",
)  # fmt: skip
_LEGEND = """recognised as: the likeliest known task at the end; new if the last frame is novel
probability, since: of that task among the known ones, and since when it was the likeliest
max novelty, in, at: largest novelty, its dimension and time; novelty above 1 is novel
acts: share of frames at which it would act on a robot; at the others it would hold
holds because: the commonest reason; `pacnet explain` gives the numbers of a single frame
progress: share of what it follows that is over at the last frame, if that is not novel"""


def add_to(commands: Commands) -> None:
    """Add the command to the main parser."""
    summary = "show what an imitator recognises in other recordings, and what is novel there"
    parser = add_command(commands, "watch", summary, _DETAILS, _EXAMPLE, run)
    add_checkpoint(parser)
    add_dataset(parser)
    add_task(parser)
    parser.add_argument(
        "--out", type=path, metavar="DIR",
        help="draw a figure of each episode over time to DIR/episode_NNN.png; with points also "
        "where it is cut, to DIR/episode_NNN_segments.png",
    )  # fmt: skip
    parser.add_argument(
        "--rerun", type=path, metavar="FILE.rrd",
        help="write the curves for the Rerun viewer; needs the package rerun-sdk",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> None:
    """Run over all episodes, print a table, and write the figures and curves asked for."""
    if arguments.rerun is not None:
        import rerun  # noqa: F401 — whether it is installed, before the work begins
    from pacnet.cli.loading import load_imitator, load_percepts
    from pacnet.cli.replay import replay
    from pacnet.evaluation.recognized import display_names

    imitator = load_imitator(arguments.checkpoint, arguments.task)
    demonstrations = load_percepts(imitator, arguments)
    _make_folders(arguments)
    episodes = list(replay(imitator, demonstrations, arguments.task))
    fps = demonstrations.fps
    behaviours = display_names(imitator.tasks)
    print_table(_HEADS, [_row(episode, behaviours, fps) for episode in episodes])
    print(_LEGEND)
    written = []
    if arguments.out is not None:
        _draw(episodes, behaviours, fps, Path(arguments.out))
        if imitator.frames is not None:
            _draw_segments(imitator.frames, demonstrations, Path(arguments.out))
        written.append(("pictures", str(Path(arguments.out))))
    if arguments.rerun is not None:
        write_rerun(arguments.rerun, episodes, behaviours, fps)
        written.append(("rerun", arguments.rerun))
    if written:
        print()
        print_pairs(written)


def _make_folders(arguments: argparse.Namespace) -> None:
    """Make the folders to write to, before the work begins."""
    if arguments.out is not None:
        check_folder("--out", arguments.out)
        Path(arguments.out).mkdir(parents=True, exist_ok=True)
    if arguments.rerun is not None:
        if Path(arguments.rerun).is_dir():
            raise ValueError(f"expected --rerun as a file, '{arguments.rerun}' is a folder")
        Path(arguments.rerun).parent.mkdir(parents=True, exist_ok=True)


def _row(episode: ReplayedEpisode, behaviours: Sequence[str], fps: float) -> tuple[str, ...]:
    recognition, shown = episode.recognized.recognition, episode.recognized.demonstration
    most = int(recognition.novelty.argmax())
    recognised, progress = ("new", NOTHING, NOTHING), NOTHING
    if not recognition.is_novel[-1]:
        number = int(recognition.behaviour[-1])
        probability = float(recognition.probability[-1, number])
        since = episode.recognized.stable_from / fps
        recognised = (behaviours[number], f"{probability:.1%}", f"{since:.2f} s")
        progress = f"{episode.progress:.1%}"
    return (
        f"{shown.episode}",
        shown.task or "untitled",
        *recognised,
        f"{float(recognition.is_novel.double().mean()):.1%}",
        f"{float(recognition.novelty[most]):.2f}",
        episode.dimension[most],
        f"{most / fps:.2f} s",
        f"{float(episode.acts.double().mean()):.1%}",
        episode.holds_because or NOTHING,
        progress,
    )


def _draw(
    episodes: Sequence[ReplayedEpisode], behaviours: Sequence[str], fps: float, folder: Path
) -> None:
    """Draw a figure of each episode."""
    from pacnet.evaluation.recognition_figures import recognition_over_time
    from pacnet.imitator.novelty import NOVEL

    with progress_bar("drawing", len(episodes), "figure") as advance:
        for episode in episodes:
            shown, recognition = episode.recognized.demonstration, episode.recognized.recognition
            figure = recognition_over_time(
                recognition, behaviours, NOVEL, 1 / fps, _title(shown), episode.acts.numpy()
            )
            _save(figure, folder / f"episode_{shown.episode:03}.png")
            advance(1)


def _draw_segments(frames: FramedSchemas, demonstrations: Demonstrations, folder: Path) -> None:
    """Draw where each episode is cut, as it is when it is learned."""
    from pacnet.evaluation.segment_figures import distances_over_time

    names, fps = frames.config.points.names, demonstrations.fps
    with progress_bar("drawing", len(demonstrations), "figure") as advance:
        for shown in demonstrations:
            approach = frames.approach(shown)
            figure = distances_over_time(approach, names, 1 / fps, _title(shown))
            _save(figure, folder / f"episode_{shown.episode:03}_segments.png")
            advance(1)


def _title(shown: Demonstration) -> str:
    return f"Episode {shown.episode}, recorded as “{shown.task or 'untitled'}”"


def _save(figure: Figure, file: Path) -> None:
    with warnings.catch_warnings():  # characters that the font lacks are drawn as boxes
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        figure.savefig(file)


def write_rerun(
    file: str, episodes: Sequence[ReplayedEpisode], behaviours: Sequence[str], fps: float
) -> None:
    """Write curves over time of each episode for the Rerun viewer; replace the file."""
    import numpy as np
    import rerun

    with rerun.RecordingStream("pacnet", recording_id=Path(file).stem) as recording:
        recording.save(file)
        for episode in episodes:
            recognition = episode.recognized.recognition
            curves = {
                "novelty": recognition.novelty,
                "progress": recognition.progress,
                "winner": recognition.winner,
            }
            for number, name in enumerate(behaviours):
                part = rerun.escape_entity_path_part(name)
                curves[f"probability/{part}"] = recognition.probability[:, number]
            times = rerun.TimeColumn("time", duration=np.arange(len(recognition.winner)) / fps)
            folder = f"episode_{episode.recognized.demonstration.episode:03}"
            for name, values in curves.items():
                columns = rerun.Scalars.columns(scalars=values.double().numpy())
                recording.send_columns(f"{folder}/{name}", [times], columns)

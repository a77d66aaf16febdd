"""`pacnet watch`: novelty and recognition over time, of every episode of a dataset."""

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
    check_folder,
    path,
)
from pacnet.cli.printing import NOTHING, print_pairs, print_table

if TYPE_CHECKING:
    from pacnet.cli.seen import Seen
    from pacnet.imitator.imitator import Imitator

_MORE = """The imitator watches each episode from its start, acts on nothing and learns nothing. It
says which behaviour it takes the episode for, where it is unlike everything that was learned, and
in which dimension."""
_EXAMPLE = "pacnet watch imitator recordings/new --out pictures"
_HEADS = (
    "episode", "<recorded as", "<recognised as", "sure", "since", "novel frames",
    "largest novelty", "<in", "at", "would act", "<holds for",
)  # fmt: skip
_LEGEND = """recognised as: the likeliest known behaviour at the end; new where the end is novel
sure, since: how sure among the known behaviours, and since when it was that one
novelty: how far from what was learned, over what is tolerated in that dimension; over 1 is novel
would act: frames at which it would act on a robot; at the others it would hold
holds for: the commonest reason there; `pacnet explain` tells that of one frame, with its numbers"""


def add_to(commands: Commands) -> None:
    """Adds the command to the main parser."""
    summary = "what an imitator recognises in other recordings, and what is new to it there"
    parser = add_command(commands, "watch", summary, _MORE, _EXAMPLE, run)
    add_checkpoint(parser)
    add_dataset(parser)
    parser.add_argument(
        "--out",
        type=path,
        metavar="DIR",
        help="draw each episode over time, into DIR/episode_NNN.png",
    )
    parser.add_argument(
        "--rerun", type=path, metavar="FILE.rrd",
        help="write what was seen for the Rerun viewer; needs the package rerun-sdk",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> None:
    """Watches, prints, draws."""
    if arguments.rerun is not None:
        import rerun  # noqa: F401 — whether it is there, before anything is watched
    from pacnet.cli.seen import see
    from pacnet.cli.sources import load_imitator, load_percepts

    imitator = load_imitator(arguments.checkpoint)
    demonstrations = load_percepts(imitator, arguments.dataset)
    _make_folders(arguments)
    seen = list(see(imitator, demonstrations))
    behaviours, fps = imitator.network.behaviours, demonstrations.fps
    print_table(_HEADS, [_row(one, behaviours, fps) for one in seen])
    print(_LEGEND)
    written = []
    if arguments.out is not None:
        written.append(("pictures", str(_draw(seen, imitator, fps, Path(arguments.out)))))
    if arguments.rerun is not None:
        from pacnet.cli.rerun_file import write_rerun

        write_rerun(arguments.rerun, seen, behaviours, fps)
        written.append(("rerun", arguments.rerun))
    if written:
        print()
        print_pairs(written)


def _make_folders(arguments: argparse.Namespace) -> None:
    """Whether there is a place for what will be written, before anything is watched."""
    if arguments.out is not None:
        check_folder("--out", arguments.out)
        Path(arguments.out).mkdir(parents=True, exist_ok=True)
    if arguments.rerun is not None:
        if Path(arguments.rerun).is_dir():
            raise ValueError(f"expected --rerun as a file, '{arguments.rerun}' is a folder")
        Path(arguments.rerun).parent.mkdir(parents=True, exist_ok=True)


def _row(seen: Seen, behaviours: Sequence[str], fps: float) -> tuple[str, ...]:
    recognition, shown = seen.watched.recognition, seen.watched.demonstration
    most = int(recognition.novelty.argmax())
    return (
        f"{shown.episode}",
        shown.task or "untitled",
        *_recognised(seen, behaviours, fps),
        f"{float(recognition.is_novel.double().mean()):.1%}",
        f"{float(recognition.novelty[most]):.2f}",
        seen.dimension[most],
        f"{most / fps:.2f} s",
        f"{float(seen.acts.double().mean()):.1%}",
        seen.holds_for or NOTHING,
    )


def _recognised(seen: Seen, behaviours: Sequence[str], fps: float) -> tuple[str, str, str]:
    """As what, how sure, and since when."""
    recognition = seen.watched.recognition
    if recognition.is_novel[-1]:
        return "new", NOTHING, NOTHING
    named = int(recognition.behaviour[-1])
    sure, since = float(recognition.probability[-1, named]), seen.watched.stable_from / fps
    return behaviours[named] or "untitled", f"{sure:.1%}", f"{since:.2f} s"


def _draw(seen: Sequence[Seen], imitator: Imitator, fps: float, folder: Path) -> Path:
    """A page of each episode; returns the folder."""
    from pacnet.cli.progress import progress_bar
    from pacnet.cli.seen import NOVEL_ABOVE
    from pacnet.evaluation.recognition_figures import recognition_over_time
    from pacnet.evaluation.recognized import display_names

    titles = display_names(imitator.network.behaviours)
    with progress_bar("drawing", len(seen), "figure") as advance:
        for one in seen:
            number, task = one.watched.demonstration.episode, one.watched.demonstration.task
            title = f"Episode {number}, recorded as “{task or 'untitled'}”"
            recognition, acts = one.watched.recognition, one.acts.numpy()
            figure = recognition_over_time(recognition, titles, NOVEL_ABOVE, 1 / fps, title, acts)
            with warnings.catch_warnings():  # what the font lacks is drawn as a box
                warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
                figure.savefig(folder / f"episode_{number:03}.png")
            advance(1)
    return folder

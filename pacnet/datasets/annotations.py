"""A copy of a LeRobot dataset with extra columns, such as recognition results.

LeRobot's policies learn from every feature called `observation*` or `action*`, and leave columns of
other names alone.
"""

import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pacnet.core.durable import NEW, make_folder, sync_folder
from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.format.features import Arrays, Feature, checked_episode, checked_features
from pacnet.datasets.locate import find_dataset

# What imports pyarrow, 0.2 s, is imported where it is used.
if TYPE_CHECKING:
    from pacnet.datasets.copying.planning import Contents
    from pacnet.datasets.copying.source import SourceEpisode

_DTYPES = {"b": "bool", "i": "int64", "u": "int64"}  # kind of values -> stored


def write_annotated(
    source: str | Path,
    destination: str | Path,
    columns: Mapping[str, Sequence[str]],
    episodes: Iterable[Mapping[str, ArrayLike]],
    *,
    selected: Sequence[int] | None = None,
    videos: bool = True,
    skip_damaged: bool = False,
    progress: Callable[[int], object] = lambda _: None,
) -> None:
    """Copy a dataset of format v3.0, v2.1 or v2.0 to v3.0, with extra columns.

    The copy keeps every feature as it is stored, and each frame's task. Episodes are numbered from
    0, and their time runs from 0 at the dataset's frames per second. Videos are the same files,
    hard-linked where the file system can, else copied. Of the extra columns, integers are stored as
    int64, booleans as such and floats as float32; those of one dimension read back as scalars.

    A feature that LeRobot cannot hold or that is declared but not there is left out, and a
    `DatasetWarning` says so. Everything is checked before the copy is begun, and an interrupted
    copy leaves nothing.

    Args:
        source: the dataset's folder, or `user/name` as `load_demonstrations` takes it.
        destination: the copy's folder, which must not exist yet.
        columns: name of each extra column -> names of its dimensions.
        episodes: for each episode of the copy: column -> its values `[T, K]`, one row per frame;
            floats, integers or booleans, the same in all episodes.
        selected: indices of the source's episodes to copy, in the order of `episodes`; None for
            all, in the order of their indices.
        videos: whether to copy videos.
        skip_damaged: whether a table of tasks that cannot be read is done without, as with
            `load_demonstrations`; damaged files of frames matter only if their episodes are copied.
        progress: called with the number of frames after each episode is written.

    Raises:
        FileExistsError: `destination` exists already.
        DatasetError: the source cannot be read; it has no feature to copy; some, not all, of a
            camera's video files are missing; or a video is a link out of the dataset.
        ValueError: no columns; a column's name is a feature of the source or cannot be stored by
            LeRobot; an unknown episode; not one entry for each episode; or values that are
            missing, unknown, of another shape, length or dtype, or not finite.
    """
    from pacnet.datasets.copying.planning import plan_copy
    from pacnet.datasets.copying.write import write_copy

    destination = Path(destination)
    if os.path.lexists(destination):
        raise FileExistsError(f"expected a folder to be made for the copy, {destination} exists")
    contents = check_annotatable(
        source, columns, selected=selected, videos=videos, skip_damaged=skip_damaged
    )
    episodes = list(episodes)
    added = _column_features(columns, episodes)
    annotations = _checked_annotations(added, episodes, contents.source.episodes)
    plan = plan_copy(contents, added, annotations)
    for name, reason in contents.left_out.items():
        text = f"{name!r} of {source} is left out of the copy: {reason}"
        warnings.warn(text, DatasetWarning, stacklevel=2)
    blind = [name for name in plan.clips if name not in plan.pictures.of_all]
    if blind:
        text = (
            f"{source} has no statistics of {', '.join(blind)}, nor has the copy: train LeRobot's "
            "policies with --dataset.use_imagenet_stats=false"
        )
        warnings.warn(text, DatasetWarning, stacklevel=2)
    make_folder(destination.parent)
    location = {"prefix": f".{destination.name}.", "suffix": NEW, "dir": destination.parent}
    with TemporaryDirectory(**location) as folder:  # also removes what an interrupt leaves
        copy = Path(folder) / destination.name
        copy.mkdir()
        write_copy(plan, copy, progress)
        for made in (copy, *(path for path in copy.rglob("*") if path.is_dir())):
            sync_folder(made)
        copy.rename(destination)
    sync_folder(destination.parent)


def check_annotatable(
    source: str | Path,
    columns: Mapping[str, Sequence[str]],
    *,
    selected: Sequence[int] | None = None,
    videos: bool = True,
    skip_damaged: bool = False,
) -> "Contents":
    """Check that a dataset can be copied with these extra columns; no feature is read.

    Returns:
        What the copy takes from the dataset.

    Raises:
        DatasetError: as `write_annotated`.
        ValueError: as `write_annotated`, about the columns and the selected episodes.
    """
    from pacnet.datasets.copying.planning import find_contents
    from pacnet.datasets.journal.journal import check_folded

    source = find_dataset(source)
    check_folded(source)
    contents = find_contents(source, selected, videos=videos, skip_damaged=skip_damaged)
    info = contents.source.info
    if not contents.kept.features:
        raise DatasetError(f"expected features to copy in {source}, found none")
    if not columns:
        raise ValueError("expected at least one column to add, got none")
    checked_features(columns)
    taken = sorted({*columns} & {*info["features"], *contents.kept.features})
    if taken:
        raise ValueError(f"expected columns that the dataset does not have, got {', '.join(taken)}")
    return contents


def _column_features(
    columns: Mapping[str, Sequence[str]], episodes: Sequence[Mapping[str, ArrayLike]]
) -> dict[str, Feature]:
    """Return the extra columns, each of the dtype that it has in the first episode that has it."""
    kinds: dict[str, str] = {}
    for episode in episodes[::-1]:
        kinds |= {name: np.asarray(values).dtype.kind for name, values in episode.items()}
    return {
        name: Feature(feature.names, _DTYPES.get(kinds.get(name, "f"), "float32"))
        for name, feature in checked_features(columns).items()
    }


def _checked_annotations(
    columns: Mapping[str, Feature],
    episodes: Sequence[Mapping[str, ArrayLike]],
    copied: Sequence["SourceEpisode"],
) -> list[Arrays]:
    """Return each episode's columns `[T, K]` as they are stored."""
    expected = len(copied)
    if len(episodes) != expected:
        raise ValueError(f"expected columns for each of {expected} episodes, got {len(episodes)}")
    checked = []
    for one, episode in zip(copied, episodes, strict=True):
        try:
            arrays = checked_episode(columns, episode)
        except ValueError as error:
            raise ValueError(f"episode {one.number}: {error}") from None
        found = len(next(iter(arrays.values())))
        if found != one.length:
            raise ValueError(
                f"episode {one.number}: expected {one.length} frames in columns, got {found}"
            )
        checked.append(arrays)
    return checked

"""Which episodes of a dataset are read: those asked for, without those that are damaged."""

from __future__ import annotations

import reprlib
import warnings
from collections.abc import Iterable, Mapping, Sequence
from operator import index
from pathlib import Path
from typing import Any, NamedTuple

from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.format.episode_list import (
    ListedEpisode,
    episode_of_old_file,
    listed_episodes,
)
from pacnet.datasets.format.numbers import episodes_text, numbers_text


class Selection(NamedTuple):
    """The episodes asked for."""

    episodes: frozenset[int] | None = None  # None: all
    exclude: frozenset[int] = frozenset()
    skip_damaged: bool = False  # whether damaged files and incomplete episodes are left out

    @classmethod
    def of(
        cls, episodes: Iterable[int] | None, exclude: Iterable[int], skip_damaged: bool
    ) -> Selection:
        """Return the selection of these indices of episodes; a ValueError if they are no such."""
        try:
            wanted = None if episodes is None else frozenset(map(index, episodes))
            return cls(wanted, frozenset(map(index, exclude)), skip_damaged)
        except TypeError:
            raise ValueError(
                f"expected episodes as indices in a list, got {episodes!r} and exclude {exclude!r}"
            ) from None

    def takes(self, episode: int) -> bool:
        """Return whether an episode is asked for."""
        return (self.episodes is None or episode in self.episodes) and episode not in self.exclude


class _Loss(NamedTuple):
    """Frames that a dataset should have."""

    reason: str
    episodes: Sequence[int]  # that they are of; none where that is not known

    def matters(self, selection: Selection) -> bool:
        """Return whether frames that are asked for may be among them."""
        if not self.episodes:
            return selection.episodes is None
        return any(map(selection.takes, self.episodes))


def selected_episodes(
    root: Path,
    info: Mapping[str, Any],
    lengths: Mapping[int, int],
    damaged: Mapping[Path, DatasetError],
    selection: Selection,
) -> list[int]:
    """Return the episodes to read, in their order, after telling what is missing.

    Args:
        root: the dataset's folder.
        info: its description.
        lengths: episode -> its number of frames, of all that can be read.
        damaged: data file -> why it cannot be read.
        selection: the episodes asked for.

    Raises:
        DatasetError: an episode asked for is damaged or not there, or none is left.
    """
    counts = {"frames": sum(lengths.values()), "episodes": len(lengths)}
    differ = [
        f"{reprlib.repr(info[f'total_{name}'])} {name} where the data files hold {held}"
        for name, held in counts.items()
        if info.get(f"total_{name}") not in (None, held)
    ]
    losses: list[_Loss] = []
    if damaged or differ:
        listed = listed_episodes(root, info)
        losses = _unreadable(root, damaged, listed)
        known = {episode for loss in losses for episode in loss.episodes}
        rest = {one: entry for one, entry in listed.items() if one not in known}
        losses += _incomplete(lengths, rest)
    if differ and not losses:
        warnings.warn(
            f"meta/info.json counts {' and '.join(differ)}: the data files are read",
            DatasetWarning,
            stacklevel=2,
        )
    for loss in losses:
        if loss.matters(selection):
            _report(loss, selection.skip_damaged)
    lost = {episode for loss in losses for episode in loss.episodes}
    there = [episode for episode in lengths if episode not in lost]
    _check_known(there, lost, selection)
    chosen = [episode for episode in there if selection.takes(episode)]
    if not chosen:
        raise DatasetError("expected at least one episode of the dataset, all are left out")
    return chosen


def _unreadable(
    root: Path, damaged: Mapping[Path, DatasetError], listed: Mapping[int, ListedEpisode]
) -> list[_Loss]:
    """Return the data files that cannot be read, with the episodes that they should hold."""
    losses = []
    for path, error in damaged.items():
        named, place = episode_of_old_file(path), path.relative_to(root).as_posix()
        held = [episode for episode, entry in listed.items() if entry.data_file == place]
        losses.append(_Loss(str(error), held if named is None else [named]))
    return losses


def _incomplete(lengths: Mapping[int, int], listed: Mapping[int, ListedEpisode]) -> list[_Loss]:
    """Return the listed episodes of which no frame or not every frame is there."""
    losses = []
    absent = [episode for episode in listed if episode not in lengths]
    if absent:
        files = sorted({entry.data_file or "" for one, entry in listed.items() if one in absent})
        where = f", expected in {files[0]}" if len(files) == 1 and files[0] else ""
        losses.append(_Loss(f"{episodes_text(absent)} in no data file{where}", absent))
    for episode, entry in listed.items():
        length, expected = lengths.get(episode), entry.length
        if length is not None and expected is not None and length < expected:
            reason = f"{length} of the {expected} frames of episode {episode} in the data files"
            losses.append(_Loss(reason, [episode]))
    return losses


def _report(loss: _Loss, skip: bool) -> None:
    """Name what is left out on request; otherwise refuse it."""
    about = f" ({episodes_text(loss.episodes)})" if loss.episodes else ""
    if skip:
        warnings.warn(f"left out{about}: {loss.reason}", DatasetWarning, stacklevel=3)
        return
    hint = "read what is whole with --skip-damaged (skip_damaged=True in Python)"
    if loss.episodes:
        hint += f", or leave it out with --exclude {numbers_text(loss.episodes)}"
    raise DatasetError(f"{loss.reason}{about}: {hint}")


def _check_known(there: Sequence[int], lost: set[int], selection: Selection) -> None:
    """Refuse numbers of episodes that the dataset does not have."""
    unknown = ((selection.episodes or frozenset()) | selection.exclude) - lost - {*there}
    if unknown:
        raise DatasetError(
            f"expected episodes of the dataset, which has {numbers_text(there)}, "
            f"got {numbers_text(unknown)}"
        )

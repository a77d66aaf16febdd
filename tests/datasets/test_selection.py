"""Claims about the choice of episodes, and about datasets of which files are damaged or missing."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from handmade import columns, write, write_episodes, write_info, write_old, write_rows

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.datasets.format.numbers import numbers_text

POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1234\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Format v3.0 in two data files: episodes 0 and 1, and 2."""
    write(tmp_path)
    write_rows(tmp_path, columns(), [0, 1, 2, 3, 4], "chunk-000/file-000.parquet")
    write_rows(tmp_path, columns(), [5, 6, 7], "chunk-000/file-001.parquet")
    write_episodes(tmp_path, {0: 4, 1: 1, 2: 3})
    return tmp_path


def numbers(root: Path, **options: object) -> list[int]:
    return [shown.episode for shown in load_demonstrations(root, **options)]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, [0, 1, 2]),
        ({"episodes": [2, 0]}, [0, 2]),
        ({"episodes": range(1, 3)}, [1, 2]),
        ({"exclude": [1]}, [0, 2]),
        ({"episodes": [0, 1], "exclude": [0]}, [1]),
    ],
)
def test_episodes_are_chosen_by_their_numbers(root: Path, options: dict, expected: list[int]):
    chosen = load_demonstrations(root, **options)
    assert [shown.episode for shown in chosen] == expected
    everything = load_demonstrations(root).episodes
    for shown in chosen:
        assert torch.equal(shown.percepts, everything[shown.episode].percepts)
        assert shown.task == everything[shown.episode].task


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"episodes": [0, 3, 5]}, "which has 0-2, got 3,5"),
        ({"exclude": [3]}, "which has 0-2, got 3"),
        ({"exclude": [0, 1, 2]}, "at least one episode of .*, all are left out"),
        ({"episodes": []}, "at least one episode"),
    ],
)
def test_episodes_that_are_not_there(root: Path, options: dict, message: str):
    with pytest.raises(DatasetError, match=message):
        load_demonstrations(root, **options)


@pytest.mark.parametrize("wrong", ["12", [1.5], 1, [None]])
def test_episodes_are_given_as_numbers_in_a_list(root: Path, wrong: object):
    for name in ("episodes", "exclude"):
        with pytest.raises(ValueError, match="expected episodes as indices in a list"):
            load_demonstrations(root, **{name: wrong})


def test_numbers_are_written_as_they_are_typed():
    assert numbers_text([9, 0, 2, 5, 6, 7, 8]) == "0,2,5-9"


def test_an_episode_with_numbers_that_are_not_finite_can_be_left_out(root: Path):
    frames = columns()
    frames["observation.state"][6, 1] = np.nan
    write_rows(root, frames, [5, 6, 7], "chunk-000/file-001.parquet")

    message = r"episode 2, frame 1, dimension 'observation.state_1': .* --exclude 2 "
    with pytest.raises(DatasetError, match=message):
        load_demonstrations(root)
    assert numbers(root, exclude=[2]) == [0, 1]


# Damage


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


def point(path: Path) -> None:
    path.write_bytes(POINTER)


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (truncate, "cannot be read"),
        (point, "is a Git LFS pointer in place of the file; run `git lfs pull`"),
        (Path.unlink, "episode 2 in no data file, expected in data/chunk-000/file-001.parquet"),
    ],
)
def test_a_damaged_file_is_refused_and_what_is_whole_is_read_on_request(
    root: Path, harm: Callable[[Path], object], reason: str
):
    harm(root / "data/chunk-000/file-001.parquet")

    hint = r"\(episode 2\): .*--skip-damaged.*--exclude 2"
    with pytest.raises(DatasetError, match=f"{reason}.*{hint}"):
        load_demonstrations(root)
    with pytest.raises(DatasetError, match=reason):
        load_demonstrations(root, episodes=[0, 2])
    assert numbers(root, exclude=[2]) == numbers(root, episodes=[0, 1]) == [0, 1]
    with pytest.warns(DatasetWarning, match=rf"left out \(episode 2\): .*{reason}"):
        assert numbers(root, skip_damaged=True) == [0, 1]


def test_a_file_that_holds_nobody_knows_what(root: Path):
    truncate(root / "data/chunk-000/file-001.parquet")
    (root / "meta/episodes/chunk-000/file-000.parquet").unlink()

    with pytest.raises(DatasetError, match=r"cannot be read.*--skip-damaged"):
        load_demonstrations(root, exclude=[0])
    assert numbers(root, episodes=[0]) == [0]
    with pytest.warns(DatasetWarning, match="left out: .*file-001"):
        assert numbers(root, skip_damaged=True) == [0, 1]


def test_an_episode_of_which_frames_are_lost(root: Path):
    write_rows(root, columns(), [5, 6], "chunk-000/file-001.parquet")

    with pytest.raises(DatasetError, match="2 of the 3 frames of episode 2 in the data files"):
        load_demonstrations(root)
    with pytest.warns(DatasetWarning, match="2 of the 3 frames of episode 2"):
        assert numbers(root, skip_damaged=True) == [0, 1]


@pytest.mark.parametrize("harm", [truncate, point, Path.unlink])
def test_a_damaged_episode_of_the_older_formats(tmp_path: Path, harm: Callable[[Path], object]):
    root = write_old(tmp_path, "v2.1")
    harm(root / "data/chunk-000/episode_000001.parquet")

    with pytest.raises(DatasetError, match=r"\(episode 1\).*--exclude 1"):
        load_demonstrations(root)
    assert numbers(root, exclude=[1]) == [0, 2]
    with pytest.warns(DatasetWarning, match=r"left out \(episode 1\)"):
        assert numbers(root, skip_damaged=True) == [0, 2]


@pytest.mark.parametrize("file", ["meta/info.json", "meta/tasks.parquet"])
def test_pointers_in_place_of_the_description(root: Path, file: str):
    point(root / file)
    with pytest.raises(DatasetError, match=rf"{file} .*is a Git LFS pointer.*`git lfs pull`"):
        load_demonstrations(root)


def test_all_files_damaged(root: Path):
    for path in (root / "data").glob("*/*"):
        point(path)
    with pytest.raises(DatasetError, match="`git lfs pull`"):
        load_demonstrations(root, skip_damaged=True)


def test_statistics_are_not_needed(root: Path):
    assert not (root / "meta/stats.json").exists()
    assert numbers(root) == [0, 1, 2]


@pytest.mark.parametrize("storage", ["lance", "zarr", 7])
def test_another_storage_is_refused_by_its_name(root: Path, storage: object):
    write_info(root, storage_format=storage)
    with pytest.raises(DatasetError, match=f"stored as {storage!r}.*expected Parquet"):
        load_demonstrations(root)
    write_info(root, storage_format="parquet")
    assert numbers(root) == [0, 1, 2]


# Time


def test_an_episode_with_a_gap_is_whole_and_is_cut_there_for_learning(root: Path):
    frames = columns()
    frames["timestamp"][2:4] += 1  # frames 2 and 3 of episode 0 come a second late
    write_rows(root, frames, [0, 1, 2, 3, 4], "chunk-000/file-000.parquet")

    with pytest.warns(DatasetWarning, match="episode 0, frame 2"):
        demonstrations = load_demonstrations(root)

    assert [shown.gaps for shown in demonstrations] == [(2,), (), ()]
    parts = demonstrations.continuous().episodes
    assert [(part.episode, part.first_frame) for part in parts] == [(0, 0), (0, 2), (1, 0), (2, 0)]
    assert torch.equal(parts[1].state, demonstrations.episodes[0].state[2:])


def test_gaps_within_a_run_of_chosen_frames_count_from_the_episode(root: Path):
    """Frames 1 to 3 of episode 0 are chosen; a second is missing before frame 3."""
    frames = columns() | {"intervention": np.arange(8) % 4 > 0}
    frames["timestamp"][3] += 1
    write_rows(root, frames, [0, 1, 2, 3, 4], "chunk-000/file-000.parquet")
    write_rows(root, frames, [5, 6, 7], "chunk-000/file-001.parquet")

    with pytest.warns(DatasetWarning, match="episode 0, frame 3"):
        shown = load_demonstrations(root, only_where="intervention").episodes[0]

    assert (shown.first_frame, shown.gaps) == (1, (2,))
    assert [part.first_frame for part in shown.continuous()] == [1, 3]


def test_a_file_with_vectors_of_another_length_than_the_first_is_damaged(root: Path):
    frames = columns()
    frames["observation.state"] = np.zeros((8, 4), "f4")
    write_rows(root, frames, [5, 6, 7], "chunk-000/file-001.parquet")

    message = r"file-001.parquet: expected numbers in 'observation.state', found 4 in a frame in"
    with pytest.raises(DatasetError, match=rf"{message} place of 3 \(episode 2\)"):
        load_demonstrations(root)
    with pytest.warns(DatasetWarning, match=message):
        assert numbers(root, skip_damaged=True) == [0, 1]

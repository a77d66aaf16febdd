"""Claims about datasets that are named: caches laid out by hand as LeRobot and the hub do."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pacnet.datasets import DatasetError, load_demonstrations
from pacnet.datasets.locate import _hub_cache, find_dataset, source_name

RECORDED = Path(__file__).parent / "data" / "lerobot_044"
NAME = "user/name"
OLD, NEW, THIRD = "a" * 40, "b" * 40, "c" * 40
VARIABLES = (
    "HOME", "HF_HOME", "HF_LEROBOT_HOME", "HF_HUB_CACHE", "HUGGINGFACE_HUB_CACHE", "XDG_CACHE_HOME",
)  # fmt: skip


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Hugging Face's folder, as it is by default; the working folder is empty."""
    for variable in VARIABLES:
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path / "home" / ".cache" / "huggingface"


def lay_out(root: Path, *folders: str) -> Path:
    for folder in folders or ("meta", "data"):
        (root / folder).mkdir(parents=True)
    (root / "meta" / "info.json").write_text("{}")
    return root


def snapshot(cache: Path, commit: str, *folders: str, ref: str = "", age: int = 0) -> Path:
    repository = cache / "datasets--user--name"
    root = lay_out(repository / "snapshots" / commit, *folders)
    os.utime(root, (10**9 - age, 10**9 - age))
    if ref:
        (repository / "refs").mkdir(exist_ok=True)
        (repository / "refs" / ref).write_text(commit)
    return root


def message_for(name: str) -> str:
    with pytest.raises(DatasetError) as error:
        find_dataset(name)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_a_path_and_an_existing_folder_are_themselves(cache, tmp_path):
    lay_out(cache / "lerobot" / NAME)
    assert find_dataset(Path(NAME)) == Path(NAME)
    Path(NAME).mkdir(parents=True)
    assert find_dataset(NAME) == Path(NAME)
    assert find_dataset(str(tmp_path)) == tmp_path


def test_places_are_searched_from_lerobots_own_to_the_general_one(cache):
    general = snapshot(cache / "hub", OLD)
    assert find_dataset(NAME) == general
    lerobots = snapshot(cache / "lerobot" / "hub", OLD)
    assert find_dataset(NAME) == lerobots
    recorded = lay_out(cache / "lerobot" / NAME)
    assert find_dataset(NAME) == recorded


def test_a_folder_that_lerobot_downloaded_gives_way_to_its_newer_cache(cache):
    downloaded = lay_out(cache / "lerobot" / NAME)
    (downloaded / ".cache" / "huggingface" / "download").mkdir(parents=True)
    snapshot(cache / "hub", OLD)
    assert find_dataset(NAME) == downloaded
    snapshot(cache / "lerobot" / "hub", OLD, "meta")  # LeRobot has not fetched the frames
    assert find_dataset(NAME) == downloaded
    whole = snapshot(cache / "lerobot" / "hub", NEW)
    assert find_dataset(NAME) == whole


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("v3.0", "main", OLD),
        ("main", "v2.1", OLD),
        ("v3.0", "v3.1", NEW),
        ("v3.10", "v3.9", OLD),
        ("v2.0", "v2.1", NEW),
        ("v2.1", "", OLD),
        ("main", "v4.0", OLD),
        ("main", "", OLD),
        ("v4.0", "", NEW),  # of a format to come
        ("other", "", NEW),  # the newest
    ],
)
def test_the_revision_is_lerobots_tag_then_main_then_the_newest(cache, old, new, found):
    snapshot(cache / "hub", OLD, ref=old, age=60)
    snapshot(cache / "hub", NEW, ref=new)
    snapshot(cache / "hub", THIRD, age=90)
    assert find_dataset(NAME).name == found


@pytest.mark.parametrize("text", ["", "../../..", "../" + "a" * 37, "d" * 40, "\xff" * 40])
def test_a_reference_to_no_snapshot_leaves_the_newest(cache, text):
    root = snapshot(cache / "hub", OLD, ref="v3.0")
    (root.parents[1] / "refs" / "v3.0").write_text(text, encoding="latin-1")
    assert find_dataset(NAME) == root


def test_only_folders_of_commits_are_snapshots(cache, tmp_path):
    outside = lay_out(tmp_path / "outside")
    root = snapshot(cache / "hub", OLD, age=60)
    (root.parent / NEW).symlink_to(outside)
    shutil.copytree(outside, root.parent / "temporary")
    assert find_dataset(NAME) == root


def test_a_download_of_meta_alone_gives_way_to_a_whole_one(cache):
    snapshot(cache / "hub", NEW, "meta", "videos", ref="v3.0")
    said = message_for(NAME)
    assert f"hub/datasets--user--name/snapshots/{NEW} holds only the meta/ of {NAME}" in said
    assert "`hf download --repo-type dataset user/name`" in said
    assert snapshot(cache / "hub", OLD, age=60) == find_dataset(NAME)


def test_a_folder_without_a_description_is_no_dataset(cache):
    (cache / "lerobot" / NAME / "data").mkdir(parents=True)
    assert snapshot(cache / "hub", OLD) == find_dataset(NAME)


def test_the_message_has_the_places_and_the_command(monkeypatch):
    assert message_for(NAME) == (
        "found no folder user/name, and no dataset of this name in the caches in "
        "~/.cache/huggingface: download it with `hf download --repo-type dataset user/name` "
        "(of the package huggingface_hub)"
    )
    monkeypatch.setenv("HF_LEROBOT_HOME", "/robots")
    assert "in the caches /robots and ~/.cache/huggingface/hub:" in message_for(NAME)


@pytest.mark.parametrize(
    ("variables", "lerobot", "hub"),
    [
        ({"HF_HOME": "{0}/hf"}, "hf/lerobot", "hf/hub"),
        ({"HF_HOME": "~/hf"}, "home/hf/lerobot", "home/hf/hub"),
        ({"XDG_CACHE_HOME": "{0}/x"}, "x/huggingface/lerobot", "x/huggingface/hub"),
        ({"XDG_CACHE_HOME": "{0}/x", "HF_HOME": "{0}/hf"}, "hf/lerobot", "hf/hub"),
        ({"HF_HOME": "$HOME/hf"}, "home/hf/lerobot", "home/hf/hub"),
        ({"HF_HOME": "{0}/hf", "HF_LEROBOT_HOME": "~/l"}, "home/l", "hf/hub"),
        ({"HF_HOME": "{0}/hf", "HUGGINGFACE_HUB_CACHE": "{0}/h"}, "hf/lerobot", "h"),
        ({"HF_HUB_CACHE": "{0}/h", "HUGGINGFACE_HUB_CACHE": "{0}/i", "HF_HOME": "~"},
         "home/lerobot", "h"),
    ],
)  # fmt: skip
def test_the_caches_are_where_the_environment_says(variables, lerobot, hub, tmp_path, monkeypatch):
    for variable, value in variables.items():
        monkeypatch.setenv(variable, value.format(tmp_path))
    assert snapshot(tmp_path / hub, OLD) == find_dataset(NAME)
    assert snapshot(tmp_path / lerobot / "hub", OLD) == find_dataset(NAME)
    assert lay_out(tmp_path / lerobot / NAME) == find_dataset(NAME)


@pytest.mark.parametrize("variables", [{}, {"XDG_CACHE_HOME": "/x"}, {"HF_HOME": "~/$A", "A": "b"}])
def test_the_general_cache_is_that_of_huggingface_hub(variables, monkeypatch):
    pytest.importorskip("huggingface_hub")
    for variable, value in variables.items():
        monkeypatch.setenv(variable, value)
    printed = subprocess.run(
        [sys.executable, "-c", "from huggingface_hub.constants import *; print(HF_HUB_CACHE)"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert _hub_cache() == Path(printed.stdout.strip())


def test_without_a_home_nothing_fails(monkeypatch):
    monkeypatch.delenv("HOME")
    monkeypatch.setattr("os.path.expanduser", lambda path: path)  # as for an unknown user
    assert "hf download" in message_for(NAME)


@pytest.mark.parametrize(
    "name",
    [
        "", "../x", "a/../b", "a/..", "./b", "/nowhere/at/all", "nowhere", "a/b/c", "a\0/b",
        "a/b\n", "a--b/c", "a/b..c", "a/b.git", "-a/b", "a/b-", ".a/b", "a/" + "b" * 97, "a" * 5000,
        "é/b", "a/b ", "\udc80/b", "a\\b",
    ],
)  # fmt: skip
def test_other_names_are_looked_for_in_no_cache(name, monkeypatch):
    def fail(_: str) -> None:
        raise AssertionError("a cache was searched")

    monkeypatch.setattr("pacnet.datasets.locate._candidates", fail)
    shown = name if name and name.isprintable() else repr(name)
    assert message_for(name) == f"expected the folder of a LeRobot dataset, found no folder {shown}"


def test_a_cache_that_is_a_file_or_closed_holds_nothing(cache):
    (cache / "hub").mkdir(parents=True)
    (cache / "hub" / "datasets--user--name").write_text("")
    (cache / "lerobot").write_text("")
    assert "hf download" in message_for(NAME)


def test_a_snapshot_of_links_is_read_and_called_by_its_name(cache):
    root = cache / "hub" / "datasets--user--name" / "snapshots" / OLD
    blobs = root.parents[1] / "blobs"
    blobs.mkdir(parents=True)
    for number, path in enumerate(sorted(RECORDED.rglob("*.*"))):
        link = root / path.relative_to(RECORDED)
        link.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, blobs / str(number))
        link.symlink_to(os.path.relpath(blobs / str(number), link.parent))
    found = find_dataset(NAME)
    assert source_name(NAME, found) == NAME
    read, expected = load_demonstrations(found), load_demonstrations(RECORDED)
    assert [len(episode.state) for episode in read] == [len(episode.state) for episode in expected]


def test_other_folders_are_called_by_their_own_name(cache, tmp_path):
    assert source_name(NAME, lay_out(cache / "lerobot" / NAME)) == "name"
    root = snapshot(tmp_path, OLD)
    assert source_name(root, root) == OLD
    assert source_name("other/name", root) == OLD
    (tmp_path / "link").symlink_to(root)
    assert source_name(str(tmp_path / "link"), tmp_path / "link") == OLD
    assert source_name(".", Path()) == "work"

"""Claims about policy folders that lack a part: refused when loaded, the part named."""

import re
import shutil
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

pytest.importorskip("lerobot")
pytest.importorskip("lerobot_policy_pacnet")

from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.factory import make_pre_post_processors
from lerobot_policy_pacnet.description import DatasetDescription
from lerobot_policy_pacnet.training import Training

from lerobot_policy_pacnet import PACNetConfig, PACNetPolicy
from pacnet.cli.loading import load_imitator

POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
STATE, ACTION, FRAMES = "observation.state", "action", 200
FILES = ("config.json", "model.safetensors", "training.safetensors", "policy_preprocessor.json")
LEARNED = ("imitator", "base", "training.safetensors")


def policy_of(training: Training | None) -> PACNetPolicy:
    vector = {name: PolicyFeature(FeatureType.STATE, (1,)) for name in (STATE,)}
    action = {ACTION: PolicyFeature(FeatureType.ACTION, (1,))}
    policy = PACNetPolicy(PACNetConfig(device="cpu", input_features=vector, output_features=action))
    policy._training = training
    return policy


def training(frames: int, source: str = "first", before: Training | None = None) -> Training:
    """A training that has added some of a dataset's 200 frames."""
    names = {STATE: ("elbow",), ACTION: ("motor",)}
    dataset = DatasetDescription(source, 50, names, FRAMES, source)
    base, known = (None, frozenset()) if before is None else (before.imitator, before.contents())
    made = Training(PACNetConfig(device="cpu"), dataset, base, known)
    phase = torch.linspace(0, 1.5, FRAMES)[:frames, None] + (before is not None)
    episode = torch.zeros(frames, dtype=torch.int64)
    made.add(torch.arange(frames), episode, phase.sin(), phase.cos(), ["wave"] * frames)
    return made


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of an unfinished training on a second dataset, with every part there is."""
    folder = tmp_path_factory.mktemp("saved")
    policy = policy_of(training(150, "second", training(FRAMES)))
    policy.save_pretrained(folder)
    for processor in make_pre_post_processors(policy.config):
        processor.save_pretrained(folder)
    return folder


@pytest.fixture
def folder(saved: Path, tmp_path: Path) -> Path:
    return shutil.copytree(saved, tmp_path / "policy")


def delete(path: Path) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def refusal(folder: Path) -> str:
    with pytest.raises((FileNotFoundError, ValueError)) as refused:
        PACNetPolicy.from_pretrained(folder)
    return str(refused.value)


def forget_record(folder: Path) -> None:
    """As policies were saved before their parts were recorded."""
    save_file(load_file(folder / "model.safetensors"), folder / "model.safetensors")


def test_a_whole_folder_loads(folder: Path):
    loaded = PACNetPolicy.from_pretrained(folder)._training
    assert loaded is not None
    assert len(loaded.frames) == 150
    assert loaded.base is not None
    assert loaded.imitator is not None


@pytest.mark.parametrize("name", LEARNED)
@pytest.mark.parametrize("recorded", [True, False])
def test_a_missing_part_is_named(folder: Path, name: str, recorded: bool):
    if not recorded:
        forget_record(folder)
    delete(folder / name)
    assert re.match(
        rf"expected .*{name}.* in '{folder}'.*got none: copy or download", refusal(folder)
    )


def test_a_policy_without_all_that_it_learned_is_no_untrained_one(folder: Path):
    for name in LEARNED:
        delete(folder / name)
    assert "training.safetensors" in refusal(folder)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("damage", ["empty", "truncated", "pointer", "folder"])
def test_a_damaged_file_is_named(folder: Path, name: str, damage: str):
    content = (folder / name).read_bytes()
    (folder / name).unlink()
    if damage == "folder":
        (folder / name).mkdir()
    else:
        kinds = {"empty": b"", "truncated": content[: len(content) // 2], "pointer": POINTER}
        (folder / name).write_bytes(kinds[damage])
    message = refusal(folder)
    assert name in message
    assert str(folder) in message
    assert ("git lfs pull" in message) is (damage == "pointer")


def test_kept_frames_that_are_missing_are_refused(folder: Path):
    path = folder / "training.safetensors"
    with safe_open(path, framework="pt") as file:
        whole = file.metadata()
    for entries in (whole, {"training": "[]"}, {"other": ""}):
        save_file({"index": torch.arange(3)}, path, entries)
        assert re.match(r"expected a whole training in '.*training\.safetensors'", refusal(folder))


@pytest.mark.parametrize("begun", [True, False])
def test_a_policy_that_has_learned_nothing_loads(tmp_path: Path, begun: bool):
    policy_of(training(0) if begun else None).save_pretrained(tmp_path)
    assert PACNetPolicy.from_pretrained(tmp_path).imitator is None
    with pytest.raises(FileNotFoundError, match=r"folder imitator .* has learned nothing yet"):
        load_imitator(tmp_path)


def test_a_policy_saved_without_a_record_loads(folder: Path):
    forget_record(folder)
    assert PACNetPolicy.from_pretrained(folder).imitator is not None

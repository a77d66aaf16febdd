"""Claims about checkpoints of unknown origin: damaged files, declared sizes and planted links."""

import json
import random
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from pacnet.core.checkpoint import read_checkpoint, rebuild_config, write_checkpoint
from pacnet.network.config import SchemaNetworkConfig

CONFIG, TENSORS = "config.json", "model.safetensors"
ROW = torch.arange(6.0)
UNUSUAL = {
    "scalar": torch.tensor(3.0),
    "empty": torch.empty(0, 4),
    "bools": torch.tensor([True, False]),
    "bytes": torch.arange(3, dtype=torch.uint8),
    "integers": torch.tensor([-1, 2**62]),
    "doubles": torch.tensor([1 / 3], dtype=torch.float64),
    "halves": torch.ones(3, dtype=torch.bfloat16),
    "transposed": ROW.reshape(2, 3).T,
    "whole": ROW,
    "overlapping": ROW[1:],
    "strided": ROW[::2],
    "expanded": torch.ones(1).expand(3),
    "learned": torch.nn.Parameter(torch.ones(2)),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_checkpoint(tmp_path / "net", {"nodes": 2}, {"rows": ROW, "ages": torch.arange(2)})
    return tmp_path / "net"


def with_flipped_bit(content: bytes, bit: int) -> bytes:
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def test_every_bit_of_the_tensors_file_counts(folder: Path):
    content = (folder / TENSORS).read_bytes()
    bits = random.Random(0).sample(range(8 * len(content)), 400)
    data = range(8 * (len(content) - 40), 8 * len(content))  # 6 floats and 2 integers
    for bit in {*bits, *data}:
        (folder / TENSORS).write_bytes(with_flipped_bit(content, bit))
        with pytest.raises(ValueError, match=f"expected .*{TENSORS}"):
            read_checkpoint(folder)


def test_every_bit_of_the_config_counts(folder: Path):
    content = (folder / CONFIG).read_bytes()
    for bit in range(8 * len(content)):
        (folder / CONFIG).write_bytes(with_flipped_bit(content, bit))
        with pytest.raises((ValueError, UserWarning), match=CONFIG):  # warnings are errors here
            read_checkpoint(folder)


def test_renamed_tensors_are_detected(folder: Path):
    content = (folder / TENSORS).read_bytes().replace(b'"rows"', b'"cues"')
    (folder / TENSORS).write_bytes(content)
    with pytest.raises(ValueError, match="expected the tensors that were written"):
        read_checkpoint(folder)


@pytest.mark.parametrize("metadata", [None, {"format": "pt"}, {"config_sha256": "0" * 64}])
def test_a_checkpoint_without_a_digest_loads_with_a_warning(
    folder: Path, metadata: dict[str, str] | None
):
    save_file(load_file(folder / TENSORS), folder / TENSORS, metadata)
    with pytest.warns(UserWarning, match=r"no digest|not the one") as warned:
        fields, tensors = read_checkpoint(folder)
    assert len(warned) == (2 if metadata and "config_sha256" in metadata else 1)
    assert fields == {"nodes": 2}
    assert torch.equal(tensors["rows"], ROW)


@pytest.mark.parametrize(
    "metadata", [{"sha256": "0" * 64}, {"sha256": ""}, {"sha257": f"{'0' * 64} {'0' * 64}"}]
)
def test_digests_of_another_form_are_refused(folder: Path, metadata: dict[str, str]):
    save_file(load_file(folder / TENSORS), folder / TENSORS, metadata)
    with pytest.raises(ValueError, match="expected two digests under 'sha256'"):
        read_checkpoint(folder)


@pytest.mark.parametrize("name", UNUSUAL)
def test_unusual_tensors_come_back_as_they_were(tmp_path: Path, name: str):
    write_checkpoint(tmp_path, {}, {name: UNUSUAL[name]})
    tensor = read_checkpoint(tmp_path)[1][name]
    assert (tensor.dtype, tensor.shape) == (UNUSUAL[name].dtype, UNUSUAL[name].shape)
    assert torch.equal(tensor, UNUSUAL[name])


def test_tensors_that_share_memory_come_back_each_by_itself(tmp_path: Path):
    for _ in range(2):  # what was read is written again
        write_checkpoint(tmp_path, {}, UNUSUAL)
        tensors = read_checkpoint(tmp_path)[1]
        assert all(torch.equal(tensors[name], tensor) for name, tensor in UNUSUAL.items())
    assert tensors["whole"].data_ptr() != tensors["overlapping"].data_ptr() - 4


def header(shape: list[int], end: int, dtype: str = "F32") -> bytes:
    entries = {"rows": {"dtype": dtype, "shape": shape, "data_offsets": [0, end]}}
    return json.dumps(entries).encode()


@pytest.mark.parametrize(
    "text",
    [
        header([10**12], 4 * 10**12) + bytes(8),
        header([10**12], 8) + bytes(8),
        header([2**40, 2**40], 8) + bytes(8),
        header([0, 2**63], 0),
        header([4], 3, "F6_E2M3") + bytes(3),
        b"[" * 10**5,
        b"",
    ],
)
@pytest.mark.parametrize("declared", [None, 2**60])
def test_sizes_that_the_file_does_not_have_are_refused(
    folder: Path, text: bytes, declared: int | None
):
    """They would not fit into the memory of any machine."""
    size = struct.pack("<Q", len(text.rstrip(b"\0")) if declared is None else declared)
    (folder / TENSORS).write_bytes(size + text)
    with pytest.raises(ValueError, match=f"expected a whole safetensors file.*{TENSORS}"):
        read_checkpoint(folder)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 10**5,
        '{"a":' * 10**5,
        "1",
        "null",
        "\x00",
        '{"format": "pacnet", "version": true, "config": {}}',
    ],
)
def test_a_config_of_another_form_is_refused(folder: Path, text: str):
    (folder / CONFIG).write_text(text)
    with pytest.raises(ValueError, match=f"expected .*{CONFIG}"):
        read_checkpoint(folder)


@pytest.mark.parametrize("width", [10**400, "wide", [1], {}, None, True])
def test_fields_of_another_form_are_refused(width: object):
    fields = {"percept_dimensions": 2, "target_dimensions": 1, "width": width}
    with pytest.raises(ValueError, match=r"expected .*SchemaNetworkConfig"):
        rebuild_config(SchemaNetworkConfig, fields)


def write_small(folder: Path) -> None:
    write_checkpoint(folder, {"nodes": 1}, {"rows": torch.ones(1)})


@pytest.mark.parametrize("name", [CONFIG, TENSORS, f"{CONFIG}.new", f"{TENSORS}.new"])
@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_nothing_is_written_through_a_planted_link(
    tmp_path: Path, name: str, link: Callable[[Path, Path], None]
):
    target, folder = tmp_path / "precious", tmp_path / "net"
    target.write_text("mine")
    folder.mkdir()
    link(folder / name, target)
    write_small(folder)
    assert target.read_text() == "mine"
    assert {path.name for path in folder.iterdir()} == {CONFIG, TENSORS}
    assert not any(path.is_symlink() for path in folder.iterdir())
    assert read_checkpoint(folder)[0] == {"nodes": 1}


@pytest.mark.parametrize("name", [CONFIG, f"{CONFIG}.new", f"{TENSORS}.new"])
def test_a_planted_link_to_nowhere_is_not_followed(folder: Path, name: str):
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(folder.parent / "elsewhere")
    write_small(folder)
    assert {path.name for path in folder.parent.iterdir()} == {"net"}
    assert read_checkpoint(folder)[0] == {"nodes": 1}


def test_a_config_that_is_a_link_is_not_renamed(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A load may read it, as it is the right one; a save, be it killed, puts no link in place."""
    tensors = read_checkpoint(folder)[1]
    monkeypatch.setattr("pacnet.core.checkpoint.open_synced", None)
    (tmp_path / "config").write_bytes((folder / CONFIG).read_bytes())
    (folder / f"{CONFIG}.new").symlink_to(tmp_path / "config")
    assert read_checkpoint(folder)[0] == {"nodes": 2}
    with pytest.raises(TypeError):
        write_checkpoint(folder, {"nodes": 2}, tensors)
    assert not (folder / CONFIG).is_symlink()


def test_a_folder_may_be_a_link(folder: Path, tmp_path: Path):
    (tmp_path / "linked").symlink_to(folder)
    write_small(tmp_path / "linked")
    assert (tmp_path / "linked").is_symlink()
    assert read_checkpoint(folder)[0] == {"nodes": 1}

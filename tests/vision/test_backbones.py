"""Encoders with weights of others: found on this machine or refused, and the same when loaded."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest
import torch
from discs import HEIGHT, WIDTH, demonstrations, hands_of, picture_of, places
from safetensors.torch import save_file
from torch import Tensor, nn

from benchmarks.metaworld.camera.pretrained import KIND
from pacnet.vision import Cameras, ImageEncoder, ImageEncoderConfig, register_backbone
from pacnet.vision.backbones import features_of
from pacnet.vision.fitting import fit_cameras
from pacnet.vision.networks import network_of

models = pytest.importorskip("torchvision.models")


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No weights but the tests' own are found."""
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))


def edges(seed: int = 0) -> nn.Module:
    torch.manual_seed(seed)
    return nn.Conv2d(3, 4, 5, stride=4)


def fitted(kind: str, count: int = 6) -> Cameras:
    seen = demonstrations(count)
    cameras, _ = fit_cameras(seen, hands_of(seen), ("x", "y"), kind)
    assert cameras is not None
    return cameras


def put(name: str, module: nn.Module, torch_home: Path) -> None:
    """Put weights where torch keeps those of a network."""
    file = models.get_model_weights(name).DEFAULT.url.rpartition("/")[2]
    folder = torch_home / "hub" / "checkpoints"
    folder.mkdir(parents=True, exist_ok=True)
    torch.save(module.state_dict(), folder / file)


def test_a_pretrained_network_of_ones_own_tells_where_the_hand_will_be():
    features, _ = features_of(KIND, HEIGHT, WIDTH)
    assert features == 112 * (HEIGHT // 16) * (WIDTH // 16)  # lite0's tenth block has 112 maps
    (encoder,) = fitted(KIND, 12).encoders.values()
    assert encoder.told.chance < 0.05
    assert encoder.told.error < 0.6 * encoder.told.alone


class Scaled(nn.Module):
    """Edges, in another unit."""

    def __init__(self, scale: float) -> None:
        super().__init__()
        self.maps, self.scale = edges(), scale

    def forward(self, pictures: Tensor) -> Tensor:
        """Return maps of pictures."""
        return self.scale * self.maps(pictures)


def looks_of(scale: float, count: int, pictures: list[Tensor]) -> tuple[Tensor, Tensor]:
    """What is told of pictures, and their doubts, by a network in some unit."""
    register_backbone("scaled", functools.partial(Scaled, scale))
    (encoder,) = fitted("custom:scaled", count).encoders.values()
    looks = [encoder.look(picture) for picture in pictures]
    return torch.stack([look.goals for look in looks]), torch.tensor([one.doubt for one in looks])


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_the_unit_of_a_networks_features_changes_nothing(scale: float):
    pictures = [torch.from_numpy(picture_of(place)) for place in places(5, seed=3)]
    pictures.append(torch.randint(255, (HEIGHT, WIDTH, 3)).byte())
    goals, doubts = looks_of(1.0, 8, pictures)
    same, alike = looks_of(scale, 8, pictures)
    assert doubts[-1] > 1 > doubts[0]
    torch.testing.assert_close(same, goals, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(alike, doubts, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_noise_is_nothing_new_to_a_network_that_was_shown_the_same_each_time(scale: float):
    register_backbone("scaled", functools.partial(Scaled, scale))
    features, digest = features_of("custom:scaled", HEIGHT, WIDTH)
    config = ImageEncoderConfig("custom:scaled", HEIGHT, WIDTH, 8, 7, features, digest)
    encoder = ImageEncoder(config)
    shown, again = (torch.from_numpy(picture_of((0.5, 0.6), noise=1.0, seed=n)) for n in range(2))
    for number in range(4):
        encoder.add(shown, shown, torch.arange(8.0), number)
    encoder.fit()
    assert encoder.look(again).doubt < 1
    assert encoder.look(torch.from_numpy(picture_of((0.2, 0.9)))).doubt > 1


def test_maps_are_pooled_to_eight_cells_a_side():
    register_backbone("eights", functools.partial(nn.Conv2d, 3, 4, 5, stride=4))
    # (48 − 5) // 4 + 1 = 11 rows and (64 − 5) // 4 + 1 = 15 columns, more than 8 each.
    assert features_of("custom:eights", 48, 64)[0] == 4 * 8 * 8
    assert features_of("custom:eights", 21, 64)[0] == 4 * 5 * 8  # 5 rows stay


def test_features_of_a_picture_do_not_depend_on_those_beside_it():
    register_backbone("edges", edges)
    (encoder,) = fitted("custom:edges").encoders.values()
    pictures = torch.stack([torch.from_numpy(picture_of(place)) for place in places(11, seed=3)])
    together = encoder._features(pictures)
    alone = torch.cat([encoder._features(picture[None]) for picture in pictures])
    torch.testing.assert_close(together, alone)


def test_a_network_is_made_once_and_draws_no_random_numbers():
    made = []

    def make() -> nn.Module:
        made.append(torch.rand(3))
        return edges(7)

    register_backbone("once", make)
    torch.manual_seed(5)
    fitted("custom:once")
    fitted("custom:once")
    drawn = torch.rand(1)
    torch.manual_seed(5)
    assert len(made) == 1
    assert torch.equal(drawn, torch.rand(1))


def test_a_cameras_state_goes_into_others_of_the_same_weights():
    register_backbone("edges", edges)
    cameras = fitted("custom:edges")
    register_backbone("edges", edges)  # as another process does
    twin = Cameras(cameras.config)
    twin.load_state_dict(cameras.state_dict())
    picture = torch.from_numpy(picture_of(places(1, seed=3)[0]))
    for one, other in zip(cameras.parts, twin.parts, strict=True):
        assert torch.equal(one.look(picture).goals, other.look(picture).goals)
    assert not [name for name in cameras.state_dict() if "conv" in name or "bias" in name]


def test_other_weights_than_those_of_the_fit_are_refused():
    register_backbone("edges", edges)
    config = fitted("custom:edges").config
    register_backbone("edges", lambda: edges(seed=1))
    with pytest.raises(ValueError, match="expected the weights of 'custom:edges' with which"):
        Cameras(config)


def test_another_number_of_features_than_the_networks_is_refused():
    register_backbone("edges", edges)
    (config,) = fitted("custom:edges").config.encoders
    with pytest.raises(ValueError, match="expected 256 features of 'custom:edges'"):
        ImageEncoder(ImageEncoderConfig(**{**vars(config), "features": 255}))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("custom:never", "to be registered before it is used"),
        ("torchvision:resnet180", "expected a network of torchvision, got 'resnet180'"),
        ("torchvision:resnet18", r"'.*resnet18-\w+\.pth': put https://\S+ there"),
        ("file:resnet18.pth", "expected a file of tensors alone"),
        ("file:nowhere/resnet18.safetensors", "got none there"),
        ("timm:nothing.at_all", "timm"),
        ("hf:no/model", "pip install transformers|hf download"),
    ],
)
def test_what_is_not_on_this_machine_is_named(kind: str, message: str):
    seen = demonstrations(3)
    with pytest.raises(ValueError, match=message):
        fit_cameras(seen, hands_of(seen), ("x", "y"), kind)
    with pytest.raises(ValueError, match=message):  # likewise where a checkpoint asks for it
        ImageEncoder(ImageEncoderConfig(kind, HEIGHT, WIDTH, 8, features=64, digest="0" * 64))


@pytest.mark.parametrize(
    "make",
    [lambda: nn.Flatten(), lambda: lambda pictures: pictures],
    ids=["makes no maps", "is no module"],
)
def test_a_network_of_ones_own_that_is_none_is_refused(make):
    register_backbone("none", make)
    with pytest.raises(ValueError, match=r"expected (maps of features|'custom:none' to make)"):
        features_of("custom:none", HEIGHT, WIDTH)


def test_a_network_of_torchvision_is_found_in_torchs_cache(tmp_path: Path):
    torch.manual_seed(0)
    whole = models.get_model("resnet18", weights=None).eval()
    put("resnet18", whole, tmp_path / "torch")
    maps = network_of("torchvision:resnet18")(torch.rand(2, 3, 96, 128))
    assert maps.shape == (2, 512, 7, 7)  # a 32nd of 224 pixels


def test_pictures_are_brought_to_what_weights_for_imagenet_want(tmp_path: Path):
    torch.manual_seed(0)
    whole = models.get_model("squeezenet1_1", weights=None).eval()
    put("squeezenet1_1", whole, tmp_path / "torch")
    network = network_of("torchvision:squeezenet1_1")
    wanted = models.get_model_weights("squeezenet1_1").DEFAULT.transforms()
    picture = torch.rand(1, 3, 224, 224)
    normal = (picture - torch.tensor(wanted.mean)[:, None, None]) / torch.tensor(wanted.std)[
        :, None, None
    ]
    with torch.no_grad():
        torch.testing.assert_close(network(picture), whole.features(normal))


def test_weights_in_a_file_are_those_of_the_network_that_begins_its_name(tmp_path: Path):
    torch.manual_seed(0)
    whole = models.get_model("squeezenet1_1", weights=None)
    path = tmp_path / "squeezenet1_1-mine.safetensors"
    save_file(whole.state_dict(), path)
    put("squeezenet1_1", whole, tmp_path / "torch")
    count, digest = features_of(f"file:{path}", HEIGHT, WIDTH)
    assert count == 512 * 8 * 8
    assert digest == features_of("torchvision:squeezenet1_1", HEIGHT, WIDTH)[1]


def test_a_file_of_other_weights_or_of_none_is_refused(tmp_path: Path):
    wrong, broken = tmp_path / "resnet18-a.safetensors", tmp_path / "resnet18-b.safetensors"
    save_file({"weight": torch.zeros(2)}, wrong)
    broken.write_bytes(b"no safetensors")
    for path, message in ((wrong, "got others"), (broken, "expected safetensors")):
        with pytest.raises(ValueError, match=message):
            features_of(f"file:{path}", HEIGHT, WIDTH)


def test_weights_of_torchvision_run_no_code(tmp_path: Path):
    evil = tmp_path / "torch" / "hub" / "checkpoints" / "resnet18-f37072fd.pth"
    evil.parent.mkdir(parents=True)
    torch.save({"conv1.weight": Evil(tmp_path / "harm")}, evil)
    with pytest.raises(ValueError, match="expected tensors alone in"):
        network_of("torchvision:resnet18")
    assert not (tmp_path / "harm").exists()


class Evil:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        """Ask for the file."""
        return Path.touch, (self.path,)

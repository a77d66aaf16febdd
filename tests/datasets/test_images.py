"""Claims about images: refused as they are, read through an encoder."""

from pathlib import Path

import pytest
import torch
from pictures import COLOURS, LENGTHS, TOP, write_pictures
from torch import Tensor

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.format import DatasetError

# What LeRobot's 0.4 line decodes videos with says so.
pytestmark = pytest.mark.filterwarnings("ignore:The video decoding and encoding:UserWarning")


@pytest.fixture(scope="module", params=["image", "video"])
def root(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pictures(tmp_path_factory.mktemp("pictures") / "seen", request.param)


def mean_colour(image: Tensor) -> Tensor:
    return image.mean(dim=(1, 2))


def test_an_encoder_sees_every_image_in_its_place(root: Path):
    demonstrations = load_demonstrations(root, encoders={TOP: mean_colour})
    assert [len(episode.percepts) for episode in demonstrations] == list(LENGTHS)
    encoded = torch.cat([episode.encoded for episode in demonstrations])
    # Video coding keeps colours to a few 255ths.
    assert torch.allclose(encoded, torch.tensor(COLOURS / 255).float(), atol=0.03)
    first = demonstrations.episodes[0]
    assert torch.equal(first.percepts, torch.cat([first.state, first.encoded], dim=1))
    assert demonstrations.percept_features == {
        "observation.state": ("a", "b"),
        TOP: (f"{TOP}.0", f"{TOP}.1", f"{TOP}.2"),
    }


def test_an_encoder_may_give_the_same_buffer_every_time(root: Path):
    buffer = torch.zeros(1)

    def count(_: Tensor) -> Tensor:
        return buffer.add_(1)

    demonstrations = load_demonstrations(root, encoders={TOP: count})
    encoded = torch.cat([episode.encoded for episode in demonstrations])
    assert encoded.flatten().tolist() == [1, 2, 3, 4, 5]


def test_images_without_encoders_are_skipped(root: Path):
    demonstrations = load_demonstrations(root)
    assert set(demonstrations.names) == {"observation.state", "action"}
    assert all(episode.encoded is None for episode in demonstrations)


def test_images_without_encoders_as_a_state_are_refused(root: Path):
    with pytest.raises(DatasetError, match=r"encoders=\{'observation.images.top': encoder\}"):
        load_demonstrations(root, state=TOP)


@pytest.mark.parametrize("feature", ["observation.state", "observation.images.left"])
def test_encoders_are_for_images_of_the_dataset(root: Path, feature: str):
    with pytest.raises(ValueError, match=rf"of the dataset \({TOP}\), got one for '{feature}'"):
        load_demonstrations(root, encoders={feature: mean_colour})


@pytest.mark.parametrize(
    ("encoder", "got"),
    [
        (lambda image: image, r"got \[3, 64, 96\]"),
        (lambda image: float(image.mean()), "got float"),
        (lambda image: image.mean(dim=(1, 2)) * torch.nan, "in frame 0"),
        (lambda image: torch.ones(1 + int(image[2, 0, 0] * 255 < 199.5)), "length 1, got .* 2"),
    ],
)
def test_what_an_encoder_must_give(root: Path, encoder, got: str):
    with pytest.raises(ValueError, match=f"the encoder of '{TOP}' to give a finite vector.*{got}"):
        load_demonstrations(root, encoders={TOP: encoder})

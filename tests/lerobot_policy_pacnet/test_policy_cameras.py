"""The LeRobot policy looks at pictures: learned from a dataset's files, acted on from batches."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import sights
import torch
from sights import HEIGHT, NAMES, TOP, WIDTH
from torch import Tensor

pytest.importorskip("lerobot")
pytest.importorskip("lerobot_policy_pacnet")

from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.utils import preprocess_observation
from lerobot.policies.factory import make_pre_post_processors
from lerobot_policy_pacnet.pictures import DatasetPictures, pictures_of

from lerobot_policy_pacnet import PACNetConfig, PACNetPolicy
from pacnet.datasets.demonstrations import Demonstrations, load_demonstrations
from pacnet.datasets.format import DatasetError, DatasetWarning
from pacnet.imitator.imitator import Imitator

STATE, ACTION, LEFT = "observation.state", "action", "observation.images.left"
SHOWN = 6  # demonstrations


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("cameras")
    sights.write(root / "shown", sights.demonstrations(SHOWN))
    sights.write(root / "others", sights.demonstrations(2, seed=7))
    return root


@pytest.fixture(scope="module")
def trained(folder: Path) -> PACNetPolicy:
    policy = policy_for(folder / "shown")
    for batch in batches(seen(folder / "shown"), seed=1, size=32):
        policy.forward(batch)
    return policy.eval()


def config_of(**settings) -> PACNetConfig:
    config = PACNetConfig(device="cpu", **settings)
    config.input_features = {
        TOP: PolicyFeature(FeatureType.VISUAL, (3, HEIGHT, WIDTH)),
        STATE: PolicyFeature(FeatureType.STATE, (2,)),
    }
    config.output_features = {ACTION: PolicyFeature(FeatureType.ACTION, (2,))}
    return config


def policy_for(root: Path, **settings) -> PACNetPolicy:
    return PACNetPolicy(config_of(**settings), dataset_meta=meta_of(root)).train()


def meta_of(root: Path) -> SimpleNamespace:
    """What LeRobot's metadata say of a dataset."""
    shown = load_demonstrations(root)
    frames = torch.cat([one.state for one in shown])
    return SimpleNamespace(
        fps=shown.fps,
        features={
            name: {"dtype": "float32", "shape": (2,), "names": list(NAMES[name])} for name in NAMES
        },
        total_frames=len(frames),
        total_episodes=len(shown),
        stats={STATE: {"mean": frames.mean(dim=0).numpy()}},
        repo_id=f"local/{root.name}",
        root=root,
    )


def seen(root: Path) -> Demonstrations:
    return load_demonstrations(root, cameras="all")


def as_lerobot(pictures: np.ndarray) -> Tensor:
    """Float pictures `[B, 3, H, W]` from 0 to 1."""
    return torch.from_numpy(np.array(pictures)).permute(0, 3, 1, 2).float() / 255


def batches(dataset: Demonstrations, seed: int, size: int) -> Iterator[dict]:
    """One pass over a dataset, shuffled, with its pictures."""
    lengths = torch.tensor([len(one.state) for one in dataset])
    episodes = torch.tensor([one.episode for one in dataset])
    columns = {
        STATE: torch.cat([one.state for one in dataset]),
        ACTION: torch.cat([one.action for one in dataset]),
        TOP: as_lerobot(np.concatenate([one.pictures[TOP] for one in dataset])),
        "index": torch.arange(int(lengths.sum())),
        "episode_index": torch.repeat_interleave(episodes, lengths),
    }
    order = torch.randperm(int(lengths.sum()), generator=torch.Generator().manual_seed(seed))
    for rows in order.split(size):
        yield {name: column[rows] for name, column in columns.items()} | {
            "task": ["reach"] * len(rows)
        }


def test_shuffled_batches_teach_what_the_files_do(folder: Path, trained: PACNetPolicy):
    shown = seen(folder / "shown")
    expected = Imitator.from_demonstrations(shown)
    expected.learn(shown)
    assert trained.imitator.cameras.features == (TOP,)
    assert trained.imitator.config == expected.config
    for name, tensor in expected.state_dict().items():
        own = trained.imitator.state_dict()[name]
        torch.testing.assert_close(own, tensor, rtol=0, atol=0, msg=name)


def test_it_acts_on_pictures_as_the_imitator_does(folder: Path, trained: PACNetPolicy):
    first, second = seen(folder / "others")
    trained.reset()
    expected = [[*trained.imitator.fork().follow(one)] for one in (first, second)]
    before, _ = make_pre_post_processors(trained.config)
    for frame in range(20):
        observation = {  # of two environments at once
            "agent_pos": np.stack([one.state[frame].numpy() for one in (first, second)]),
            "pixels": {"top": np.stack([one.pictures[TOP][frame] for one in (first, second)])},
        }
        action = trained.select_action(before(preprocess_observation(observation)))
        wanted = np.stack([steps[frame].action for steps in expected])
        np.testing.assert_array_equal(action.numpy(), wanted)


def test_pictures_are_read_only_while_they_are_looked_at(
    folder: Path, trained: PACNetPolicy, tmp_path: Path
):
    shown, tasks, until = seen(folder / "others").episodes, ["reach", "reach"], 2
    trained.save_pretrained(tmp_path)
    policy = PACNetPolicy.from_pretrained(tmp_path)
    cameras = policy.imitator.cameras
    cameras.config = replace(cameras.config, until=until)
    policy.reset()

    def act(frame: int, *pictures: Tensor) -> None:
        state = torch.stack([one.state[frame] for one in shown])
        policy.select_action({STATE: state, TOP: torch.cat(pictures), LEFT: None, "task": tasks})

    unread = torch.full((1, 3, HEIGHT, WIDTH), torch.nan)  # refused when it is converted
    first, second = (as_lerobot(one.pictures[TOP][:1]) for one in shown)
    with pytest.raises(ValueError, match="float from 0 to 1"):
        act(0, first, unread)
    for frame in range(until + 1):
        act(frame, first, second)
    act(until + 1, unread, unread)
    tasks[1] = ""  # the second robot begins a new episode
    with pytest.raises(ValueError, match="float from 0 to 1"):
        act(until + 2, unread, unread)
    act(until + 2, unread, second)


@pytest.mark.parametrize("goal", [(0.3, 0.8), (0.7, 0.3)])
def test_the_hand_goes_where_the_picture_shows_the_square(
    goal: tuple[float, float], trained: PACNetPolicy
):
    trained.reset()
    hand, place = np.array([-0.15, -0.15], np.float32), np.array(goal)
    for _ in range(2 * sights.FRAMES):
        batch = {
            STATE: torch.from_numpy(hand)[None],
            TOP: as_lerobot(sights.picture(place, hand)[None]),
        }
        hand = hand + trained.select_action(batch)[0].numpy()
    assert np.linalg.norm(hand - place) < 0.05


def test_save_and_load_keep_the_cameras(folder: Path, trained: PACNetPolicy, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    loaded = PACNetPolicy.from_pretrained(tmp_path)
    one = seen(folder / "others").episodes[0]
    for policy in (trained, loaded):
        policy.reset()
    for frame in range(5):
        batch = {STATE: one.state[frame][None], TOP: as_lerobot(one.pictures[TOP][frame][None])}
        torch.testing.assert_close(loaded.select_action(batch), trained.select_action(batch))
    assert loaded.config.camera_features == (TOP,)


def test_an_unfinished_pass_is_seen_too_and_goes_on(folder: Path, tmp_path: Path):
    whole = [*batches(seen(folder / "shown"), seed=3, size=32)]
    policy = policy_for(folder / "shown")
    for batch in whole[:5]:
        policy.forward(batch)
    policy.save_pretrained(tmp_path)
    assert policy.imitator.cameras is not None
    again = PACNetPolicy.from_pretrained(
        tmp_path, config=config_of(), dataset_meta=meta_of(folder / "shown")
    ).train()
    for batch in whole:
        again.forward(batch)
    shown = seen(folder / "shown")
    expected = Imitator.from_demonstrations(shown)
    expected.learn(shown)
    for name, tensor in expected.state_dict().items():
        torch.testing.assert_close(again.imitator.state_dict()[name], tensor, msg=name)


def test_frames_that_were_collected_have_their_own_pictures(folder: Path):
    pictures = DatasetPictures(folder / "shown", [TOP], named=True)
    pictures.read([2])
    expected = seen(folder / "shown").episodes[2].pictures[TOP]
    first = 2 * sights.FRAMES
    some = pictures.of_frames(2, first + torch.tensor([0, 5, 39]))
    np.testing.assert_array_equal(some[TOP], expected[[0, 5, 39]])
    every = pictures.of_frames(2, torch.arange(first, first + sights.FRAMES))
    np.testing.assert_array_equal(every[TOP], expected)
    with pytest.raises(ValueError, match="expected 40 frames in episode 2, got others"):
        pictures.of_frames(2, torch.tensor([first - 1]))
    with pytest.raises(ValueError, match="expected pictures of episode 9"):
        pictures.read([9])


@pytest.mark.parametrize("broken", [TOP, LEFT])
def test_what_is_not_learned_is_not_read(folder: Path, tmp_path: Path, broken: str):
    one = seen(folder / "shown").episodes[0]
    both = {LEFT: one.pictures[TOP], TOP: one.pictures[TOP]}
    episodes = tuple(replace(one, episode=number, pictures=both) for number in range(3))
    shown = replace(seen(folder / "shown"), episodes=episodes)
    root = sights.write(tmp_path / "both", shown)
    for path in root.glob(f"videos/{broken}/**/*.mp4"):
        path.write_bytes(b"")
    left, top = (DatasetPictures(root, [name], named=False) for name in (LEFT, TOP))
    whole, unread = (left, top) if broken == TOP else (top, left)
    whole.read([1])
    assert len(whole.of_frames(1, sights.FRAMES + torch.arange(sights.FRAMES))) == 1
    with pytest.raises(DatasetError, match=f"the camera '{broken}' cannot be read"):
        unread.read([1])
    every = DatasetPictures(root, [LEFT, TOP], named=False)
    with pytest.warns(DatasetWarning, match=f"left out the camera '{broken}'"):
        every.read([1])
    with pytest.raises(DatasetError, match="expected a camera of the dataset"):
        DatasetPictures(root, ["observation.images.wrist"], named=False)


def test_videos_of_episodes_that_are_not_learned_are_not_opened(folder: Path, tmp_path: Path):
    root = sights.write(tmp_path / "seen", seen(folder / "shown"))
    part = seen(root)
    sights.write(root, sights.demonstrations(1, seed=7))  # has a file of its own
    _, own = sorted(root.glob("videos/**/*.mp4"))
    whole = seen(root)
    own.write_bytes(b"no video")
    policy = policy_for(root)
    for batch in batches(part, seed=1, size=64):
        policy.forward(batch)
    policy.eval()
    assert policy.imitator.cameras.features == (TOP,)
    policy.train()
    with pytest.raises(DatasetError, match=f"in episode {SHOWN} cannot be read"):
        policy.forward(next(batches(whole, seed=1, size=10**6)))


def test_a_second_dataset_is_seen_by_the_same_cameras(folder: Path, tmp_path: Path):
    policy = policy_for(folder / "shown")
    for batch in batches(seen(folder / "shown"), seed=1, size=64):
        policy.forward(batch)
    policy.save_pretrained(tmp_path)
    more = PACNetPolicy.from_pretrained(
        tmp_path, config=config_of(), dataset_meta=meta_of(folder / "others")
    ).train()
    for batch in batches(seen(folder / "others"), seed=2, size=64):
        more.forward(batch)
    assert len(more.imitator.reports) == SHOWN + 2
    assert len(more.imitator.cameras.encoders[TOP].shown) == SHOWN + 2


def test_no_camera_is_looked_at_if_so_asked(folder: Path):
    policy = policy_for(folder / "shown", cameras=[])
    for batch in batches(seen(folder / "shown"), seed=1, size=64):
        policy.forward(batch)
    policy.eval()
    assert policy.imitator.cameras is None
    assert policy.select_action({STATE: torch.zeros(1, 2)}).shape == (1, 2)


def test_the_loss_is_without_what_cameras_tell(folder: Path, trained: PACNetPolicy):
    batch = next(batches(seen(folder / "shown"), seed=1, size=32))
    loss, _ = trained.forward(batch)
    sofm = trained.imitator.sofm
    apart = (batch[STATE][:, None] - sofm.prototypes[:, :2]) * sofm.scale[:2]
    expected = 1 - torch.exp(-apart.norm(dim=2).amin(dim=1)).mean()
    torch.testing.assert_close(loss, expected)


@pytest.mark.parametrize(
    ("batch", "message"),
    [
        ({}, rf"expected the picture '{TOP}' in the batch, got observation\.state"),
        (
            {TOP: torch.zeros(1, 1, 96, 112)},
            r"of shape \[1, 3, height, width\], got \[1, 1, 96, 112",
        ),
        (
            {TOP: torch.zeros(2, 3, 96, 112)},
            r"of shape \[1, 3, height, width\], got \[2, 3, 96, 112",
        ),
        (
            {TOP: torch.full((1, 3, 96, 112), 255.0)},
            r"float from 0 to 1, got torch\.float32 from 255",
        ),
        ({TOP: torch.full((1, 3, 96, 112), torch.nan)}, "float from 0 to 1"),
        ({TOP: torch.zeros(1, 3, 48, 112)}, "112 x 96 pixels when reduced, got 112 x 48"),
    ],
)
def test_other_pictures_are_refused(batch: dict, message: str, trained: PACNetPolicy):
    with pytest.raises(ValueError, match=message):
        trained.select_action({STATE: torch.zeros(1, 2), **batch})


def test_pictures_are_the_same_in_every_form():
    rows = np.random.default_rng(0).integers(0, 256, (2, 4, 6, 3), np.uint8)
    last = torch.from_numpy(rows)
    forms = [as_lerobot(rows), as_lerobot(rows)[:, None], last, last.permute(0, 3, 1, 2)]
    for form in forms:
        got = pictures_of({TOP: form}, [TOP], [True, True])
        np.testing.assert_array_equal(np.stack([one[TOP] for one in got]), rows)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"cameras": [LEFT]}, rf"expected policy.cameras out of {TOP}, got '{LEFT}'"),
        ({"cameras": TOP}, "expected policy.cameras as a list of texts"),
        ({"encoder": "magic"}, "expected policy.encoder as auto, patches"),
    ],
)
def test_settings_are_checked(settings: dict, message: str):
    with pytest.raises(ValueError, match=message):
        PACNetPolicy(config_of(**settings))


def test_a_camera_that_was_learned_must_stay(folder: Path, trained: PACNetPolicy, tmp_path: Path):
    trained.save_pretrained(tmp_path)
    with pytest.raises(ValueError, match=f"expected the camera '{TOP}', as learned before"):
        PACNetPolicy.from_pretrained(tmp_path, config=config_of(cameras=[]))
    assert folder.is_dir()

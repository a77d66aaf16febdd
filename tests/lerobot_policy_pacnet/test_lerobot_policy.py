"""The LeRobot policy without LeRobot's commands: batches in, an imitator and actions out."""

import copy
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor

pytest.importorskip("lerobot")
pytest.importorskip("lerobot_policy_pacnet")

import draccus
import gymnasium
from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature
from lerobot.envs.factory import make_env
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot_policy_pacnet.acting import MOVING
from lerobot_policy_pacnet.description import DatasetDescription
from lerobot_policy_pacnet.training import ENOUGH

from lerobot_policy_pacnet import PACNetConfig, PACNetEnv, PACNetPolicy, scenes
from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.imitator import Imitator, ImitatorStep

STATE, GLASS, ACTION = "observation.state", "observation.environment_state", "action"
NAMES = {STATE: ("shoulder.pos", "elbow.pos"), GLASS: ("glass",), ACTION: ("shoulder", "elbow")}
FPS = 20
FAR = torch.tensor([[30.0, 30.0]])  # a state far from all demonstrations


@dataclass
class Settings:
    """Settings of a command of LeRobot's that takes a policy."""

    policy: PreTrainedConfig


def waves(seed: int, count: int = 3, length: int = 120, names: dict = NAMES) -> Demonstrations:
    """Noisy demonstrations of a movement whose form the seed decides."""
    generator = torch.Generator().manual_seed(seed)
    episodes = []
    for number in range(count):
        phase = torch.linspace(0, 6, length + 10 * number)
        path = torch.stack([phase.sin() + seed, (phase + 1).cos(), phase / 6], dim=1)
        seen = path + 0.02 * torch.randn(path.shape, generator=generator)
        action = path[:, :2].contiguous()
        episodes.append(Demonstration(number, f"wave {seed}", seen[:, :2], seen[:, 2:], action))
    return Demonstrations(FPS, names, tuple(episodes), f"waves {seed}")


def joined(*parts: Demonstrations) -> Demonstrations:
    """Datasets one after the other, as appending makes them."""
    episodes = [episode for part in parts for episode in part]
    renumbered = [
        Demonstration(number, old.task, old.state, old.environment_state, old.action)
        for number, old in enumerate(episodes)
    ]
    return Demonstrations(FPS, NAMES, tuple(renumbered), "joined")


def meta_of(dataset: Demonstrations) -> SimpleNamespace:
    """What LeRobot's metadata say of a dataset."""
    frames = [torch.cat([one.percepts, one.action], dim=1) for one in dataset]
    mean = torch.cat(frames).mean(dim=0).numpy()
    return SimpleNamespace(
        fps=dataset.fps,
        features={
            name: {"dtype": "float32", "shape": (len(parts),), "names": list(parts)}
            for name, parts in dataset.names.items()
        },
        total_frames=sum(map(len, frames)),
        total_episodes=len(dataset),
        stats={STATE: {"mean": mean[:2]}, GLASS: {"mean": mean[2:3]}, ACTION: {"mean": mean[3:]}},
        repo_id=f"local/{dataset.source}",
        root=Path("/nowhere") / dataset.source,
    )


def frames_of(dataset: Demonstrations) -> dict[str, Tensor | list[str]]:
    """All frames of a dataset as one batch."""
    lengths = [len(one.state) for one in dataset]
    return {
        STATE: torch.cat([one.state for one in dataset]),
        GLASS: torch.cat([one.environment_state for one in dataset]),
        ACTION: torch.cat([one.action for one in dataset]),
        "index": torch.arange(sum(lengths)),
        "episode_index": torch.repeat_interleave(
            torch.tensor([one.episode for one in dataset]), torch.tensor(lengths)
        ),
        "task": [one.task for one in dataset for _ in one.state],
    }


def batches(dataset: Demonstrations, seed: int, size: int) -> Iterator[dict]:
    """One pass over a dataset, shuffled."""
    frames = frames_of(dataset)
    order = torch.randperm(len(frames["index"]), generator=torch.Generator().manual_seed(seed))
    for rows in order.split(size):
        yield {
            name: [column[row] for row in rows.tolist()] if name == "task" else column[rows]
            for name, column in frames.items()
        }


def config_of(names: dict = NAMES, **settings) -> PACNetConfig:
    kinds = {GLASS: FeatureType.ENV, ACTION: FeatureType.ACTION}
    features = {
        name: PolicyFeature(kinds.get(name, FeatureType.STATE), (len(parts),))
        for name, parts in names.items()
    }
    action = {ACTION: features.pop(ACTION)}
    return PACNetConfig(device="cpu", input_features=features, output_features=action, **settings)


def policy_for(dataset: Demonstrations, **settings) -> PACNetPolicy:
    return PACNetPolicy(config_of(dataset.names, **settings), dataset_meta=meta_of(dataset))


def learn(policy: PACNetPolicy, seen: Iterator[dict]) -> list[float]:
    """Trains as lerobot-train does; the losses."""
    losses = []
    for batch in seen:
        policy.train()
        loss, _ = policy.forward(batch)
        loss.backward()
        losses.append(loss.item())
    return losses


def trained(dataset: Demonstrations) -> PACNetPolicy:
    policy = policy_for(dataset)
    learn(policy, batches(dataset, 0, 64))
    return policy.eval()


def reloaded(policy: PACNetPolicy, folder: Path, dataset: Demonstrations) -> PACNetPolicy:
    """Through a checkpoint, to go on with a dataset."""
    policy.save_pretrained(folder)
    config = config_of(dataset.names)
    return PACNetPolicy.from_pretrained(folder, config=config, dataset_meta=meta_of(dataset))


def learned_in_order(*datasets: Demonstrations) -> Imitator:
    imitator = Imitator.from_demonstrations(datasets[0])
    for dataset in datasets:
        imitator.learn(dataset)
    return imitator


def assert_same(found: Imitator | None, expected: Imitator) -> None:
    assert found is not None
    assert found.config == expected.config
    found_tensors, tensors = found.state_dict(), expected.state_dict()
    assert found_tensors.keys() == tensors.keys()
    for name, tensor in tensors.items():
        assert torch.equal(found_tensors[name], tensor), name
    assert found.reports == expected.reports


def percept(state: Sequence[float] | Tensor, glass: float = 0.5) -> dict[str, Tensor]:
    state = torch.as_tensor(state).reshape(1, -1)
    return {STATE: state, GLASS: torch.tensor([[glass]])}


@pytest.fixture(scope="module")
def dataset() -> Demonstrations:
    return waves(0)


@pytest.fixture(scope="module")
def policy(dataset: Demonstrations) -> PACNetPolicy:
    return trained(dataset)


@pytest.mark.parametrize(("seed", "size"), [(0, 1), (1, 64), (2, 1000)])
def test_a_shuffled_pass_is_the_dataset_in_order(dataset: Demonstrations, seed: int, size: int):
    policy = policy_for(dataset)
    learn(policy, batches(dataset, seed, size))
    assert_same(policy.imitator, learned_in_order(dataset))


def test_further_passes_change_nothing(dataset: Demonstrations):
    policy = policy_for(dataset)
    learn(policy, batches(dataset, 0, 64))
    learn(policy, batches(dataset, 1, 50))
    assert_same(policy.imitator, learned_in_order(dataset))


def test_the_loss_is_novelty_and_falls(dataset: Demonstrations):
    policy = policy_for(dataset)
    losses = learn(policy, batches(dataset, 0, 30))
    assert losses[0] == 1.0
    assert losses[ENOUGH // 30 + 1] < 0.5  # by then some was learned
    novelty = 1 - policy.imitator.sofm(torch.cat([one.percepts for one in dataset])).activation
    loss, counts = policy.forward(frames_of(dataset))
    assert loss.item() == pytest.approx(float(novelty.mean()))
    assert counts == {"nodes": policy.imitator.reports[-1].nodes}


def test_nothing_is_learned_while_evaluating(dataset: Demonstrations):
    policy = policy_for(dataset).eval()
    loss, _ = policy.forward(frames_of(dataset))
    assert loss.item() == 1.0
    assert policy.imitator is None


def test_collected_frames_are_learned_before_evaluation(dataset: Demonstrations):
    policy = policy_for(dataset)
    policy.forward(next(batches(dataset, 0, 100)))
    assert policy.imitator is None
    policy.eval()
    assert sum(report.frames for report in policy.imitator.reports) == 100


def test_a_resumed_training_ends_like_an_uninterrupted_one(dataset: Demonstrations, tmp_path: Path):
    policy, seen = policy_for(dataset), list(batches(dataset, 0, 40))
    for part in (seen[:3], seen[3:8], seen[8:]):
        learn(policy, iter(part))
        policy = reloaded(policy, tmp_path / f"{len(part)}", dataset)
    assert_same(policy.imitator, learned_in_order(dataset))


def test_a_second_dataset_adds_to_the_first(dataset: Demonstrations, tmp_path: Path):
    second = waves(2)
    policy = reloaded(trained(dataset), tmp_path / "first", second)
    seen = list(batches(second, 0, 40))
    learn(policy, iter(seen[:5]))
    policy = reloaded(policy, tmp_path / "between", second)
    learn(policy, iter(seen[5:]))
    assert_same(policy.imitator, learned_in_order(dataset, second))
    assert policy.imitator.config == Imitator.from_demonstrations(dataset).config


def test_of_a_dataset_that_has_grown_only_new_episodes_are_learned(
    dataset: Demonstrations, tmp_path: Path
):
    grown = joined(dataset, waves(2, count=1))
    policy = reloaded(trained(dataset), tmp_path, grown)
    learn(policy, batches(grown, 0, 40))
    expected = learned_in_order(dataset)
    expected.learn(Demonstrations(FPS, NAMES, grown.episodes[-1:], grown.source))
    assert_same(policy.imitator, expected)


def test_states_are_learned_as_targets(tmp_path: Path):
    dataset = waves(1, count=2)
    policy = PACNetPolicy(config_of(targets="state", lead=2), dataset_meta=meta_of(dataset))
    learn(policy, batches(dataset, 0, 64))
    expected = Imitator.from_demonstrations(dataset, targets="state", lead=2)
    expected.learn(dataset)
    assert_same(policy.imitator, expected)
    with pytest.raises(ValueError, match="targets=state, as learned before, got action"):
        reloaded(policy, tmp_path, waves(2))


PLACES = {
    STATE: ("hand.x", "hand.y"),
    GLASS: ("glass.x", "glass.y", "box.x", "box.y"),
    ACTION: ("hand.x", "hand.y"),
}
POINTS = [f"hand={STATE}[0:2]", f"box={GLASS}[2:4]"]


def pushes() -> Demonstrations:
    """Demonstrations of `waves` whose numbers are places, beside a glass and a box."""
    episodes = []
    for one in waves(1, count=2):
        places = torch.tensor([1.0, 2.0, 3.0, 4.0 + one.episode])
        surroundings = places.repeat(len(one.state), 1)
        episodes.append(replace(one, environment_state=surroundings))
    return Demonstrations(FPS, PLACES, tuple(episodes), "pushes")


@pytest.mark.parametrize(
    ("points", "chosen", "names"),
    [
        (None, "auto", ("hand", "glass", "box")),
        ([], None, None),
        (POINTS, POINTS, ("hand", "box")),
    ],
)
def test_points_are_those_of_the_config(points, chosen, names, tmp_path: Path):
    dataset = pushes()
    policy = policy_for(dataset, points=points)
    learn(policy, batches(dataset, 0, 64))
    expected = Imitator.from_demonstrations(dataset, points=chosen)
    expected.learn(dataset)
    assert_same(policy.imitator, expected)
    assert (expected.config.points and expected.config.points.names) == names
    policy.save_pretrained(tmp_path)
    loaded = PACNetPolicy.from_pretrained(tmp_path)
    assert loaded.config.points == points
    assert_same(loaded.imitator, expected)


def test_points_that_are_none_are_refused_at_once():
    for points in ("none", ["hand", 3], (f"hand={STATE}[0:2]",), {"hand": STATE}):
        with pytest.raises(ValueError, match=r"expected policy\.points as a list of texts"):
            config_of(PLACES, points=points)
    policy = policy_for(pushes(), points=[POINTS[0], "goal=goal"])
    with pytest.raises(ValueError, match=r"features observation.state \[2\], .*, got 'goal'"):
        learn(policy, batches(pushes(), 0, 4))
    action = policy_for(pushes(), points=[POINTS[0], "goal=action"])
    with pytest.raises(ValueError, match="got 'action'"):
        learn(action, batches(pushes(), 0, 4))


def test_other_points_than_those_learned_are_refused(tmp_path: Path):
    dataset = pushes()
    policy = policy_for(dataset, points=POINTS)
    learn(policy, batches(dataset, 0, 64))
    policy.save_pretrained(tmp_path)
    others = (
        ([], r"hand \[0, 1\], box \[4, 5\], as learned before, got none"),
        ([POINTS[0], f"box={GLASS}[0:2]"], r"got hand \[0, 1\], box \[2, 3\]"),
    )
    for points, message in others:
        with pytest.raises(ValueError, match=message):
            PACNetPolicy.from_pretrained(tmp_path, config=config_of(PLACES, points=points))
    for points in (None, POINTS):
        config = config_of(PLACES, points=points)
        same = PACNetPolicy.from_pretrained(tmp_path, config=config)
        assert same.imitator.config.points == policy.imitator.config.points


@pytest.mark.parametrize(
    ("given", "points"),
    [([], None), (["--policy.points=[]"], []), ([f"--policy.points={json.dumps(POINTS)}"], POINTS)],
)
def test_points_are_given_on_the_command_line(given: list[str], points: list[str] | None):
    settings = draccus.parse(Settings, args=["--policy.type=pacnet", *given])
    assert isinstance(settings.policy, PACNetConfig)
    assert settings.policy.points == points


def test_state_targets_wait_for_all_frames(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    dataset = waves(1, count=4)
    policy = PACNetPolicy(config_of(targets="state", lead=2), dataset_meta=meta_of(dataset))
    learn(policy, list(batches(dataset, 0, 64))[:-1])
    policy.save_pretrained(tmp_path)
    assert policy.imitator is None
    assert "an unfinished pass: a whole one takes 540 steps, divided by" in caplog.text
    learn(policy, batches(dataset, 0, 64))
    assert len(policy.imitator.reports) == 4


def test_other_features_and_rates_are_refused_at_once(dataset: Demonstrations, tmp_path: Path):
    others = waves(2, names={**NAMES, STATE: ("elbow.pos", "shoulder.pos")})
    policy = reloaded(trained(dataset), tmp_path, others)
    with pytest.raises(ValueError, match=r"expected 'observation\.state' with the dimensions"):
        learn(policy, batches(others, 0, 4))
    faster = Demonstrations(FPS + 1, NAMES, waves(2).episodes, "faster")
    policy = reloaded(trained(dataset), tmp_path, faster)
    with pytest.raises(ValueError, match="20 frames per second"):
        learn(policy, batches(faster, 0, 4))


def test_frames_without_names_and_of_one_dimension_are_understood(dataset: Demonstrations):
    policy = policy_for(dataset)
    policy._dataset_meta.features[GLASS]["names"] = None
    batch = frames_of(dataset)
    batch[STATE] = batch[STATE][:, None]  # a window of one frame
    batch[GLASS] = batch[GLASS].T  # LeRobot drops a dimension of 1, then adds one in front
    learn(policy, iter([batch]))
    assert policy.imitator.percept_names == ("shoulder.pos", "elbow.pos", "0")
    found = policy.imitator.sofm.state_dict()
    for name, tensor in learned_in_order(dataset).sofm.state_dict().items():
        assert torch.equal(found[name], tensor), name


def test_numbers_that_are_not_finite_are_refused_by_their_index(dataset: Demonstrations):
    policy = policy_for(dataset)
    batch = frames_of(dataset)
    batch[ACTION] = batch[ACTION].clone()
    batch[ACTION][130, 1] = torch.nan
    with pytest.raises(ValueError, match=r"others at index 130 \(episode 1\)"):
        policy.forward(batch)
    assert policy.eval().imitator is None


def test_settings_out_of_range_are_refused():
    with pytest.raises(ValueError, match=r"policy\.targets"):
        config_of(targets="goal")
    with pytest.raises(ValueError, match=r"policy\.lead"):
        config_of(lead=0)
    with pytest.raises(ValueError, match=r"env\.task"):
        PACNetEnv(task="Sleep-v0")


def test_several_processes_are_refused(dataset: Demonstrations, monkeypatch: pytest.MonkeyPatch):
    policy = policy_for(dataset)
    monkeypatch.setattr(torch.distributed, "is_initialized", lambda: True)
    monkeypatch.setattr(torch.distributed, "get_world_size", lambda: 2)
    with pytest.raises(ValueError, match="expected one process, got 2"):
        policy.forward(frames_of(dataset))


def test_learning_needs_the_metadata(dataset: Demonstrations):
    with pytest.raises(ValueError, match="expected dataset_meta to learn with"):
        PACNetPolicy(config_of()).forward(frames_of(dataset))


def test_a_frame_that_the_metadata_do_not_know_is_refused(dataset: Demonstrations):
    policy = policy_for(dataset)
    with pytest.raises(ValueError, match="got index 390"):
        policy.forward(frames_of(waves(0, count=4)))


def test_a_checkpoint_is_json_and_safetensors(
    policy: PACNetPolicy, dataset: Demonstrations, tmp_path: Path
):
    policy.save_pretrained(tmp_path)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.suffix for path in files} == {".json", ".safetensors"}
    assert_same(Imitator.from_pretrained(tmp_path / "imitator"), learned_in_order(dataset))
    again = get_policy_class("pacnet").from_pretrained(tmp_path)
    assert not again.training
    action = again.select_action(percept(dataset.episodes[0].state[50]))
    policy.reset()
    assert torch.equal(action, policy.select_action(percept(dataset.episodes[0].state[50])))


def test_a_policy_saved_by_version_0_1_is_refused_with_a_remedy(
    policy: PACNetPolicy, tmp_path: Path
):
    policy.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path / "imitator")
    fields["network"] = {}  # of which the schemas kept parts of the demonstrations
    write_checkpoint(tmp_path / "imitator", fields, tensors)
    with pytest.raises(ValueError, match="learn its demonstrations again"):
        PACNetPolicy.from_pretrained(tmp_path)


def test_an_untrained_policy_does_not_act():
    with pytest.raises(ValueError, match="expected a trained policy"):
        PACNetPolicy(config_of()).select_action(percept([0.0, 0.0]))


def test_each_row_of_a_batch_is_an_episode_of_its_own(
    policy: PACNetPolicy, dataset: Demonstrations
):
    first, second = (one.percepts[:80] for one in list(dataset)[:2])
    alone = []
    for rows in (first, second.flip(0)):
        policy.reset()
        alone.append(
            torch.cat(
                [policy.select_action({STATE: r[None, :2], GLASS: r[None, 2:]}) for r in rows]
            )
        )
    policy.reset()
    with torch.inference_mode():
        together = [
            policy.select_action({STATE: rows[:, :2], GLASS: rows[:, 2:]})
            for rows in torch.stack([first, second.flip(0)], dim=1)
        ]
    assert torch.equal(torch.stack(together, dim=1), torch.stack(alone))
    assert len(policy.last_steps) == 2


def test_rows_share_what_was_learned(dataset: Demonstrations):
    policy = trained(dataset)
    policy.select_action({STATE: FAR.expand(20, 2), GLASS: torch.zeros(20, 1)})
    places = {
        actor.imitator.memory.rows.percept.data_ptr()
        for actor in (*policy._actors, SimpleNamespace(imitator=policy.imitator))
    }
    assert len(policy._actors) == 20
    assert len(places) == 1


OPPOSITE = ("go up", "go down")  # tasks


def opposites() -> Demonstrations:
    """Two tasks that begin at the same place, and go up or down from there."""
    names = {STATE: ("x", "y"), GLASS: ("glass",), ACTION: ("x", "y")}
    shown = []
    for number in range(6):
        along = torch.linspace(0, 1.1, 110)[:, None]
        path = torch.cat([along, (1.0, -1.0)[number % 2] * along], dim=1)
        noise = torch.randn(100, 3, generator=torch.Generator().manual_seed(number))
        seen = torch.cat([path[:100], torch.zeros(100, 1)], dim=1) + 0.01 * noise
        task = OPPOSITE[number % 2]
        shown.append(Demonstration(number, task, seen[:, :2], seen[:, 2:], path[10:]))
    return Demonstrations(FPS, names, tuple(shown), "opposites")


@pytest.fixture(scope="module")
def up_or_down() -> PACNetPolicy:
    return trained(opposites())


def height(policy: PACNetPolicy, **task: object) -> float:
    """Which way it goes where both begin: 0.1 up, −0.1 down."""
    return float(policy.select_action({**percept([0.0, 0.0], 0.0), **task})[0, 1])


def test_a_task_restricts_what_is_followed(up_or_down: PACNetPolicy):
    policy = up_or_down
    for task, way in zip(OPPOSITE, (0.1, -0.1), strict=True):
        for given in (task, [task], f"  {task.replace(' ', '  ')}\n"):
            policy.reset()
            assert height(policy, task=given) == pytest.approx(way, abs=0.03)
            numbers = {one.demonstration for one in policy.last_steps[0].followed}
            assert {OPPOSITE[number % 2] for number in numbers} == {task}


@pytest.mark.parametrize("task", [{}, {"task": ""}, {"task": [" "]}, {"task": None}])
def test_without_a_task_all_that_was_shown_competes(up_or_down: PACNetPolicy, task: dict):
    up_or_down.reset()
    height(up_or_down, **task)
    assert {one.demonstration % 2 for one in up_or_down.last_steps[0].followed} == {0, 1}


def test_each_row_has_a_task_of_its_own(up_or_down: PACNetPolicy):
    up_or_down.reset()
    seen = {STATE: torch.tensor([[0.0, 0.0]] * 2), GLASS: torch.zeros(2, 1)}
    both = up_or_down.select_action({**seen, "task": list(OPPOSITE)})
    assert both[:, 1].tolist() == pytest.approx([0.1, -0.1], abs=0.03)


def test_another_task_is_begun_at_once(up_or_down: PACNetPolicy):
    up_or_down.reset()
    ways = [height(up_or_down, task=task) for task in (*OPPOSITE, *OPPOSITE)]
    assert ways == pytest.approx([0.1, -0.1, 0.1, -0.1], abs=0.03)


def test_the_task_of_the_config_takes_precedence(tmp_path: Path):
    policy = policy_for(opposites(), task="go down")
    learn(policy, batches(opposites(), 0, 64))
    assert height(policy.eval(), task="go up") == pytest.approx(-0.1, abs=0.03)
    policy.save_pretrained(tmp_path)
    assert PACNetPolicy.from_pretrained(tmp_path).config.task == "go down"
    policy.config.task = ""
    height(policy, task="go up")
    assert {one.demonstration % 2 for one in policy.last_steps[0].followed} == {0, 1}


def test_a_task_that_was_not_shown_is_refused_in_one_line(up_or_down: PACNetPolicy):
    up_or_down.reset()
    for _ in range(2):
        with pytest.raises(ValueError, match=r"^expected a task .*'go up', 'go down', got 'fly'$"):
            height(up_or_down, task="fly")
    for wrong in (["go up"] * 2, [3], 3):
        with pytest.raises(ValueError, match="expected a task, or one for each of 1 rows, got"):
            height(up_or_down, task=wrong)
    assert height(up_or_down, task="go up") == pytest.approx(0.1, abs=0.03)


def test_acting_learns_nothing(policy: PACNetPolicy, dataset: Demonstrations):
    before = copy.deepcopy(policy.imitator)
    policy.reset()
    for row in dataset.episodes[1].percepts:
        policy.select_action({STATE: row[None, :2], GLASS: row[None, 2:]})
    assert_same(policy.imitator, before)


def test_a_chunk_is_one_action(policy: PACNetPolicy, dataset: Demonstrations):
    seen = percept(dataset.episodes[0].state[50])
    policy.reset()
    action = policy.select_action(seen)
    policy.reset()
    assert torch.equal(policy.predict_action_chunk(seen), action[:, None])


def test_it_holds_at_novel_percepts(policy: PACNetPolicy, dataset: Demonstrations):
    policy.reset()
    mean_first = torch.stack([one.action[0] for one in dataset]).mean(dim=0)
    torch.testing.assert_close(policy.select_action(percept(FAR))[0], mean_first)
    shown = dataset.episodes[0]
    policy.reset()
    for row in shown.percepts[:60]:
        last = policy.select_action({STATE: row[None, :2], GLASS: row[None, 2:]})
    assert policy.last_steps[0].action is not None
    for _ in range(5):
        assert torch.equal(policy.select_action(percept(FAR)), last)
    assert policy.last_steps[0].is_novel
    known = {STATE: shown.percepts[60:61, :2], GLASS: shown.percepts[60:61, 2:]}
    for _ in range(60):
        action = policy.select_action(known)
        assert policy.last_steps[0].is_novel == torch.equal(action, last)
    assert not policy.last_steps[0].is_novel  # and it has gone on, where it had stopped
    # Where a robot stays, the position in a demonstration runs ahead by half a second at most.
    soon = shown.action[60 : 61 + FPS // 2]
    assert float((action - soon).abs().amax(dim=1).min()) < 0.05  # a step of the movement


def test_a_robot_holds_still_before_its_first_action():
    joints = ("shoulder.pos", "elbow.pos")
    policy = trained(waves(0, names={**NAMES, STATE: joints, ACTION: joints}))
    assert torch.equal(policy.select_action(percept(FAR)), FAR)


def test_a_robot_whose_state_says_more_than_is_commanded_holds_still_too():
    names = {
        **NAMES, STATE: ("elbow.vel", "shoulder.pos", "elbow.pos"),
        ACTION: ("elbow.pos", "shoulder.pos"),
    }  # fmt: skip
    shown = tuple(
        replace(one, state=torch.cat([one.state[:, :1].cos(), one.state], dim=1))
        for one in waves(0)
    )
    policy = trained(Demonstrations(FPS, names, shown, "three"))
    held = policy.select_action(percept(torch.tensor([9.0, 30.0, 20.0])))
    assert held.tolist() == [[20.0, 30.0]]


@pytest.mark.parametrize(
    "name",
    [
        "x.vel", "theta.vel", "mobile_base.vx", "mobile_base.vtheta", "linear_velocity",
        "ee.gripper_vel", "delta_x", "ee.delta_yaw", "vel",
    ],
)  # fmt: skip
def test_speeds_and_displacements_are_recognised_by_name(name: str):
    assert MOVING.search(name)


@pytest.mark.parametrize(
    "name", ["shoulder.pos", "level", "gripper", "velvet.pos", "x", "vy.pos", "delta"]
)
def test_other_actions_are_repeated(name: str):
    assert not MOVING.search(name)


def test_numbers_as_names_do_not_match_states_with_actions():
    names = {**NAMES, STATE: ("0", "1"), ACTION: ("0", "1")}
    dataset = waves(0, names=names)
    policy = trained(dataset)
    mean_first = torch.stack([one.action[0] for one in dataset]).mean(dim=0)
    torch.testing.assert_close(policy.select_action(percept(FAR))[0], mean_first)


def test_wheels_do_not_turn_before_the_first_action(
    monkeypatch: pytest.MonkeyPatch,
):
    joints = ("arm.pos", "wheel.vel")
    policy = trained(waves(0, names={**NAMES, STATE: joints, ACTION: joints}))
    step = Imitator.step
    monkeypatch.setattr(Imitator, "step", lambda *rest: step(*rest)._replace(action=None))
    row = waves(0).episodes[0].percepts[20]
    action = policy.select_action(percept(row[:2], float(row[2])))[0]
    assert not policy.last_steps[0].is_novel
    assert action.tolist() == [float(row[0]), 0.0]


def surroundings_alone() -> Demonstrations:
    """The same waves, all of them seen in the surroundings, where names are those of the action."""
    shown = tuple(
        replace(one, state=one.state[:, :0], environment_state=one.percepts) for one in waves(0)
    )
    names = {GLASS: ("shoulder", "elbow", "glass"), ACTION: ("shoulder", "elbow")}
    return Demonstrations(FPS, names, shown, "surroundings", state=())


def test_an_environment_state_alone_is_no_state_of_the_robot(tmp_path: Path):
    dataset = surroundings_alone()
    policy = policy_for(dataset)
    learn(policy, batches(dataset, 0, 64))
    assert_same(policy.imitator, learned_in_order(dataset))
    again = reloaded(policy, tmp_path, dataset)
    learn(again, batches(dataset, 1, 64))  # it knows these episodes
    assert_same(again.imitator, learned_in_order(dataset))
    mean_first = torch.stack([one.action[0] for one in dataset]).mean(dim=0)
    far = {GLASS: torch.tensor([[30.0, 30.0, 0.5]])}  # what surrounds a robot is not its posture
    torch.testing.assert_close(policy.eval().select_action(far)[0], mean_first)


def test_an_imitator_keeps_what_its_state_is(tmp_path: Path):
    """One from when the first feature was always the state goes on with a dataset alike."""
    dataset = surroundings_alone()
    policy = policy_for(dataset)
    learn(policy, batches(dataset, 0, 64))
    policy.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path / "imitator")
    del fields["state"], fields["action_features"]
    write_checkpoint(tmp_path / "imitator", fields, tensors)
    more = replace(dataset, episodes=dataset.episodes[:1], source="more")
    more = replace(more, episodes=(replace(more.episodes[0], task="another"),))
    again = PACNetPolicy.from_pretrained(
        tmp_path, config=config_of(dataset.names), dataset_meta=meta_of(more)
    )
    learn(again, batches(more, 0, 64))
    assert again.imitator.config.state_features == (GLASS,)
    assert [report.dataset for report in again.imitator.reports] == 3 * ["surroundings"] + ["more"]


def test_names_given_with_their_indices_are_read():
    features = meta_of(waves(0)).features
    features[ACTION]["names"] = {"delta_y": 1, "delta_x": 0}  # as of gamepads and keyboards
    meta = SimpleNamespace(**{**vars(meta_of(waves(0))), "features": features})
    described = DatasetDescription.of(meta, (STATE, GLASS))
    assert described.names[ACTION] == ("delta_x", "delta_y")


def test_a_robot_with_wheels_stops_at_novel_percepts():
    names = {**NAMES, ACTION: ("arm.pos", "wheel.vel")}
    policy = trained(waves(0, names=names))
    shown = waves(0).episodes[0]
    assert float(policy.select_action(percept(FAR))[0, 1]) == 0  # before its first action, too
    policy.reset()
    for row in shown.percepts[:60]:
        last = policy.select_action({STATE: row[None, :2], GLASS: row[None, 2:]})[0]
    assert float(last[1]) != 0
    policy.select_action(percept(FAR))
    while not policy.last_steps[0].is_novel:
        policy.select_action(percept(FAR))
    assert policy.select_action(percept(FAR))[0].tolist() == [float(last[0]), 0]


def test_a_robot_with_wheels_continues_where_nothing_is_recalled(monkeypatch: pytest.MonkeyPatch):
    policy = trained(waves(0, names={**NAMES, ACTION: ("arm.pos", "wheel.vel")}))
    shown = waves(0).episodes[0]
    for row in shown.percepts[:60]:
        last = policy.select_action({STATE: row[None, :2], GLASS: row[None, 2:]})
    step = Imitator.step
    monkeypatch.setattr(Imitator, "step", lambda *rest: step(*rest)._replace(action=None))
    row = shown.percepts[60]
    assert torch.equal(policy.select_action({STATE: row[None, :2], GLASS: row[None, 2:]}), last)
    assert not policy.last_steps[0].is_novel


def test_it_asks_at_novel_percepts(policy: PACNetPolicy):
    policy = copy.deepcopy(policy)
    policy.reset()
    asked = []

    def ask(step: ImitatorStep, seen: np.ndarray) -> np.ndarray | None:
        asked.append((step.is_novel, seen.tolist()))
        seen[:] = np.nan  # it is the callback's own
        return np.float32([7, 8]) if len(asked) == 1 else None

    policy.ask = ask
    assert policy.select_action(percept(FAR)).tolist() == [[7, 8]]
    assert policy.select_action(percept(FAR)).tolist() == [[7, 8]]  # no answer: hold
    assert asked == [(True, [30.0, 30.0, 0.5])] * 2
    for answer in (np.float32([np.nan, 1]), "left", [[1, 2]], [1, [2]], object()):
        policy.ask = lambda *_, answer=answer: answer
        with pytest.raises(ValueError, match="expected 2 finite numbers as the answer to ask, got"):
            policy.select_action(percept(FAR))


def test_acting_leaves_nothing_of_the_imitator_in_the_module(dataset: Demonstrations):
    """LeRobot saves, moves and casts what is there, and sets it to evaluate."""
    policy = trained(dataset)
    policy.select_action(percept(FAR))
    assert list(policy.state_dict()) == ["anchor"]
    assert list(policy.modules()) == [policy]
    assert policy.eval().imitator.training


def test_a_correction_takes_effect_in_the_next_episode(dataset: Demonstrations):
    policy, shown = trained(dataset), dataset.episodes[0]
    there = replace(shown, state=shown.state + 30, action=shown.action + 30)
    seen = percept(there.state[0], float(there.environment_state[0]))
    policy.reset()
    policy.select_action(seen)
    assert policy.last_steps[0].is_novel
    correction = Demonstrations(FPS, NAMES, (there,), "corrections")
    assert len(policy.imitator.learn(correction, corrections=True)) == 1
    policy.reset()
    for row in there.percepts[:60]:
        action = policy.select_action(percept(row[:2], float(row[2])))[0]
        assert not policy.last_steps[0].is_novel
    assert float((action - there.action[59]).abs().max()) < 0.2


def test_a_correction_during_an_episode_waits_for_the_next_one(dataset: Demonstrations):
    policy, shown = trained(dataset), dataset.episodes[0]
    for row in shown.percepts[:60]:
        policy.select_action(percept(row[:2], float(row[2])))
    for _ in range(60):
        held = policy.select_action(percept(FAR))
    assert policy.last_steps[0].is_novel
    there = replace(shown, state=shown.state + 30, action=shown.action + 30)
    policy.imitator.learn(Demonstrations(FPS, NAMES, (there,), "corrections"), corrections=True)
    assert torch.equal(policy.select_action(percept(FAR)), held)


def test_an_episode_may_begin_in_inference_mode(dataset: Demonstrations):
    policy = trained(dataset)
    with torch.inference_mode():
        policy.reset()
        policy.select_action(percept(FAR))
    policy.reset()
    policy.select_action(percept(FAR))


def test_it_is_ready_when_an_episode_begins(dataset: Demonstrations):
    """What the first step computes must not delay a control loop."""
    policy = trained(dataset)
    policy.reset()
    (actor,) = policy._actors
    ready = actor.imitator._known
    assert ready is not None
    policy.select_action(percept(FAR))
    assert actor.imitator._known is ready


def test_mixed_precision_learns_the_same(dataset: Demonstrations):
    half = list(batches(dataset, 0, 64))[:3]
    policies = [policy_for(dataset) for _ in range(2)]
    with torch.autocast("cpu", dtype=torch.bfloat16):
        learn(policies[0], iter(half))
        policies[0].eval()  # which learns the frames collected so far
    learn(policies[1], iter(half))
    assert_same(policies[0].imitator, policies[1].eval().imitator)


def test_states_as_targets_are_learned_the_same_in_mixed_precision():
    dataset = waves(1, count=2)
    expected = Imitator.from_demonstrations(dataset, targets="state", lead=2)
    expected.learn(dataset)
    policy = PACNetPolicy(config_of(targets="state", lead=2), dataset_meta=meta_of(dataset))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        learn(policy, batches(dataset, 0, 64))
    assert_same(policy.imitator, expected)


def test_the_steps_of_a_pass_are_logged(dataset: Demonstrations, caplog: pytest.LogCaptureFixture):
    caplog.set_level("INFO")
    learn(policy_for(dataset), batches(dataset, 0, 64))  # 390 frames: six batches and six frames
    assert "one pass is --steps=7" in caplog.text


def test_an_empty_batch_is_refused(policy: PACNetPolicy):
    with pytest.raises(ValueError, match="at least one row"):
        policy.select_action({STATE: torch.empty(0, 2), GLASS: torch.empty(0, 1)})


def test_processors_change_nothing_but_names_and_shapes(dataset: Demonstrations, tmp_path: Path):
    config, stats = config_of(), meta_of(dataset).stats
    for pipeline in make_pre_post_processors(config, dataset_stats=stats):
        pipeline.save_pretrained(tmp_path)
    # What lerobot-train overrides when it continues with another dataset.
    features = {**config.input_features, **config.output_features}
    norm = {"features": features, "norm_map": config.normalization_mapping, "stats": stats}
    before, after = make_pre_post_processors(
        config,
        pretrained_path=str(tmp_path),
        preprocessor_overrides={
            "device_processor": {"device": "cpu"},
            "normalizer_processor": norm,
            "rename_observations_processor": {"rename_map": {}},
        },
        postprocessor_overrides={"unnormalizer_processor": norm},
    )
    frames = frames_of(dataset)
    processed = before(frames)
    for name, column in frames.items():
        if name != "task":
            assert torch.equal(processed[name], column), name
    assert torch.equal(after(frames[ACTION]), frames[ACTION])
    assert set(config.normalization_mapping.values()) == {NormalizationMode.IDENTITY}


@pytest.mark.parametrize(
    "task", ["Drink-v0", "Toast-v0", "Move-v0", "DrinkAlone-v0", "FollowWalls-v0"]
)
def test_environments_are_what_their_config_says(task: str):
    pytest.importorskip("dm_control")
    config = PACNetEnv(task=task)
    environment = gymnasium.make(config.gym_id, **config.gym_kwargs)
    observation, _ = environment.reset(seed=3, options={"lerobot_new_rollout": True})
    shapes = {name: feature.shape for name, feature in config.features.items()}
    assert environment.action_space.shape == shapes.pop(ACTION)
    assert {name: value.shape for name, value in observation.items()} == shapes
    assert environment.metadata["render_fps"] == config.fps
    action = environment.action_space.low
    seen, *_, info = environment.step(action)
    assert environment.observation_space.contains(seen)
    assert info["is_success"] is False
    assert environment.get_wrapper_attr("_max_episode_steps") > 1
    again, _ = environment.reset(seed=3)
    assert all(np.array_equal(again[name], value) for name, value in observation.items())
    environment.close()


@pytest.mark.parametrize("task", ["Drink-v0", "Toast-v0", "Move-v0"])
def test_success_is_reported_at_the_end(task: str):
    pytest.importorskip("dm_control")
    environment = gymnasium.make(f"gym_pacnet/{task}")
    environment.reset(seed=0)
    successes, truncated = [], False
    while not truncated:  # the demonstrator's own aims, one step late
        *_, truncated, info = environment.step(environment.unwrapped.scene.demonstrator_target)
        successes.append(info["is_success"])
    assert successes[-1] is True
    assert not any(successes[:-1])
    environment.close()


def test_tasks_are_in_the_words_of_the_demonstrations():
    pytest.importorskip("dm_control")
    from train.postural.behaviours.episodes import TASKS
    from train.walls.learning import task_of

    assert scenes.TASKS == TASKS
    environment = gymnasium.make("gym_pacnet/FollowWalls-v0")
    seen = []
    for seed in range(6):
        readings = environment.reset(seed=seed)[0]["agent_pos"]
        side = "left" if readings[0] > readings[-1] else "right"
        seen.append(environment.task_description)  # of the outermost wrapper, as LeRobot asks
        assert seen[-1] == task_of(side)
    assert len(set(seen)) == 2
    environment.close()


def test_lerobot_passes_the_task_on():
    pytest.importorskip("dm_control")
    config = PACNetEnv(task="Toast-v0")
    vector = next(iter(make_env(config, n_envs=2)["pacnet"].values()))
    vector.reset(seed=[0, 1])
    # This is what both lines of LeRobot give the policy as the task of each row.
    assert list(vector.call("task_description")) == ["toast, then drink a glass of beer"] * 2
    vector.close()


def test_following_a_wall_is_a_success_and_standing_still_is_not():
    pytest.importorskip("dm_control")
    from envs.wall_behaviours import WallFollower
    from train.walls.drivers import shares

    environment = gymnasium.make("gym_pacnet/FollowWalls-v0")
    successes = []
    for moving in (1, 0):
        observation, _ = environment.reset(seed=0)
        readings = observation["agent_pos"]
        follower, truncated = WallFollower("left" if readings[0] > readings[-1] else "right"), False
        while not truncated:
            action = moving * shares(follower.act(observation["agent_pos"]))
            observation, *_, truncated, info = environment.step(action)
        successes.append(info["is_success"])
    assert successes == [True, False]
    environment.close()


def test_without_a_checkout_there_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(scenes, "_CHECKOUT", tmp_path)
    with pytest.raises(ModuleNotFoundError, match=r"expected pacnet's scenes.*in a checkout"):
        scenes._module("missing_scenes.postural_imitation")


def test_a_picture_is_drawn_now_and_then():
    pytest.importorskip("dm_control")
    environment = gymnasium.make(
        "gym_pacnet/FollowWalls-v0", render_mode="rgb_array", picture_every=3
    )
    environment.reset(seed=0)
    pictures = []
    for _ in range(4):
        environment.step(np.float32([1, 1]))
        pictures.append(environment.render())
    assert pictures[0] is pictures[2]
    assert not np.array_equal(pictures[0], pictures[3])
    environment.close()

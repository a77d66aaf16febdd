"""Experiment 2: what is learned, what each variant lacks, files of a run."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import av
import numpy as np
import pytest
import torch
from checkers import assert_clean
from PIL import Image
from training_runs import interrupt, only_run

from envs.arena import make_arena
from envs.arena_physics import ArenaPhysics
from envs.khepera import INFRARED_NAMES, MAX_WHEEL_SPEED, wheel_speeds
from envs.wall_behaviours import CRUISE, MAX_TURN
from pacnet import NO_NODE, Decision, MLPForwardModel, PACNet, TransitionMatrix
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder
from train import forward_model, wall_following
from train.common.learning_log import LearningLog
from train.common.runs import UNSEEN_ARENAS
from train.common.summary import summarise
from train.walls import conditions as wall_conditions
from train.walls import episodes as wall_episodes
from train.walls import learning as wall_learning
from train.walls import report as wall_report
from train.walls import variants as wall_variants
from train.walls.boredom import BLIND, PATIENCE, TURNING, Bored, Boredom
from train.walls.conditions import run_conditions
from train.walls.drivers import Driven, Recalling, Teacher, Wandering
from train.walls.episodes import (
    TAUGHT_SIDES,
    Place,
    Transitions,
    act_alone,
    alone_seed,
    follow,
    following_seeds,
    seeds_for,
    wander,
)
from train.walls.forward_model import TURNS, candidate_actions, fit, make_forward_model
from train.walls.learning import (
    LEAD,
    follow_both_sides,
    frames,
    load_episodes,
    load_wandering,
    make_network,
    record_following,
    record_wandering,
    teach,
)
from train.walls.nearest import NearestTargets
from train.walls.scores import name_clusters
from train.walls.variants import Learned, Repeat

PROJECT = Path(__file__).parents[2]
SEED = 3
CONDITIONS = {
    "recall", "recall in unseen arenas", "wandering", "teacher's controller",
    "one constant target", "shuffled targets", "node's mean action", "untrained forward model",
    "50-NN over all frames, no map", "transition matrix", "speed free", "noise doubled",
    "taught on one side", "recall beside a left wall", "recall beside a right wall",
}  # fmt: skip


@pytest.fixture(scope="module")
def tiny() -> Iterator[None]:
    """Little of everything."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wall_variants, "TRANSITIONS", 400)
        patch.setattr(wall_following, "TRANSITIONS", 400)
        patch.setattr(wall_learning, "WANDERING_STEPS", 150)
        patch.setattr(wall_learning, "EPISODES_A_SIDE", 2)
        patch.setattr(wall_learning, "EPISODE_STEPS", 150)
        yield


@pytest.fixture(scope="module")
def learned(tiny: None) -> Learned:  # noqa: ARG001
    return wall_variants.learn(SEED, "paper")


def bytes_of(module: torch.nn.Module) -> dict[str, bytes]:
    return {name: tensor.numpy().tobytes() for name, tensor in module.state_dict().items()}


def fitted_model(learned: Learned) -> MLPForwardModel:
    model = learned.network.forward_model
    assert isinstance(model, MLPForwardModel)
    return model


def targets_of(network: PACNet) -> list[torch.Tensor]:
    """Each node's targets."""
    return [network.schemas.targets(node) for node in range(len(network.schemas))]


def same_episodes(one: list, other: list) -> bool:
    return len(one) == len(other) and all(
        a.side == b.side and a.percepts.equal(b.percepts) and a.actions.equal(b.actions)
        for a, b in zip(one, other, strict=True)
    )


class Straight:
    """Drives straight on and remembers what it saw."""

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def drive(self, percept: np.ndarray) -> Driven:  # noqa: D102
        self.seen.append(percept)
        return Driven(np.array([0.5, 0.5], np.float32), winner=len(self.seen), commanded=True)


# Episodes


def test_wandering_following_testing_and_acting_alone_never_share_a_seed():
    for seed in range(20):
        wandering = seeds_for(seed, wall_episodes._WANDERING, 2)
        drawn = [
            *wandering,
            *following_seeds(seed, 8),
            alone_seed(seed),
            wall_episodes.testing_seed(seed),
        ]
        assert len(set(drawn)) == len(drawn)
    assert len({alone_seed(seed) for seed in range(20)}) == 20


def test_a_run_alone_records_percepts_before_and_poses_after_each_step():
    driver, counted = Straight(), []
    run = act_alone(driver, Place("paper"), 5, 12, counted.append)
    np.testing.assert_array_equal(run.percepts, driver.seen)
    assert run.winners.tolist() == list(range(1, 13))
    assert run.commanded.all()
    assert len(counted) == len(run) == 12
    # 0.5 of 0.12 m/s over 0.1 s; the first step is from rest
    steps = np.linalg.norm(np.diff(run.poses[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.006, rtol=0.01)
    wall = make_arena("paper").clearance(run.poses[:, :2])
    np.testing.assert_allclose(run.wall_distance, wall - 0.0275, atol=1e-9)


def test_a_place_beside_a_wall_and_one_in_the_open():
    beside = [act_alone(Straight(), Place("paper", wall=side), 0, 1) for side in TAUGHT_SIDES]
    assert [int(run.wall_side[0]) for run in beside] == [1, -1]
    assert act_alone(Straight(), Place("paper"), 0, 1).wall_side[0] == 0


def test_noise_is_a_factor():
    one, two = (act_alone(Straight(), Place("paper", noise=n), 5, 5).percepts for n in (1.0, 2.0))
    seen = (one > 0) & (one < 0.1)
    np.testing.assert_allclose(two[seen], 2 * one[seen], rtol=1e-5)
    assert seen.any()


@pytest.mark.parametrize(
    "make",
    [lambda seed: wander("paper", 60, seed), lambda seed: follow(1, "right", seed, 60)],
    ids=["wandering", "following"],
)
def test_same_seed_same_transitions(make: Callable[[int], Transitions]):
    one, same, other = make(4), make(4), make(5)
    assert one.percepts.shape == (60, 6)
    assert one.actions.shape == (60, 2)
    assert one.percepts.dtype == one.actions.dtype == np.float32
    for kept, again, changed in zip(one, same, other, strict=True):
        assert kept.tobytes() == again.tobytes()
        assert kept.tobytes() != changed.tobytes()


@pytest.mark.parametrize(("side", "beside"), [("left", 0), ("right", 5)])
def test_a_follower_sees_the_wall_on_the_teachers_side(side: str, beside: int):
    percepts = follow("paper", side, 2, 300).percepts
    assert percepts[:20].max() < 0.2  # it begins in the open
    assert percepts[150:, beside].mean() > 0.3
    assert percepts[150:, 5 - beside].mean() < 0.1


def test_following_is_noisy_so_that_it_shows_how_to_come_back():
    noise = wall_episodes.MotorNoise(np.random.default_rng(0))
    turns = np.array([np.diff(noise.wheels())[0] / 0.053 for _ in range(4000)])
    assert 0.55 < np.abs(turns).max() <= 0.6
    assert abs(turns.mean()) < 0.05
    held = np.diff(turns) == 0  # drawn anew in a quarter of the steps
    assert held.mean() == pytest.approx(0.75, abs=0.03)


def test_while_the_teacher_rests_the_learner_stands_and_later_goes_on():
    percepts, actions = follow("paper", "left", 2, 730, rests=True)
    assert actions[:100].any(axis=1).all()
    assert not actions[106:706].any()
    assert actions[706:].any(axis=1).all()
    # It stood at the same place: the readings differ by their noise alone.
    assert percepts[110:706].std(axis=0).max() < 0.03


def test_episodes_with_rests_are_driven_for_as_long(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(wall_learning, "EPISODE_STEPS", 120)
    monkeypatch.setattr(wall_learning, "EPISODES_A_SIDE", 1)
    for episode in follow_both_sides(1, 4, rests=True):
        moves = episode.actions.numpy().any(axis=1)
        assert len(moves) == 720
        assert moves.sum() == 120


def test_the_teacher_drives_by_its_own_controller_in_the_learners_body():
    run = act_alone(Teacher("left"), Place("paper", wall="left"), 0, 100)
    assert (run.wall_side == 1).mean() > 0.9
    assert not run.commanded.any()
    assert (run.winners == NO_NODE).all()


# Recalling


class Once:
    """A network that gives an action at its first percept, and abstains from then on."""

    def __init__(self, action: tuple[float, float]) -> None:
        self.action, self.calls, self.resets = action, 0, 0

    def reset(self) -> None:  # noqa: D102
        self.resets += 1

    def step(self, _: np.ndarray) -> Decision:  # noqa: D102
        self.calls += 1
        action = np.array(self.action, np.float32) if self.calls == 1 else None
        target = np.zeros(6, np.float32)
        return Decision(target, True, 7, 1.0, False, 0, 7, action, action is not None)


# Boredom


OPEN, LEFT_WALL = np.zeros(6, np.float32), np.array([0.6, 0.2, 0, 0, 0, 0], np.float32)


def test_with_walls_on_one_side_for_long_a_robot_turns_away_and_drives_on():
    boredom = Boredom()
    assert all(boredom.drive(LEFT_WALL) is None for _ in range(PATIENCE - 1))
    left = [boredom.drive(LEFT_WALL) for _ in range(TURNING)]
    # 120 degrees at 1.8 rad/s and 0.1 s a step are 11.6 steps, to the right of a left wall.
    assert TURNING == 12
    np.testing.assert_allclose(left, [wheel_speeds(0.0, -MAX_TURN)] * 12)
    for _ in range(50):
        np.testing.assert_allclose(boredom.drive(OPEN), wheel_speeds(CRUISE, 0.0))
    assert all(boredom.drive(LEFT_WALL) is None for _ in range(PATIENCE - 1))  # a new wall
    right_away = boredom.drive(LEFT_WALL)
    np.testing.assert_allclose(right_away, wheel_speeds(0.0, -MAX_TURN))


def test_a_wall_on_the_other_side_is_something_new():
    boredom, right_wall = Boredom(), LEFT_WALL[::-1]
    for wall in (LEFT_WALL, right_wall) * 2:
        assert all(boredom.drive(wall) is None for _ in range(PATIENCE - 1))
    np.testing.assert_allclose(boredom.drive(right_wall), wheel_speeds(0.0, MAX_TURN))


def test_without_a_wall_for_long_a_robot_drives_straight_until_it_sees_one():
    boredom = Boredom()
    assert all(boredom.drive(OPEN) is None for _ in range(BLIND - 1))
    for _ in range(50):
        np.testing.assert_allclose(boredom.drive(OPEN), wheel_speeds(CRUISE, 0.0))
    assert boredom.drive(LEFT_WALL) is None
    assert boredom.drive(OPEN) is None


def test_whoever_is_bored_is_driven_by_the_default_behaviour():
    driver = Straight()
    bored = Bored(driver)
    driven = [bored.drive(OPEN) for _ in range(BLIND + 5)]
    assert len(driver.seen) == BLIND - 1
    assert [one.commanded for one in driven] == [True] * (BLIND - 1) + [False] * 6
    assert {one.winner for one in driven[BLIND - 1 :]} == {NO_NODE}


@pytest.mark.parametrize("side", TAUGHT_SIDES)
def test_nobody_keeps_one_wall_for_ever(monkeypatch: pytest.MonkeyPatch, side: str):
    monkeypatch.setattr("train.walls.boredom.PATIENCE", 100)
    run = act_alone(Teacher(side), Place("paper", wall=side), 0, 160)
    near = run.wall_distance < 0.05
    assert near[:95].all()
    assert not near[120:].all()


# Recalling without knowledge


def test_a_network_that_knows_nothing_wanders():
    network = make_network(make_forward_model(0)).eval()
    runs = [act_alone(driver, Place(1), 2, 150) for driver in (Recalling(network, 9), Wandering(9))]
    assert runs[0].poses.tobytes() == runs[1].poses.tobytes()
    assert runs[0].percepts.tobytes() == runs[1].percepts.tobytes()
    assert (runs[0].winners == NO_NODE).all()
    assert not runs[0].commanded.any()
    other = act_alone(Wandering(10), Place(1), 2, 150)
    assert other.poses.tobytes() != runs[1].poses.tobytes()


def test_a_trained_network_wanders_at_novel_percepts(learned: Learned):
    novel = np.ones(6, np.float32)  # touching on all sides
    assert learned.network.recall(torch.from_numpy(novel)[None]).is_novel.item()
    recalling, wandering = Recalling(learned.network, 4), Wandering(4)
    for _ in range(50):
        driven, alone = recalling.drive(novel), wandering.drive(novel)
        assert driven.action.tolist() == alone.action.tolist()
        assert driven[1:] == (NO_NODE, False)


def test_the_robot_wanders_on_with_the_last_action_of_the_network():
    network = Once((0.4, 0.6))
    recalling = Recalling(network, seed=1)  # with which no run ends in the next two steps
    first, *later = (recalling.drive(np.zeros(6, np.float32)) for _ in range(3))
    assert network.resets == 1
    np.testing.assert_allclose(first.action, (0.4, 0.6))
    assert first[1:] == (7, True)
    for driven in later:  # 0.5 of 0.12 m/s is its cruising speed
        np.testing.assert_allclose(driven.action, (0.4, 0.6), atol=1e-6)
        assert driven[1:] == (7, False)


# Learning


def test_same_seed_same_learned(learned: Learned):
    again = wall_variants.learn(SEED, "paper")
    assert bytes_of(again.network) == bytes_of(learned.network)
    assert any(name.startswith("forward_model.") for name in bytes_of(again.network))
    assert again.wandering.percepts.tobytes() == learned.wandering.percepts.tobytes()
    assert same_episodes(again.episodes, learned.episodes)


def test_another_seed_learns_something_else(learned: Learned):
    other = wall_variants.learn(SEED + 1, "paper")
    assert bytes_of(other.network) != bytes_of(learned.network)
    assert bytes_of(fitted_model(other)) != bytes_of(fitted_model(learned))
    assert not same_episodes(other.episodes, learned.episodes)


def test_it_learned_something(learned: Learned):
    """Else the tests of the variants would compare nothing with nothing."""
    assert (learned.network.schemas.lengths > 0).sum() >= 3
    assert {"left", "right"} <= set(name_clusters(learned.network.sofm.prototypes.numpy()))
    assert not learned.network.training


def test_both_sides_are_taught_in_their_order(learned: Learned):
    assert [episode.side for episode in learned.episodes] == [0, 0, 1, 1]
    for episode in learned.episodes:
        ahead = episode.percepts[100:].mean(dim=0)
        left, right = ahead[:3].sum(), ahead[3:].sum()
        assert (left > right) == (TAUGHT_SIDES[episode.side] == "left")


def test_learning_one_side_keeps_what_was_learned_on_the_other(learned: Learned):
    """A new learning episode would clear what a node holds when it wins again."""
    left_alone = make_network(fitted_model(learned))
    teach(left_alone, [episode for episode in learned.episodes if episode.side == 0])
    held, won_again = targets_of(left_alone), 0
    for node, targets in enumerate(held):
        later = learned.network.schemas.targets(node)
        assert later[: len(targets)].equal(targets)
        won_again += 0 < len(targets) < len(later)
    assert won_again > 0


def test_datasets_read_back_as_recorded(tmp_path: Path, learned: Learned):
    record_wandering(tmp_path / "wandering", "paper", SEED, 400)
    wandering = load_wandering(tmp_path / "wandering")
    for written, kept in zip(wandering, learned.wandering, strict=True):
        assert written.dtype == np.float32
        np.testing.assert_array_equal(written, kept)
    record_following(tmp_path / "following", "paper", SEED)
    assert same_episodes(load_episodes(tmp_path / "following"), learned.episodes)
    assert same_episodes(follow_both_sides("paper", SEED), learned.episodes)
    demonstrations = load_demonstrations(tmp_path / "following", environment_state=None)
    sides = ["left", "left", "right", "right"]
    assert [one.task for one in demonstrations] == [f"follow the {side} wall" for side in sides]


def test_wandering_is_cut_into_episodes_of_similar_length_with_a_task(
    tmp_path: Path, learned: Learned
):
    record_wandering(tmp_path / "wandering", "paper", SEED, 400)
    episodes = list(load_demonstrations(tmp_path / "wandering", environment_state=None))
    assert [len(one.percepts) for one in episodes] == [134, 133, 133]
    np.testing.assert_array_equal(episodes[1].percepts, learned.wandering.percepts[134:267])
    np.testing.assert_array_equal(episodes[2].action, learned.wandering.actions[267:])
    assert {one.task for one in episodes} == {"wander around and turn away from walls"}


def test_jumping_readings_are_not_due_to_noise(
    monkeypatch: pytest.MonkeyPatch,
):
    """The reason that is given in the dataset for readings that jump and come back."""
    truths = []
    infrared = ArenaPhysics.infrared

    def noted(physics: ArenaPhysics, robot: int) -> np.ndarray:
        truths.append((robot, infrared(physics, robot)))
        return truths[-1][1]

    monkeypatch.setattr(ArenaPhysics, "infrared", noted)
    for seed in range(2):
        for make in (
            lambda seed=seed: wander("paper", 1000, seed),
            lambda seed=seed: follow("paper", "left", seed, 750),
        ):
            truths.clear()
            percepts = make().percepts
            truth = np.array([readings for robot, readings in truths if robot == 0])[
                : len(percepts)
            ]
            jumps = out_and_back(percepts) > 0.2
            assert jumps.any()
            assert np.abs(percepts - truth)[jumps].max() < 0.05  # five deviations of the noise
            assert out_and_back(truth)[jumps].min() > 0.1


def out_and_back(readings: np.ndarray) -> np.ndarray:
    """How far each reading is from the median of the 7 around it."""
    padded = np.pad(readings, ((3, 3), (0, 0)), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 7, axis=0)
    return np.abs(readings - np.median(around, axis=-1))


def test_expected_findings_stay_when_more_is_recorded(tmp_path: Path, learned: Learned):
    record_following(tmp_path, "paper", SEED)
    written = (tmp_path / "meta/rdq_expected.yaml").read_bytes()
    frames = {
        "observation.state": learned.wandering.percepts,
        "action": learned.wandering.actions,
    }
    with Recorder(tmp_path, wall_learning.FPS, wall_learning.FEATURES, "khepera") as recorder:
        recorder.save_episode("follow the left wall", frames)
    assert (tmp_path / "meta/rdq_expected.yaml").read_bytes() == written
    assert len(load_episodes(tmp_path)) == 5


def test_what_is_learned_from_the_records_is_what_a_replicate_learns(
    tmp_path: Path, learned: Learned
):
    with LearningLog(tmp_path / "tensorboard") as log:
        recorded = wall_following.learn(SEED, "paper", tmp_path, log)
    assert bytes_of(recorded.network) == bytes_of(learned.network)
    assert not recorded.network.training
    assert bytes_of(MLPForwardModel.from_pretrained(tmp_path / "forward_model")) == bytes_of(
        fitted_model(learned)
    )


def test_learning_in_chunks_equals_learning_at_once(learned: Learned, monkeypatch):
    monkeypatch.setattr(wall_learning, "CHUNK", 10_000)
    network = make_network(fitted_model(learned))
    teach(network, learned.episodes)
    assert bytes_of(network) == bytes_of(learned.network)


def test_targets_are_percepts_some_steps_ahead(learned: Learned):
    ahead = {}
    for episode in learned.episodes:
        later = torch.cat([episode.percepts[LEAD:], episode.percepts[-1:].expand(LEAD, -1)])
        for seen, aim in zip(episode.percepts.tolist(), later.tolist(), strict=True):
            ahead.setdefault(tuple(seen), []).append(aim)
    schemas, checked = learned.network.schemas, 0
    for node in range(len(schemas)):
        for cue, target in zip(schemas.cues(node), schemas.targets(node), strict=True):
            assert target.tolist() in ahead[tuple(cue.tolist())]
            checked += 1
    assert checked > 100


def test_candidates_are_every_turn_at_every_speed():
    actions = np.array(candidate_actions((0.0, 0.03)))
    assert actions.shape == (2 * len(TURNS), 2)
    wheels = MAX_WHEEL_SPEED * actions
    np.testing.assert_allclose(wheels.mean(axis=1), np.repeat([0.0, 0.03], len(TURNS)), atol=1e-8)
    turns = (wheels[:, 1] - wheels[:, 0]) / 0.053
    np.testing.assert_allclose(turns, np.tile(np.linspace(-1.8, 1.8, 21), 2), atol=1e-6)
    default = MAX_WHEEL_SPEED * np.array(candidate_actions())
    np.testing.assert_allclose(default.mean(axis=1), CRUISE, atol=1e-8)
    np.testing.assert_allclose(default[0], wheel_speeds(CRUISE, -MAX_TURN), atol=1e-8)


# Variants


def test_a_constant_target_is_the_mean_of_all(learned: Learned):
    constant = targets_of(wall_variants.constant_target(learned))
    own = torch.cat(targets_of(learned.network)).double()
    assert len(own.unique(dim=0)) > 50
    assert [len(t) for t in constant] == learned.network.schemas.lengths.tolist()
    assert len(torch.cat(constant).unique(dim=0)) == 1
    torch.testing.assert_close(
        torch.cat(constant)[0].double(), own.mean(dim=0), rtol=1e-4, atol=1e-5
    )


def test_shuffled_targets_come_from_one_other_node(learned: Learned):
    own = [{tuple(row) for row in t.tolist()} for t in targets_of(learned.network)]
    sources = []
    for node, targets in enumerate(targets_of(wall_variants.shuffled_targets(learned))):
        rows = {tuple(row) for row in targets.tolist()}
        assert len(targets) == learned.network.schemas.lengths[node]
        if rows:
            # Two nodes may share a row by chance, such as that of six readings of 0.
            (source,) = [other for other, theirs in enumerate(own) if rows <= theirs]
            assert source != node
            sources.append(source)
    assert len(sources) >= 3
    assert len(set(sources)) == len(sources)  # each is used once


def test_shuffling_is_decided_by_the_seed(learned: Learned):
    one, same = (wall_variants.shuffled_targets(learned) for _ in range(2))
    other = wall_variants.shuffled_targets(dataclasses.replace(learned, seed=SEED + 1))
    assert bytes_of(one) == bytes_of(same)
    assert bytes_of(one) != bytes_of(other)


def test_changed_targets_keep_their_cues_and_the_map(learned: Learned):
    makers = (wall_variants.constant_target, wall_variants.shuffled_targets)
    for network in [make(learned) for make in makers]:
        assert bytes_of(network.sofm) == bytes_of(learned.network.sofm)
        for node in range(len(network.schemas)):
            assert network.schemas.cues(node).equal(learned.network.schemas.cues(node))
        percepts = learned.episodes[0].percepts
        before, after = learned.network.recall(percepts), network.recall(percepts)
        assert after.winner.equal(before.winner)
        assert after.has_target.equal(before.has_target)
        assert not after.target[after.has_target].equal(before.target[after.has_target])


def test_a_nodes_mean_action_is_that_of_the_percepts_it_learned(learned: Learned):
    network = wall_variants.mean_action(learned)
    assert bytes_of(network.sofm) == bytes_of(learned.network.sofm)  # it saw the same
    done: dict[tuple, list[list[float]]] = {}
    for episode in learned.episodes:
        for seen, action in zip(episode.percepts.tolist(), episode.actions.tolist(), strict=True):
            done.setdefault(tuple(seen), []).append(action)
    checked = 0
    for node, actions in enumerate(targets_of(network)):
        if not len(actions):
            continue
        assert len(actions.unique(dim=0)) == 1
        assert actions.abs().max() <= 1
        cues = [tuple(cue) for cue in network.schemas.cues(node).tolist()]
        if all(len(done[cue]) == 1 for cue in cues):
            mean = np.mean([done[cue][0] for cue in cues], axis=0)
            np.testing.assert_allclose(actions[0], mean, atol=1e-5)
            checked += 1
    assert checked >= 2


def test_a_nodes_mean_action_is_used_unchanged(learned: Learned):
    network = wall_variants.mean_action(learned)
    assert isinstance(network.forward_model, Repeat)
    percepts = learned.episodes[0].percepts
    acted = network.act(percepts)
    assert acted.has_action.equal(acted.has_target)
    assert acted.has_action.any()
    torch.testing.assert_close(acted.action, acted.target, rtol=0, atol=0, equal_nan=True)
    means = [actions[0] if len(actions) else None for actions in targets_of(network)]
    for action, winner in zip(
        acted.action[acted.has_action], acted.winner[acted.has_action].tolist(), strict=True
    ):
        torch.testing.assert_close(action, means[winner])


def test_every_transition_is_learned_with_its_mirror_image(learned: Learned, monkeypatch):
    fits = []
    monkeypatch.setattr(MLPForwardModel, "fit", lambda _, *rows, **__: fits.append(rows))
    fit(make_forward_model(SEED), [learned.wandering], SEED)
    ((before, actions, after),) = fits
    percepts, wheels = learned.wandering
    for rows, own in ((before, percepts[:-1]), (actions, wheels[:-1]), (after, percepts[1:])):
        np.testing.assert_array_equal(rows[: len(own)], own)
        np.testing.assert_array_equal(rows[len(own) :], own[:, ::-1])  # left for right


def test_the_untrained_model_has_the_weights_before_the_fit(learned: Learned):
    untrained = wall_variants.untrained(learned)
    assert bytes_of(untrained) == bytes_of(make_forward_model(SEED))
    assert bytes_of(untrained) != bytes_of(fitted_model(learned))
    assert bytes_of(untrained) != bytes_of(make_forward_model(SEED + 1))
    assert untrained.config == fitted_model(learned).config


def test_with_the_speed_free_the_same_model_has_more_to_choose_from(learned: Learned):
    model, fitted = wall_variants.speed_free(learned), fitted_model(learned)
    assert bytes_of(model) == bytes_of(fitted)
    assert set(fitted.config.candidates) < set(model.config.candidates)
    speeds = MAX_WHEEL_SPEED * np.array(model.config.candidates).mean(axis=1)
    assert np.unique(speeds.round(6)).tolist() == sorted(wall_variants.FREE_SPEEDS)
    assert len(wall_variants.FREE_SPEEDS) >= 3


@pytest.mark.parametrize("speeds", [(CRUISE,), wall_variants.FREE_SPEEDS], ids=["fixed", "free"])
def test_every_candidate_is_an_action_that_the_environment_takes(speeds: tuple[float, ...]):
    assert np.abs(candidate_actions(speeds)).max() <= 1


def test_the_transition_matrix_learns_from_the_same_transitions(learned: Learned, monkeypatch):
    fits = []
    fit = TransitionMatrix.fit

    def spy(self: TransitionMatrix, *rows: torch.Tensor, seed: int) -> object:
        fits.append((*rows, seed))
        return fit(self, *rows, seed=seed)

    monkeypatch.setattr(TransitionMatrix, "fit", spy)
    matrix = wall_variants.transition_matrix(learned)
    ((before, actions, after, seed),) = fits
    wandered, first = learned.wandering, learned.episodes[0]
    count, steps = len(wandered.percepts) - 1, len(first.percepts) - 1
    assert len(before) == count + sum(len(one.percepts) - 1 for one in learned.episodes)
    np.testing.assert_array_equal(before[:count], wandered.percepts[:-1])
    np.testing.assert_array_equal(after[:count], wandered.percepts[1:])
    np.testing.assert_array_equal(actions[:count], wandered.actions[:-1])
    assert before[count : count + steps].equal(first.percepts[:-1])
    assert after[count : count + steps].equal(first.percepts[1:])
    assert actions[count : count + steps].equal(first.actions[:-1])
    assert seed == SEED
    config = fitted_model(learned).config
    assert matrix.config.steps == config.steps
    assert matrix.config.abstain_below == config.abstain_below
    assert set(matrix.config.candidates) < set(config.candidates)


def test_the_transition_matrix_turns_as_far_to_either_side_and_can_drive_straight(learned: Learned):
    candidates = {
        tuple(action) for action in wall_variants.transition_matrix(learned).config.candidates
    }
    assert {(right, left) for left, right in candidates} == candidates
    assert any(left == right for left, right in candidates)


# Without a map


def test_the_target_is_the_mean_of_the_nearest_cues():
    cues = torch.tensor([[0.0], [0.1], [0.5], [0.9]]).expand(4, 6)
    targets = torch.tensor([[0.1], [0.3], [0.8], [0.2]]).expand(4, 6)
    nearest = NearestTargets(cues, targets, 2, make_forward_model(0), seed=0)
    torch.testing.assert_close(nearest.target(torch.full((6,), 0.06)), torch.full((6,), 0.2))
    torch.testing.assert_close(nearest.target(torch.full((6,), 0.8)), torch.full((6,), 0.5))


def test_without_a_map_the_same_forward_model_acts(learned: Learned):
    cues, targets = frames(learned.episodes)
    assert len(cues) == sum(len(one.percepts) for one in learned.episodes)
    assert targets[0].equal(cues[LEAD])
    model = fitted_model(learned)
    nearest = NearestTargets(cues, targets, 50, model, seed=0)
    for percept in cues[::100]:
        aim = nearest.target(percept)
        driven = nearest.drive(percept.numpy())
        np.testing.assert_array_equal(driven.action, model.select(percept, aim).action)
        assert driven.commanded


@pytest.mark.parametrize(("rows", "count"), [(0, 1), (3, 0), (3, 4)])
def test_too_few_rows_are_refused(rows: int, count: int):
    with pytest.raises(ValueError, match="expected as many cues as targets and a count"):
        NearestTargets(torch.zeros(rows, 6), torch.zeros(rows, 6), count, make_forward_model(0), 0)


# Conditions


@pytest.fixture(scope="module")
def conditions_run(learned: Learned) -> tuple[dict, list]:
    """Scores of every condition, and what each run was given with what came of it."""
    runs: list[tuple] = []
    act = wall_conditions.act_alone

    def spy(driver: object, place: Place, seed: int, steps: int) -> object:
        run = act(driver, place, seed, steps)
        runs.append((driver, place, seed, run))
        return run

    before = bytes_of(learned.network)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wall_conditions, "act_alone", spy)
        scores = run_conditions(learned, steps=40)
    assert bytes_of(learned.network) == before
    assert not learned.network.training
    return scores, runs


def test_every_condition_is_run_and_none_changes_what_was_learned(
    conditions_run: tuple[dict, list], learned: Learned
):
    scores, runs = conditions_run
    assert scores.keys() == CONDITIONS
    assert len(runs) == len(CONDITIONS) + 2 + 1 + 1  # unseen arenas, teacher, one side
    for one in scores.values():
        assert {"wf", "tight", "energy", "contact_share"} <= one.keys()
        assert np.isfinite(list(one.values())).all()
    assert bytes_of(learned.network) == bytes_of(wall_variants.learn(SEED, "paper").network)


def test_conditions_are_decided_by_what_was_learned(
    conditions_run: tuple[dict, list], learned: Learned
):
    assert run_conditions(learned, steps=40) == conditions_run[0]


def test_all_conditions_begin_at_the_same_place(conditions_run: tuple[dict, list]):
    _, runs = conditions_run
    assert {seed for _, _, seed, _ in runs} == {alone_seed(SEED)}
    starts = [run for _, place, _, run in runs if place.arena == "paper" and place.wall is None]
    assert len(starts) == len(runs) - wall_conditions.UNSEEN - 2 * len(TAUGHT_SIDES)
    places = np.array([run.poses[0, :2] for run in starts])
    assert np.ptp(places, axis=0).max() < 0.02  # within one step of 0.1 s


def test_recalls_in_the_same_place_see_the_same_at_first(conditions_run: tuple[dict, list]):
    _, runs = conditions_run
    normal = Place("paper")
    seen = {run.percepts[0].tobytes() for _, place, _, run in runs if place == normal}
    assert len(seen) == 1
    (noisy,) = [run for _, place, _, run in runs if place == Place("paper", noise=2.0)]
    assert noisy.percepts[0].tobytes() not in seen


def test_unseen_arenas_are_three_that_no_run_is_taught_in_and_each_replicate_its_own(
    conditions_run: tuple[dict, list],
):
    unseen = [place.arena for _, place, _, _ in conditions_run[1] if place.arena != "paper"]
    assert unseen == [UNSEEN_ARENAS + 3 * SEED + number for number in range(3)]
    assert len({make_arena(which) for which in unseen}) == 3


def test_the_teacher_begins_beside_a_wall_on_each_side(conditions_run: tuple[dict, list]):
    runs = [(place, run) for driver, place, _, run in conditions_run[1] if type(driver) is Teacher]
    assert [place.wall for place, _ in runs] == ["left", "right"]
    assert [int(run.wall_side[0]) for _, run in runs] == [1, -1]


def test_recall_beside_a_wall_begins_there_and_says_whether_it_keeps_the_side(
    conditions_run: tuple[dict, list],
):
    scores, runs = conditions_run
    beside = [(p.wall, run) for driver, p, _, run in runs if p.wall and type(driver) is Recalling]
    assert [wall for wall, _ in beside] == ["left", "right"]
    assert [int(run.wall_side[0]) for _, run in beside] == [1, -1]
    for wall, run in beside:
        along = (run.wall_side != 0) & (run.progress > 0.003)
        kept = (run.wall_side[along] == (1 if wall == "left" else -1)).mean() if along.any() else 0
        assert scores[f"recall beside a {wall} wall"]["side_kept"] == pytest.approx(kept)


def test_recall_is_what_recalling_with_the_learned_network_scores(
    conditions_run: tuple[dict, list], learned: Learned
):
    _, _, _, first = conditions_run[1][0]
    again = act_alone(Recalling(learned.network, SEED), Place("paper"), alone_seed(SEED), 40)
    assert first.poses.tobytes() == again.poses.tobytes()
    assert conditions_run[0]["recall"]["nodes"] == len(learned.network.sofm)


def test_scores_of_several_runs_are_their_mean():
    one, two = {"wf": 0.5, "tight": 0.0}, {"wf": 1.0, "tight": 0.5}
    assert wall_conditions._mean([one, two]) == {"wf": 0.75, "tight": 0.25}


@pytest.mark.slow
def test_replicates_in_the_pool_are_those_of_this_process():
    here = [wall_conditions.replicate(seed, 1, 30) for seed in (5, 6)]
    assert list(wall_conditions.replicates((5, 6), 1, 30)) == here
    assert here[0] != here[1]


# Report


def test_scores_count_the_nodes_of_each_cluster(learned: Learned):
    recalled = act_alone(Recalling(learned.network, SEED), Place("paper"), 0, 60)
    figures, scores = wall_report.draw(learned.network, learned.episodes, recalled, "paper")
    assert figures.keys() == {"percepts", "map", "activations", "path"}
    clusters = [scores.get(f"nodes_{name}", 0) for name in ("left", "no_wall", "right")]
    assert sum(clusters) == scores["nodes"] == len(learned.network.sofm)
    assert 0.5 < scores["pca_variance_2"] <= 1


def test_the_table_holds_mean_and_std_of_every_condition(capsys: pytest.CaptureFixture[str]):
    replicates = [
        {"wf": 0.5, "tight": 0.25, "energy": 0.0},
        {"wf": 1.0, "tight": 0.25, "energy": 1},
    ]
    summary = {
        "recall": summarise(replicates),
        "recall in unseen arenas": summarise(replicates[:1] * 2),
    }
    wall_report.print_conditions(summary)
    header, recall, unseen = capsys.readouterr().out.strip().splitlines()
    assert header.startswith("2 replicates")
    # of 0.5 and 1: mean 0.75, sample deviation 0.25 √2
    assert recall.split() == [
        "recall",
        "0.75",
        "±",
        "0.35",
        "0.25",
        "±",
        "0.00",
        "0.50",
        "±",
        "0.71",
    ]
    assert unseen.split()[4:7] == ["0.50", "±", "0.00"]
    wall_report.print_conditions({"recall": summarise(replicates[:1])})
    assert capsys.readouterr().out.split()[-4:] == ["recall", "0.50", "0.25", "0.00"]
    (axes, *_) = wall_report.draw_conditions(summary).axes
    assert {"recall", "recall in unseen arenas"} <= {
        label.get_text() for axis in (axes.xaxis, axes.yaxis) for label in axis.get_ticklabels()
    }


def test_what_is_typical_stands_beside_the_own_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    wall_report.print_typical(tmp_path / "metrics.json")  # outside of a clone
    assert capsys.readouterr().out == ""
    replicates = [{"wf": 0.5, "tight": 0.25, "energy": 0.5}, {"wf": 1, "tight": 0.25, "energy": 0}]
    document = {"seed": 4, "conditions": {"recall": summarise(replicates)}}
    (tmp_path / "metrics.json").write_text(json.dumps(document))
    wall_report.print_typical(tmp_path / "metrics.json")
    said = capsys.readouterr().out.split()
    assert said[:4] == ["typical", "recall", "(2", "longer"]
    assert said[5:] == ["0.75", "±", "0.35", "0.25", "±", "0.00", "0.25", "±", "0.35"]


# The forward model alone


@pytest.mark.parametrize(("share", "r2"), [(1.0, 1.0), (0.5, 0.75), (0.0, 0.0), (-1.0, -3.0)])
def test_a_model_that_predicts_a_share_of_the_change(learned: Learned, share: float, r2: float):
    """Of a share s, R² against persistence is 1 - (1 - s)²."""
    percepts = torch.from_numpy(learned.wandering.percepts)

    def model(*_: torch.Tensor) -> torch.Tensor:
        return share * (percepts[1:] - percepts[:-1])

    scores = forward_model.score(model, learned.wandering)  # pyright: ignore
    names = ["r2_mean", *(f"r2_{name}" for name in INFRARED_NAMES)]
    assert scores == pytest.approx(dict.fromkeys(names, r2), abs=1e-6)


def test_predictions_hold_predicted_and_true_changes(learned: Learned):
    predicted, true = forward_model.predict(fitted_model(learned), learned.wandering)
    assert predicted.shape == true.shape == (399, 6)
    np.testing.assert_array_equal(true, np.diff(learned.wandering.percepts, axis=0))
    percepts, actions = map(torch.from_numpy, learned.wandering)
    for step in range(0, 399, 9):
        one = slice(step, step + 1)
        alone = fitted_model(learned)(percepts[one], actions[one]).detach()
        torch.testing.assert_close(predicted[one], alone)


# Commands


def parse(module: object, *arguments: str) -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["script", *arguments])
        return module.parse_arguments()  # pyright: ignore


def test_default_arguments():
    assert vars(parse(wall_following)) == {
        "seed": 0, "runs": "runs", "arena": "paper", "steps": 30_000, "replicates": 1,
        "condition_steps": 2500,
    }  # fmt: skip
    assert vars(parse(forward_model)) == {
        "seed": 0, "runs": "runs", "arena": "paper", "transitions": 5000,
    }  # fmt: skip
    assert parse(wall_following, "--arena", "12").arena == 12  # pyright: ignore


@pytest.mark.parametrize(
    ("module", "options"),
    [
        (forward_model, {"--seed", "--arena", "--transitions", "--runs"}),
        (
            wall_following,
            {"--seed", "--arena", "--steps", "--replicates", "--condition-steps", "--runs"},
        ),
    ],
)
def test_help_says_what_a_command_does_and_takes(module, options, capsys):
    with pytest.raises(SystemExit) as ended:
        parse(module, "--help")
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert module.__doc__.splitlines()[0] in text
    assert all(option in text for option in options)
    assert f"python -m {module.__name__}" in text
    assert "Raises" not in text


@pytest.mark.parametrize(
    ("module", "arguments", "message"),
    [
        (forward_model, ["--transitions", "199"], "--transitions: expected ≥ 200, got 199"),
        (forward_model, ["--transitions", "many"], "expected an integer ≥ 1, got 'many'"),
        (forward_model, ["--arena", "papers"], "--arena: expected "),
        (forward_model, ["--steps", "5"], "unrecognized arguments: --steps 5"),
        (wall_following, ["--seed", "-1"], "--seed: expected an integer ≥ 0, got '-1'"),
        (wall_following, ["--steps", "0"], "--steps: expected an integer ≥ 1, got '0'"),
        (wall_following, ["--replicates", "0"], "--replicates: expected an integer ≥ 1"),
        (wall_following, ["--condition-steps", "2.5"], "--condition-steps: expected an integer"),
        (wall_following, ["--arena", "-2"], "--arena: expected "),
        (wall_following, ["--arena", "10000"], "--arena: expected paper or a seed below 10000"),
        (forward_model, ["--arena", "10003"], "--arena: expected paper or a seed below 10000"),
    ],
)
def test_bad_arguments_end_with_one_line_and_exit_code_2(module, arguments, message, capsys):
    with pytest.raises(SystemExit) as ended:
        parse(module, *arguments)
    assert ended.value.code == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "error:" in line]
    assert message in line


def run_script(module: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"train.{module}", *map(str, arguments)]
    return subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)


def tags_of(folder: Path) -> dict[str, list[str]]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    log = EventAccumulator(str(folder / "tensorboard"))
    log.Reload()
    return log.Tags()


@pytest.fixture(scope="module")
def forward_model_runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folders = []
    for name in ("one", "two"):
        runs = tmp_path_factory.mktemp(name)
        run_script("forward_model", "--seed", 11, "--transitions", 600, "--runs", runs)
        folders.append(only_run(runs))
    return folders


@pytest.mark.slow
def test_the_forward_model_leaves_dataset_checkpoint_scores_and_figures(
    forward_model_runs: list[Path],
):
    folder = forward_model_runs[0]
    assert folder.parent.name == "forward_model"
    assert folder.name.endswith("-seed11")
    episodes = load_demonstrations(folder / "dataset", environment_state=None)
    assert [episode.percepts.shape for episode in episodes] == [(300, 6)] * 2
    assert [episode.action.shape for episode in episodes] == [(300, 2)] * 2
    model = MLPForwardModel.from_pretrained(folder / "checkpoint")
    scores = json.loads((folder / "metrics.json").read_text())
    assert scores["command"] == (
        "python -m train.forward_model --seed 11 --arena paper --transitions 600"
    )
    assert scores["seed"] == 11
    assert scores["transitions"] == 600
    unseen = wander(UNSEEN_ARENAS + 11, forward_model.TEST_STEPS, wall_episodes.testing_seed(11))
    for name, value in forward_model.score(model, unseen).items():
        assert scores[name] == pytest.approx(value, abs=1e-6)
    assert {path.name for path in (folder / "figures").iterdir()} == {"calibration.png", "fit.png"}
    tags = tags_of(folder)
    assert {"fit/train_loss", "fit/validation_loss", "prediction/r2_mean"} <= set(tags["scalars"])
    assert set(tags["images"]) == {"calibration", "fit"}


@pytest.mark.slow
def test_the_same_seed_gives_the_same_forward_model(forward_model_runs: list[Path]):
    one, two = forward_model_runs
    for file in ("metrics.json", "checkpoint/config.json", "checkpoint/model.safetensors"):
        assert (one / file).read_bytes() == (two / file).read_bytes(), file


@pytest.fixture(scope="module")
def walls_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The run's folder, and what the command said."""
    runs = tmp_path_factory.mktemp("walls")
    sizes = ("--steps", 700, "--condition-steps", 60)
    done = run_script("wall_following", "--seed", 11, *sizes, "--runs", runs)
    return only_run(runs), done.stdout


@pytest.mark.slow
def test_a_run_writes_all_its_files(walls_run: tuple[Path, str]):
    folder, said = walls_run
    assert {path.name for path in folder.iterdir()} == {
        "wandering", "forward_model", "dataset", "checkpoint", "figures", "tensorboard",
        "metrics.json", "recall.mp4", "recall.gif",
    }  # fmt: skip
    figures = {path.stem for path in (folder / "figures").iterdir()}
    assert figures == {"percepts", "map", "activations", "path", "conditions"}
    with av.open(folder / "recall.mp4") as video:
        stream = video.streams.video[0]
        assert (stream.width, stream.height) == (960, 480)  # from above beside the chase camera
        assert float(stream.duration * stream.time_base) == pytest.approx(10, abs=0.5)
    with Image.open(folder / "recall.gif") as gif:
        assert gif.size == (480, 240)
        assert gif.n_frames > 50
    for name in ("metrics.json", "figures", "recall.mp4", "checkpoint", "forward_model"):
        assert str(folder / name) in said
    assert f"tensorboard --logdir {folder / 'tensorboard'}" in said
    assert all(condition in said for condition in CONDITIONS)


@pytest.mark.slow
def test_metrics_hold_the_conditions_with_mean_std_and_values(walls_run: tuple[Path, str]):
    scores = json.loads((walls_run[0] / "metrics.json").read_text())
    assert scores["command"] == (
        "python -m train.wall_following --seed 11 --arena paper --steps 700 --replicates 1 "
        "--condition-steps 60"
    )
    assert scores["seed"] == 11
    assert {"wf", "tight", "energy", "contact_share", "cluster_agreement", "nodes"} <= scores.keys()
    assert scores["conditions"].keys() == CONDITIONS
    for condition in scores["conditions"].values():
        for score in ("wf", "tight", "energy"):
            assert condition[score].keys() == {"mean", "std", "values"}
            assert condition[score]["values"] == [condition[score]["mean"]]
            assert condition[score]["std"] == 0
    assert "side_kept" in scores["conditions"]["taught on one side"]


@pytest.mark.slow
def test_datasets_and_checkpoints_of_a_run_load_and_belong_together(walls_run: tuple[Path, str]):
    folder, _ = walls_run
    wandering = load_demonstrations(folder / "wandering", environment_state=None)
    assert [one.percepts.shape for one in wandering] == [(500, 6)] * 10
    demonstrations = load_demonstrations(folder / "dataset", environment_state=None)
    assert len(demonstrations) == 16
    assert [one.task.split()[2] for one in demonstrations] == ["left"] * 8 + ["right"] * 8
    model = MLPForwardModel.from_pretrained(folder / "forward_model")
    network = PACNet.from_pretrained(folder / "checkpoint", model).eval()
    scores = json.loads((folder / "metrics.json").read_text())
    assert len(network.sofm) == scores["nodes"]
    run = act_alone(Recalling(network, 11), Place("paper"), alone_seed(11), 60)
    assert wall_conditions.score_run(run)["wf"] == scores["conditions"]["recall"]["wf"]["mean"]


@pytest.mark.slow
def test_independent_checkers_find_nothing(walls_run: tuple[Path, str]):
    assert_clean(walls_run[0] / "wandering")
    # A finding that is expected still costs 5 of 100 points in each episode that it is in.
    assert_clean(walls_run[0] / "dataset", fail_under=90)


@pytest.mark.slow
def test_the_log_holds_learning_curves_figures_the_projector_and_the_film(
    walls_run: tuple[Path, str],
):
    folder, _ = walls_run
    tags = tags_of(folder)
    curves = {"learning/nodes", "learning/insertions", "fit/train_loss", "fit/validation_loss"}
    assert curves | {"recall/wf", "recall/tight"} <= set(tags["scalars"])
    assert {"percepts", "map", "activations", "path", "conditions", "recall"} <= set(tags["images"])
    assert list((folder / "tensorboard").glob("**/projector_config.pbtxt"))


def interrupt_at(script: str, bar: str, runs: Path) -> str:
    """Press Ctrl-C once a bar appears."""
    command = [sys.executable, "-m", f"train.{script}", "--runs", str(runs)]
    return interrupt(command, runs, lambda text: bar in text)


@pytest.mark.slow
def test_ctrl_c_while_acting_alone_keeps_datasets_and_checkpoints(tmp_path: Path):
    interrupt_at("wall_following", "alone:", tmp_path)
    folder = only_run(tmp_path)
    assert len(load_demonstrations(folder / "wandering", environment_state=None)) == 10
    assert len(load_demonstrations(folder / "dataset", environment_state=None)) == 16
    model = MLPForwardModel.from_pretrained(folder / "forward_model")
    assert len(PACNet.from_pretrained(folder / "checkpoint", model).sofm) > 1
    assert not (folder / "metrics.json").exists()


POOL = """
from train.common.runs import run_folder
from train.walls.conditions import replicates

if __name__ == "__main__":
    with run_folder("pool", 0, {runs!r}):
        list(replicates([0, 1, 2], "paper", 2500))
"""


@pytest.mark.slow
def test_ctrl_c_while_replicates_run_ends_them_too(tmp_path: Path):
    (tmp_path / "pool.py").write_text(POOL.format(runs=str(tmp_path / "runs")))
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "pool.py")],
        cwd=PROJECT,
        env={**os.environ, "PYTHONPATH": str(PROJECT)},
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    time.sleep(12)  # of the minute that a replicate takes
    os.kill(process.pid, signal.SIGINT)
    _, text = process.communicate(timeout=1800)  # until no worker holds its end of the pipe
    assert process.returncode == 130, text
    assert "Interrupted." in text
    assert "Traceback" not in text


@pytest.mark.slow
def test_ctrl_c_while_fitting_keeps_the_dataset(tmp_path: Path):
    interrupt_at("forward_model", "fitting:", tmp_path)
    folder = only_run(tmp_path)
    assert len(load_wandering(folder / "dataset").percepts) == wall_learning.TRANSITIONS
    assert not (folder / "checkpoint").exists()

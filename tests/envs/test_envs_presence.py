"""Episodes in which the demonstrator leaves or was never there, and options combined."""

import itertools
import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import Error
from playing import copy, play

import envs  # noqa: F401  registers the environment
from envs.behaviours import REST_POSTURE
from envs.drawing import draw_scene
from envs.own_glass import OWN_GLASSES
from envs.physics import Physics
from envs.presence import PRESENCES
from envs.scene import SHIRTS, WHO

ENV_ID = "pacnet/PosturalImitation-v0"
EPISODE = json.loads(Path(__file__).with_name("episode.json").read_text())
TODAY = ("demonstrator", "glass", "proprioception")  # percepts that there were before `own_glass`
AWAY = [presence for presence in PRESENCES if presence != "present"]


def bytes_of(observations, keys):
    return [observation[key].tobytes() for observation in observations for key in keys]


def test_episodes_are_what_they_were_before_the_own_glass_was_perceived(noisy):
    """Stored from the version before; its noise must not depend on that of the own glass."""
    observations, _ = play(noisy, copy, 101, seed=5)
    for step, percepts in EPISODE.items():
        for key, values in percepts.items():
            assert observations[int(step)][key] == pytest.approx(values, abs=1e-4), (step, key)


@pytest.mark.parametrize(("presence", "glass"), [*itertools.product(PRESENCES, OWN_GLASSES)])
def test_all_options_together_keep_the_contract(noisy, presence, glass):
    options = {"demonstrator": presence, "own_glass": glass}
    first, second = (play(noisy, copy, 120, **options)[0] for _ in range(2))
    assert bytes_of(first, first[0]) == bytes_of(second, first[0])
    assert all(noisy.observation_space.contains(observation) for observation in first)
    noisy.reset(options=options)
    other = noisy.reset(options=options)[0]
    assert not np.array_equal(other["glass"], first[0]["glass"])  # goes on without a seed


@pytest.mark.parametrize("glass", OWN_GLASSES)
@pytest.mark.parametrize("presence", PRESENCES)
def test_the_place_of_the_demonstrators_glass_depends_on_the_seed_alone(noisy, presence, glass):
    usual, _ = noisy.reset(seed=4)
    observation, _ = noisy.reset(seed=4, options={"demonstrator": presence, "own_glass": glass})
    assert bytes_of([observation], ["glass"]) == bytes_of([usual], ["glass"])


def test_options_last_for_one_episode(noisy):
    usual, _ = play(noisy, copy, 80)
    noisy.reset(options={"demonstrator": "absent", "own_glass": "absent"})
    again, _ = play(noisy, copy, 80)
    assert bytes_of(again, again[0]) == bytes_of(usual, usual[0])


@pytest.mark.parametrize("presence", AWAY)
def test_without_a_demonstrator_an_episode_lasts_15_seconds(noiseless, presence):
    _, infos = play(noiseless, demonstrator=presence)
    assert len(infos) == 751
    assert noiseless.episode_steps == 750
    assert infos[-1].keys() == noiseless.reset(seed=0)[1].keys()
    assert not infos[-1]["demonstrator_success"]


def test_an_absent_demonstrator_is_perceived_as_zeros_and_rests(noisy):
    observations, infos = play(noisy, n_steps=60, demonstrator="absent")
    assert not np.any([observation["demonstrator"] for observation in observations])
    assert all(np.any(observation["glass"]) for observation in observations)
    angles = np.array([info["demonstrator_angles"] for info in infos])
    assert np.abs(angles - angles[0]).max() < 0.01
    assert np.abs(noisy.demonstrator_target - REST_POSTURE).max() < 0.1
    assert {info["phase"] for info in infos} == {"rest"}


def test_a_demonstrator_that_leaves_is_perceived_for_one_second(noisy):
    usual, _ = play(noisy, n_steps=120)
    observations, _ = play(noisy, n_steps=120, demonstrator="leaves")
    assert bytes_of(observations[:50], TODAY) == bytes_of(usual[:50], TODAY)
    assert not np.any([observation["demonstrator"] for observation in observations[50:]])


def test_a_demonstrator_that_leaves_goes_to_rest_smoothly(noiseless):
    noiseless.reset(seed=3, options={"demonstrator": "leaves"})
    targets, infos = [], []
    for _ in range(150):
        targets.append(noiseless.demonstrator_target)
        infos.append(noiseless.step_to(noiseless.rest_posture)[-1])
    acceleration = np.diff(targets, n=2, axis=0) / 0.02**2
    assert np.abs(acceleration).max() < 20.0  # [rad/s^2], as of a whole demonstration
    assert np.abs(targets[48] - REST_POSTURE).max() > 0.1  # it was on its way
    start = infos[0]["demonstrator_angles"]
    assert np.abs(infos[115]["demonstrator_angles"] - start).max() < 0.02
    assert [infos[step]["phase"] for step in (45, 49, 98, 99)] == [
        "approach",
        "withdraw",
        "withdraw",
        "rest",
    ]


def test_a_demonstrator_that_leaves_has_not_touched_its_glass(noiseless):
    observations, _ = play(noiseless, n_steps=200, demonstrator="leaves")
    moved = observations[-1]["glass"] - observations[0]["glass"]
    assert np.abs(moved).max() < 1e-3


def test_alone_the_same_drink_succeeds(noiseless):
    noiseless.reset(seed=3)
    drink = []
    for _ in range(noiseless.episode_steps):
        drink.append(noiseless.demonstrator_target)
        noiseless.step_to(noiseless.rest_posture)
    targets = iter(drink)
    _, infos = play(noiseless, lambda env: next(targets, env.rest_posture), demonstrator="absent")
    assert infos[-1]["is_success"]


def shirts(picture):
    """The share of pixels in the colour of each body's shirt."""
    colours = [np.array(SHIRTS[who][:3]) * 255 for who in WHO]
    return [(np.abs(picture - colour).max(axis=2) < 12).mean() for colour in colours]


def test_a_picture_shows_who_is_there():
    env = gymnasium.make(ENV_ID, render_mode="rgb_array").unwrapped
    pictures = {}
    for presence in (*PRESENCES, "present"):  # back again in the end
        env.reset(seed=0, options={"demonstrator": presence})
        pictures[presence] = env.render(), draw_scene(env._physics, 360, 640).astype(float)
        demonstrator, imitator = shirts(pictures[presence][1])
        assert (demonstrator > 0.03) == (presence != "absent"), presence
        assert imitator > 0.03
    drawn = [np.any(a != b, axis=2) for a, b in zip(*map(pictures.get, AWAY), strict=True)]
    for differs in drawn:  # by OpenGL if there is any, and by Pillow
        assert differs[:, :320].mean() > 0.1
        assert not differs[:, 400:].any()
    env.close()


def test_nothing_touches_an_absent_body():
    """Of 100 postures some put an arm into a body or the table: contacts, if somebody is there."""
    physics = Physics.build()
    contacts = []
    for there in (True, False, True):
        physics.stage(demonstrator=there, own_glass=True)
        rng = np.random.default_rng(0)
        counts = []
        for _ in range(100):
            physics.begin(np.stack([REST_POSTURE] * 2), np.array((0.5, -0.07)))
            physics.data.qpos[physics.angle_at[0]] = rng.uniform(*physics.joint_range.T)
            physics.forward()
            counts.append(physics.data.ncon)
        contacts.append(counts)
    assert max(contacts[0]) > max(contacts[1]) == 0
    assert contacts[2] == contacts[0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"demonstrator": "gone"}, "demonstrator must be one of .*'leaves', 'absent'.* got 'gone'"),
        ({"demonstrator": None}, "demonstrator must be one of"),
        ({"own_glass": "empty"}, "own_glass must be one of .*'tipped', 'far', 'absent'.*'empty'"),
        ({"demonstrator": "absent", "own_glass": 1}, "own_glass must be one of"),
        (
            {"demonstrater": "absent"},
            "options must be .*'demonstrator'.*'own_glass'.*'demonstrater",
        ),
    ],
)
def test_misspelt_options_are_refused_before_anything_changes(noisy, options, message):
    undisturbed = [noisy.reset(seed=2)[0], noisy.step_to(noisy.rest_posture)[0], noisy.reset()[0]]
    first = noisy.reset(seed=2)[0]
    with pytest.raises(ValueError, match=message):
        noisy.reset(seed=7, options=options)
    after = [first, noisy.step_to(noisy.rest_posture)[0], noisy.reset()[0]]
    assert bytes_of(after, first) == bytes_of(undisturbed, first)


def test_a_refused_seed_leaves_the_options_of_the_episode(noisy):
    noisy.reset(seed=2)
    with pytest.raises(Error, match="Seed"):
        noisy.reset(seed=-1, options={"demonstrator": "absent", "own_glass": "absent"})
    observation = noisy.step_to(noisy.rest_posture)[0]
    assert np.any(observation["demonstrator"])
    assert np.any(observation["own_glass"])

"""The contract of every environment: gymnasium's checks, seeds, bounds, bad actions."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import envs  # noqa: F401  registers the environments

ENV_IDS = ["pacnet/PosturalImitation-v0", "pacnet/WallFollowing-v0"]
BEHAVIOURS = [(ENV_IDS[0], {"behaviour": "toast"}), (ENV_IDS[0], {"behaviour": "move"})]
STEP_ARGUMENTS = {"step": "action", "step_to": "angles|wheel_speeds"}  # by name in messages
N_STEPS = 40


@pytest.fixture(scope="module", params=[(env_id, {}) for env_id in ENV_IDS] + BEHAVIOURS, ids=str)
def env(request):
    env_id, arguments = request.param
    made = gymnasium.make(env_id, render_mode="rgb_array", **arguments)
    yield made
    made.close()


def roll(env, seed, n_steps=N_STEPS):
    """Everything an episode's beginning returns, for random actions of the same seed."""
    env.action_space.seed(seed)
    records = [env.reset(seed=seed)]
    records += [env.step(env.action_space.sample()) for _ in range(n_steps)]
    return records


def arrays(value):
    """Every array in nested tuples and dicts."""
    if isinstance(value, dict):
        value = tuple(value.values())
    if isinstance(value, tuple):
        return [array for item in value for array in arrays(item)]
    return [value] if isinstance(value, np.ndarray) else []


def same(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.tobytes() == b.tobytes()
    return type(a) is type(b) and a == b


def test_gymnasium_checker_finds_nothing(env):
    check_env(env.unwrapped)


def test_same_seed_same_bytes(env):
    first, second = roll(env, seed=3), roll(env, seed=3)
    assert all(map(same, first, second))


def test_same_seed_same_bytes_in_another_instance(env):
    other = gymnasium.make(env.spec)
    assert all(map(same, roll(env, seed=5), roll(other, seed=5)))
    other.close()


def test_other_seed_other_episode(env):
    assert not same(roll(env, seed=3, n_steps=1)[1], roll(env, seed=4, n_steps=1)[1])


def test_reset_without_seed_continues_with_the_same_generator(env):
    env.reset(seed=7)
    second, third = env.reset()[0], env.reset()[0]
    assert not same(second, third)
    env.reset(seed=7)
    assert same(env.reset()[0], second)


def test_observations_stay_in_the_space(env):
    for record in roll(env, seed=1):
        assert env.observation_space.contains(record[0])


def test_observations_and_infos_share_no_memory(env):
    kept = [array for record in roll(env, seed=2, n_steps=3) for array in arrays(record)]
    for i, one in enumerate(kept):
        assert not any(np.shares_memory(one, other) for other in kept[:i])


def test_an_observation_is_not_changed_by_later_steps(env):
    observation, info = env.reset(seed=2)
    before = [array.copy() for array in arrays((observation, info))]
    for _ in range(3):
        env.step(env.action_space.sample())
    assert all(map(np.array_equal, arrays((observation, info)), before))


def test_rewards_are_between_zero_and_one(env):
    rewards = [record[1] for record in roll(env, seed=2)[1:]]
    assert min(rewards) >= 0
    assert max(rewards) <= 1


@pytest.mark.parametrize("spoil", ["shape", "nan", "infinite", "text"])
@pytest.mark.parametrize("step", STEP_ARGUMENTS)
def test_bad_action_is_refused_before_anything_moves(env, step, spoil):
    shape = env.action_space.shape
    bad = {
        "shape": np.zeros(shape[0] + 1, np.float32),
        "nan": np.full(shape, np.nan, np.float32),
        "infinite": np.full(shape, np.inf, np.float32),
        "text": "left",
    }[spoil]
    env.reset(seed=9)
    action = env.action_space.sample()
    undisturbed = env.step(action)
    env.reset(seed=9)
    with pytest.raises(ValueError, match=f"({STEP_ARGUMENTS[step]}) must"):
        getattr(env.unwrapped, step)(bad)
    assert same(env.step(action), undisturbed)


def test_action_beyond_the_space_is_refused(env):
    env.reset(seed=9)
    action = np.zeros(env.action_space.shape, np.float32)
    action[-1] = 1.01
    with pytest.raises(ValueError, match=r"action must be within \[-1, 1\]"):
        env.unwrapped.step(action)


def test_step_to_clips_extremes(env):
    """The greatest action is the same as any greater number of its own unit."""
    env.reset(seed=9)
    greatest = env.unwrapped.step(np.ones(env.action_space.shape, np.float32))
    env.reset(seed=9)
    assert same(env.unwrapped.step_to(np.full(env.action_space.shape, 100.0)), greatest)


def test_no_options_are_the_same_as_none(env):
    assert same(env.reset(seed=6, options={}), env.reset(seed=6))


@pytest.mark.parametrize("use", ["step", "step_to", "render"])
@pytest.mark.parametrize("env_id", ENV_IDS)
def test_reset_comes_first(env_id, use):
    env = gymnasium.make(env_id, render_mode="rgb_array").unwrapped
    arguments = () if use == "render" else (np.zeros(env.action_space.shape, np.float32),)
    with pytest.raises(ResetNeeded, match="never reset"):
        getattr(env, use)(*arguments)
    env.close()


def test_render_gives_pictures_of_the_advertised_size(env):
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (360, 640, 3)
    assert picture.dtype == np.uint8
    assert picture.std() > 20  # not one colour


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_render_gives_pictures_of_the_wanted_size(env_id):
    env = gymnasium.make(env_id, render_mode="rgb_array", width=120, height=200)
    env.reset(seed=0)
    assert env.render().shape == (200, 120, 3)
    env.close()


def test_rendering_changes_nothing(env):
    unseen = roll(env, seed=3, n_steps=5)
    env.action_space.seed(3)
    seen = [env.reset(seed=3)]
    for _ in range(5):
        env.render()
        seen.append(env.step(env.action_space.sample()))
    assert all(map(same, unseen, seen))

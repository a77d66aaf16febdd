"""The demonstrator's behaviours other than the drink, and mishaps."""

import gymnasium
import numpy as np
import pytest

import envs  # noqa: F401  registers the environment
from envs.behaviours import BEHAVIOURS, PHASES
from envs.demonstrator import plan_demonstration, solve_postures
from envs.humanoid import JOINTS
from envs.kinematics import RIGHT_ARM, BodyKinematics
from envs.mishaps import MISHAPS, beside, tremble
from envs.scene import GLASS_PLACE
from envs.task import Deeds, TaskMeasures

ENV_ID = "pacnet/PosturalImitation-v0"
SEED = 1000
PLACE = np.array(GLASS_PLACE)


@pytest.fixture(scope="module")
def body():
    return BodyKinematics()


@pytest.fixture(scope="module")
def scenes():
    made = {
        name: gymnasium.make(ENV_ID, noise_scale=0.0, behaviour=name).unwrapped
        for name in BEHAVIOURS
    }
    yield made
    for env in made.values():
        env.close()


def play(env, seed, mishap=None):
    """The infos of an episode whose imitator is given the demonstrator's targets."""
    _, info = env.reset(seed=seed, options={"mishap": mishap} if mishap else None)
    infos, truncated = [info], False
    while not truncated:
        *_, truncated, info = env.step_to(env.demonstrator_target)
        infos.append(info)
    return infos


@pytest.fixture(scope="module")
def episodes(scenes):
    return {name: play(env, SEED) for name, env in scenes.items()}


def plan(body, seed, **arguments):
    return plan_demonstration(body, PLACE, np.random.default_rng(seed), **arguments)


def series(infos, key):
    return np.array([info[key] for info in infos])


def order(infos):
    phases = [info["phase"] for info in infos]
    return [phase for i, phase in enumerate(phases) if i == 0 or phase != phases[i - 1]]


def test_the_drink_has_the_recorded_angles(body):
    """Angles [rad] of the plan that was made when nothing but the drink could be planned."""
    drink = plan(body, SEED, behaviour="drink")
    assert np.bincount(drink.phases).tolist() == [32, 90, 20, 103, 61, 103, 20, 83]
    elbow, shoulder = JOINTS.index("right_elbow"), JOINTS.index("right_shoulder_rz")
    moments = drink.angles[[0, 100, 200, 300, 400]]
    expected = [2.01147, 1.3784, 2.24853, 2.38046, 1.36933]
    assert moments[:, elbow] == pytest.approx(expected, abs=1e-3)
    expected = [-0.7683, -0.34011, -0.06303, -0.04024, -0.34434]
    assert moments[:, shoulder] == pytest.approx(expected, abs=1e-3)


def test_the_drink_has_the_recorded_noise():
    env = gymnasium.make(ENV_ID).unwrapped
    observation, _ = env.reset(seed=SEED)
    assert env.episode_steps == 526
    assert observation["demonstrator"][:3] == pytest.approx(
        [-0.001987, -0.006742, 0.011106], abs=1e-5
    )
    assert observation["glass"][:3] == pytest.approx([0.492592, -0.072427, 0.212126], abs=1e-5)
    env.close()


def test_phases_come_in_order(episodes):
    taken, put = ["rest", "approach", "grasp"], ["put", "release", "withdraw", "rest"]
    assert order(episodes["toast"]) == [*taken, "toast", "lift", "drink", *put]
    assert order(episodes["move"]) == [*taken, "carry", *put]
    assert order(episodes["aside"]) == order(episodes["drink"])


@pytest.mark.parametrize(("behaviour", "least", "most"), [("toast", 10, 13.5), ("move", 6.5, 8.5)])
def test_lengths(body, behaviour, least, most):
    lengths = [
        len(plan(body, seed, behaviour=behaviour).angles) * 0.02 for seed in range(1000, 1010)
    ]
    assert least < min(lengths) < max(lengths) - 0.3
    assert max(lengths) < most


def test_success_comes_with_the_glass_put_down(episodes):
    for infos in episodes.values():
        for key in ("is_success", "demonstrator_success"):
            before_put = [
                info[key] for info in infos if info["phase"] in ("lift", "drink", "carry")
            ]
            assert not any(before_put)
            assert infos[-1][key]


def test_a_toast_is_raised_before_the_mouth_is_reached(episodes):
    toasted, reached = (series(episodes["toast"], key) for key in ("toasted", "mouth_reached"))
    assert toasted.argmax() < reached.argmax()
    assert toasted[-1]
    assert reached[-1]
    assert not series(episodes["drink"], "toasted").any()


def test_a_toast_holds_the_glass_upright_at_arms_length(episodes):
    raised = [info for info in episodes["toast"] if info["phase"] == "toast"][-1]
    forwards, _, up = raised["glass_position"]
    assert 0.45 < forwards < 0.6  # [m], the table's middle is at 0.62
    assert 0.4 < up < 0.55  # [m], the mouth is at 0.68
    assert raised["glass_tilt"] < np.deg2rad(30)


def test_aside_is_a_drink_that_ends_ten_centimetres_to_the_right(episodes):
    infos = episodes["aside"]
    assert infos[-1]["mouth_reached"]
    way = infos[-1]["glass_position"] - infos[0]["glass_position"]
    assert way[:2] == pytest.approx([0.0, -0.1], abs=0.005)
    assert infos[-1]["glass_from_place"] < 0.005  # of the place where it belongs then
    assert infos[-1]["glass_tilt"] < 0.01


def test_after_a_toast_the_hand_stays_by_the_glass(episodes):
    end = {name: infos[-1] for name, infos in episodes.items()}
    toast, drink = (end[name]["imitator_wrist"] for name in ("toast", "drink"))
    assert np.linalg.norm(toast - drink) > 0.15
    assert end["toast"]["glass_from_place"] < 0.005
    assert end["toast"]["glass_tilt"] < 0.01


def test_a_toast_equals_a_drink_before_the_glass_is_lifted(body):
    postures = [
        solve_postures(body, PLACE, np.random.default_rng(SEED), BEHAVIOURS[name])
        for name in ("drink", "toast")
    ]
    for name in ("rest", "pre", "grasp"):
        assert postures[0][name].tobytes() == postures[1][name].tobytes()
    schedules = [BEHAVIOURS[name].schedule for name in ("drink", "toast")]
    assert schedules[0][:3] == schedules[1][:3]
    assert schedules[0][3] != schedules[1][3]


def test_a_move_carries_the_glass_over_the_table(episodes):
    glass = series(episodes["move"], "glass_position")
    way = np.linalg.norm(glass[-1, :2] - glass[0, :2])
    assert 0.18 < way < 0.25
    assert 0.03 < glass[:, 2].max() - glass[0, 2] < 0.12
    assert not series(episodes["move"], "mouth_reached").any()
    assert episodes["move"][0]["glass_from_place"] == pytest.approx(way, abs=0.005)
    assert episodes["move"][-1]["glass_from_place"] < 0.005


def test_a_move_differs_from_a_drink_while_the_hand_closes(episodes):
    angles = {
        name: next(info for info in infos if info["phase"] == "grasp")["demonstrator_angles"]
        for name, infos in episodes.items()
    }
    differences = np.rad2deg(np.abs(angles["move"] - angles["drink"]))
    assert 15 < differences[JOINTS.index("neck_rz")] < 30
    assert differences[JOINTS.index("left_elbow")] > 20


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
def test_plans_are_smooth_and_seeded(body, behaviour):
    first, second, other = (plan(body, seed, behaviour=behaviour) for seed in (1, 1, 2))
    assert first.angles.tobytes() == second.angles.tobytes()
    assert not np.array_equal(first.angles[:100], other.angles[:100])
    velocity = np.diff(first.angles, axis=0) / 0.02
    assert 0.5 < np.abs(velocity).max() < 4.0  # [rad/s]
    assert np.abs(np.diff(velocity, axis=0) / 0.02).max() < 20.0  # [rad/s^2]
    assert (first.angles >= body.joint_range[:, 0]).all()
    assert (first.angles <= body.joint_range[:, 1]).all()


def test_another_behaviour_is_no_success(scenes):
    """Every imitator performs the others' demonstrations, to a glass at the same place."""
    confused = [("drink", "toast"), ("toast", "drink"), ("move", "drink")]
    for asked, shown in (*confused, ("aside", "drink"), ("drink", "aside")):
        other = scenes[shown]
        other.reset(seed=SEED)
        targets = other._plan.angles
        env = scenes[asked]
        env.reset(seed=SEED)
        for target in [*targets[1:], *targets[-1:].repeat(env.episode_steps, axis=0)]:
            info = env.step_to(target)[-1]
        assert info["demonstrator_success"]
        assert not info["is_success"], (asked, shown)


@pytest.mark.parametrize(
    ("instants", "fulfilled"),
    [
        ([], ["move"]),
        ([(0.02, 0.3)], ["drink", "aside"]),  # where the glass is put tells them apart
        ([(0.3, 0.05), (0.02, 0.3)], ["toast"]),
        ([(0.02, 0.3), (0.3, 0.05)], ["drink", "aside"]),  # raised after the first sip
        ([(0.3, 0.07), (0.04, 0.3)], ["move"]),  # neither was reached
    ],
)
def test_deeds_by_hand(instants, fulfilled):
    """Instants are distances [m] of the rim from the mouth and of the glass from the toast."""
    deeds = Deeds()
    for to_mouth, to_toast in instants:
        deeds.update(TaskMeasures(to_mouth, 0.0, 0.0, True, to_toast))
    assert [name for name in BEHAVIOURS if deeds.fulfil(name)] == fulfilled


@pytest.mark.parametrize("mishap", MISHAPS)
def test_a_mishap_spoils_the_drink(scenes, mishap):
    infos = play(scenes["drink"], SEED, mishap)
    assert not infos[-1]["demonstrator_success"]
    assert not infos[-1]["is_success"]
    assert not series(infos, "mouth_reached").any()
    assert infos[-1]["glass_from_place"] < 0.01
    lifted = np.ptp(series(infos, "glass_position")[:, 2])
    if mishap == "interrupted":
        assert 0.08 < lifted < 0.35  # [m]; a drink lifts it 0.43
    else:
        assert lifted < 1e-3


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
def test_an_interrupted_glass_is_put_back_and_the_behaviour_ends(body, behaviour):
    spoiled = plan(body, SEED, behaviour=behaviour, mishap="interrupted")
    phases = [PHASES[i] for i in spoiled.phases]
    first = {"drink": "lift", "toast": "toast", "move": "carry", "aside": "lift"}[behaviour]
    assert list(dict.fromkeys(phases)) == [
        *("rest", "approach", "grasp", first, "put", "release", "withdraw")
    ]
    taken, let_go = (
        body.pose(spoiled.angles[phases.index(phase)]).grip for phase in ("grasp", "release")
    )
    assert np.linalg.norm(let_go - taken) < 0.01


def test_a_tremor_has_the_stated_size_and_frequency(body):
    still = np.repeat(np.zeros((1, len(JOINTS))), 500, axis=0)  # 10 s
    for seed in range(5):
        shaken = tremble(still, body.joint_range, np.random.default_rng(seed))
        others = [i for i in range(len(JOINTS)) if i not in RIGHT_ARM]
        assert not shaken[:, others].any()
        spectrum = np.abs(np.fft.rfft(shaken[:, RIGHT_ARM], axis=0))
        peaks = np.fft.rfftfreq(500, 0.02)[spectrum.argmax(axis=0)]
        assert np.ptp(peaks) < 0.11  # neighbouring lines of the spectrum
        assert 3.9 <= peaks[0] <= 6.1
        assert (shaken[:, RIGHT_ARM].max(axis=0) > 0.095).all()
        assert (shaken[:, RIGHT_ARM].max(axis=0) <= 0.1501)[1:].all()
        assert not still.any()


def test_a_tremor_stays_within_the_joint_ranges(body):
    for seed in range(5):
        angles = plan(body, seed, behaviour="toast", mishap="tremor").angles
        assert (angles >= body.joint_range[:, 0]).all()
        assert (angles <= body.joint_range[:, 1]).all()


def test_a_miss_is_six_to_eight_centimetres_beside_the_glass(body):
    rng = np.random.default_rng(0)
    distances = [np.linalg.norm(beside(PLACE, rng) - PLACE) for _ in range(100)]
    assert 0.06 <= min(distances) < 0.063
    assert 0.077 < max(distances) <= 0.08
    missed = plan(body, SEED, behaviour="toast", mishap="miss")
    grasp = body.pose(missed.angles[np.flatnonzero(missed.phases == PHASES.index("grasp"))[-1]])
    assert 0.055 < np.linalg.norm(grasp.grip[:2] - PLACE) < 0.085


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mishap": "earthquake"}, r"mishap must be one of .*'miss'.* got 'earthquake'"),
        ({"mishap": None}, "mishap must be one of"),
        ({"accident": "miss"}, r"options must be .*mishap.* got .*accident"),
        ({"mishap": "miss", "size": 1}, "options must be"),
        (
            {"glass_offset": (0.2, 0.0)},
            r"expected glass_offset .* at most 0.16 m .* got \(0.2, 0.0",
        ),
        ({"mishap": "earthquake", "glass_offset": (0.1, 0.0)}, "mishap must be one of"),
    ],
)
def test_unknown_options_are_refused_before_anything_changes(scenes, options, message):
    env = scenes["drink"]
    env.reset(seed=SEED)
    undisturbed = env.step_to(env.rest_posture)[0]["demonstrator"], env.reset()[0]["demonstrator"]
    env.reset(seed=SEED)
    with pytest.raises(ValueError, match=message):
        env.reset(seed=SEED + 1, options=options)
    after = env.step_to(env.rest_posture)[0]["demonstrator"], env.reset()[0]["demonstrator"]
    assert np.array_equal(undisturbed, after)


@pytest.mark.slow
@pytest.mark.parametrize("behaviour", BEHAVIOURS)
def test_seventy_five_episodes_succeed(behaviour):
    env = gymnasium.make(ENV_ID, behaviour=behaviour).unwrapped
    ends = [play(env, seed)[-1] for seed in range(1000, 1075)]
    assert sum(end["demonstrator_success"] for end in ends) >= 74
    assert sum(end["is_success"] for end in ends) >= 73
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("pace", [0.75, 1.25])
@pytest.mark.parametrize("behaviour", ["toast", "move"])
def test_other_paces_succeed(behaviour, pace):
    env = gymnasium.make(ENV_ID, behaviour=behaviour, pace=pace).unwrapped
    assert all(play(env, seed)[-1]["is_success"] for seed in range(1000, 1010))
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("mishap", MISHAPS)
@pytest.mark.parametrize("behaviour", BEHAVIOURS)
def test_no_mishap_counts_as_success(behaviour, mishap):
    env = gymnasium.make(ENV_ID, behaviour=behaviour).unwrapped
    for seed in range(1000, 1011):
        assert not play(env, seed, mishap)[-1]["demonstrator_success"], seed
    env.close()

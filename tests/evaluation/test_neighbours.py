"""Baselines: neighbours worked out by hand and by brute force, histories, gaps, refusals."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.evaluation import NearestNeighbours, RepeatLast, neighbours

PROJECT = Path(__file__).parents[2]
FPS = 10


def episode(percepts: list | np.ndarray, actions: list | np.ndarray, **kind) -> Demonstration:
    state = torch.as_tensor(np.asarray(percepts), dtype=torch.float32)
    action = torch.as_tensor(np.asarray(actions), dtype=torch.float32)
    shown = {"episode": 0, "task": "move"} | kind
    return Demonstration(
        state=state, environment_state=torch.empty(len(state), 0), action=action, **shown
    )


def shown(*episodes: Demonstration) -> Demonstrations:
    percepts, actions = episodes[0].percepts.shape[1], episodes[0].action.shape[1]
    names = {
        "observation.state": tuple(f"x{number}" for number in range(percepts)),
        "action": tuple(f"u{number}" for number in range(actions)),
    }
    return Demonstrations(FPS, names, episodes)


def drawn(seed: int, frames: int, dimensions: int = 3) -> Demonstration:
    """Random walks, each dimension on a scale of its own."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(frames, dimensions)) * 10.0 ** np.arange(dimensions)
    return episode(steps.cumsum(axis=0), rng.normal(size=(frames, 2)))


def brute_force(training: Demonstrations, asked: Demonstration, k: int, lag: int = 0) -> np.ndarray:
    """The second method: one frame after the other, all differences written out."""

    def frames(part: Demonstration) -> np.ndarray:
        x = part.percepts.numpy().astype(np.float64)
        if not lag:
            return x
        change = [x[frame] - x[max(0, frame - lag)] for frame in range(len(x))]
        return np.hstack([x, change])

    known = np.vstack([frames(part) for part in training])
    actions = np.vstack([part.action.numpy() for part in training])
    found = []
    for frame in frames(asked):
        distances = (((known - frame) / known.std(axis=0)) ** 2).sum(axis=1)
        found.append(actions[np.argsort(distances)[:k]].mean(axis=0))
    return np.array(found)


def test_the_nearest_in_standard_deviations_count():
    # Deviations: x has 2 (0 and 4, twice each), y 0.1 (0 and 0.2). From (1.2, 0.17) the squared
    # distances are, in order: .6² + 1.7² = 3.25, .6² + .3² = .45, 1.4² + 1.7² = 4.85 and
    # 1.4² + .3² = 2.05. Without scaling, (0, 0) would be second, before (4, 0.2).
    known = shown(episode([[0, 0], [0, 0.2], [4, 0], [4, 0.2]], [[1], [2], [4], [8]]))
    asked = episode([[1.2, 0.17]], [[0]])
    answers = [NearestNeighbours(k).fit(known).predict(asked) for k in (1, 2, 3, 4)]
    np.testing.assert_allclose(np.ravel(answers), [2, 5, 11 / 3, 15 / 4], rtol=1e-6)
    assert all(answer.dtype == np.float32 for answer in answers)


@pytest.mark.parametrize("k", [1, 5])
@pytest.mark.parametrize(("history_s", "lag"), [(0.0, 0), (0.3, 3), (0.01, 1), (0.26, 3)])
def test_it_finds_what_brute_force_finds(k: int, history_s: float, lag: int):
    known, asked = shown(drawn(0, 120), drawn(1, 80)), drawn(2, 50)
    answer = NearestNeighbours(k, history_s).fit(known).predict(asked)
    np.testing.assert_allclose(answer, brute_force(known, asked, k, lag), rtol=1e-5, atol=1e-6)


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch):
    known, asked = shown(drawn(0, 200)), drawn(2, 50)
    fitted = NearestNeighbours(3, 0.3).fit(known)
    whole = fitted.predict(asked)
    for frames_at_once in (0, 7):
        monkeypatch.setattr(neighbours, "_BLOCK_BYTES", 8 * 200 * frames_at_once)
        np.testing.assert_array_equal(fitted.predict(asked), whole)


def test_an_offset_costs_no_precision():
    # Neighbouring float32 numbers from 2^20 on lie 1/8 apart.
    order = np.random.default_rng(0).permutation(500)
    known = episode(2.0**20 + order[:, None] / 8, order[:, None])
    answer = NearestNeighbours(1).fit(shown(known)).predict(known)
    np.testing.assert_array_equal(answer, known.action)


def test_a_dimension_that_never_moved_has_the_median_factor_of_the_others():
    # Deviations 1, 2 and 4 of x, y and z: the median factor is 1/2. The last dimension does not
    # move; a change of 1 counts as half a deviation, and adds the same to every distance.
    x, y, z = [-1, 1, -1, 1], [-2, -2, 2, 2], [-4, 4, 4, -4]
    known = shown(episode(np.array([x, y, z, [7] * 4]).T, np.eye(4)))
    fitted = NearestNeighbours(1).fit(known)
    np.testing.assert_allclose(fitted._factors, [1, 1 / 2, 1 / 4, 1 / 2])
    asked = episode([[0.5, 1, -3, 9]], np.zeros((1, 4)))
    np.testing.assert_array_equal(fitted.predict(asked), [[0, 0, 0, 1]])


def test_percepts_and_changes_that_never_move_count_as_they_are():
    known = shown(episode(np.full((3, 2), 5.0), [[1], [2], [6]]))
    for history_s in (0, 0.3):
        fitted = NearestNeighbours(3, history_s).fit(known)
        np.testing.assert_allclose(fitted.predict(episode([[5, 5]], [[0]])), [[3]])
        assert torch.equal(fitted._factors, torch.ones_like(fitted._factors))


def test_a_history_tells_the_way_out_from_the_way_back():
    out = np.linspace(0, 1, 40)
    path = np.concatenate([out, out[::-1]])[:, None]
    way = np.repeat([1.0, -1.0], 40)[:, None]
    fitted = NearestNeighbours(1, 0.3).fit(shown(episode(path, way)))
    answer = fitted.predict(episode(path + 0.001, way))
    assert (answer[5:35] == 1).all()
    assert (answer[45:] == -1).all()


def test_a_history_does_not_reach_across_gaps():
    one, two = drawn(0, 30), drawn(1, 30)
    joined = episode(
        torch.cat([one.percepts, two.percepts]), torch.cat([one.action, two.action]), gaps=(30,)
    )
    apart = NearestNeighbours(1, 0.3).fit(shown(one, two))
    together = NearestNeighbours(1, 0.3).fit(shown(joined))
    asked = drawn(2, 50)
    np.testing.assert_array_equal(apart.predict(asked), together.predict(asked))
    parts = [apart.predict(part) for part in (one, two)]
    np.testing.assert_array_equal(apart.predict(joined), np.vstack(parts))


def pictured(*levels: float, frames: int = 2) -> list[Demonstration]:
    """Episodes at x from 0 on, each with its actions, and pictures with one patch of some grey."""
    episodes = []
    for number, level in enumerate(levels):
        pictures = np.zeros((frames, 32, 48, 3), np.uint8)
        pictures[0, :2, :3] = level  # one cell of 16 × 16; later pictures do not count
        episodes.append(
            episode(
                np.arange(frames)[:, None],
                10 * number + np.arange(frames)[:, None],
                episode=number,
                pictures={"top": pictures},
            )
        )
    return episodes


def test_the_first_picture_tells_which_episode_is_near():
    *known, asked = pictured(0, 200, 120)
    blind = NearestNeighbours(1).fit(shown(*known))
    np.testing.assert_array_equal(blind.predict(asked).ravel(), [0, 1])
    seeing = NearestNeighbours(1, cameras=["top"]).fit(shown(*known))
    np.testing.assert_array_equal(seeing.predict(asked).ravel(), [10, 11])
    (darker,) = pictured(90)
    np.testing.assert_array_equal(seeing.predict(darker).ravel(), [0, 1])


def test_first_pictures_count_as_much_as_percepts():
    # x is 0 or 1, a deviation of 1/2: when it is scaled, the squared distance of both is 4. That of
    # both pictures is to be the same.
    known = pictured(0, 200)
    seeing = NearestNeighbours(1, cameras=["top"]).fit(shown(*known))
    assert seeing._pictures is not None
    apart = seeing._pictures.apart(known[0])
    np.testing.assert_allclose(apart, [0, 0, 4, 4])


def test_each_part_has_a_first_picture_of_its_own():
    (asked,) = pictured(0, frames=4)
    asked.pictures["top"][2, :2, :3] = 200
    asked = episode(asked.state, asked.action, gaps=(2,), pictures=asked.pictures)
    known = pictured(0, 200, frames=4)
    answer = NearestNeighbours(1, cameras=["top"]).fit(shown(*known)).predict(asked)
    np.testing.assert_array_equal(answer.ravel(), [0, 1, 12, 13])


def test_the_same_picture_in_all_episodes_tells_nothing():
    known = pictured(90, 90)
    answer = NearestNeighbours(1, cameras=["top"]).fit(shown(*known)).predict(pictured(3)[0])
    np.testing.assert_array_equal(answer, NearestNeighbours(1).fit(shown(*known)).predict(known[0]))


def test_there_may_be_fewer_frames_than_neighbours_and_nothing_to_answer():
    fitted = NearestNeighbours(5).fit(shown(episode([[0], [1]], [[1], [3]])))
    np.testing.assert_array_equal(fitted.predict(episode([[0]], [[0]])), [[2]])
    assert fitted.predict(episode(np.empty((0, 1)), np.empty((0, 1)))).shape == (0, 1)


def test_repeating_begins_with_the_mean_first_action_also_after_a_gap():
    # The first actions are (1, 10) and (3, 30); the second part of an episode is no beginning.
    known = shown(
        episode([[0], [0]], [[1, 10], [7, 7]]),
        episode([[0]], [[3, 30]]),
        episode([[0]], [[100, 100]], first_frame=5),
    )
    fitted = RepeatLast().fit(known)
    asked = episode([[0]] * 4, [[4, 4], [5, 5], [6, 6], [8, 8]], gaps=(2,))
    answer = fitted.predict(asked)
    np.testing.assert_array_equal(answer, [[2, 20], [4, 4], [2, 20], [6, 6]])
    assert asked.action[0].tolist() == [4, 4]  # what was shown stays
    assert fitted.predict(episode(np.empty((0, 1)), np.empty((0, 2)))).shape == (0, 2)
    later = shown(*known.episodes[2:])
    np.testing.assert_array_equal(RepeatLast().fit(later).predict(asked)[0], [100, 100])


@pytest.mark.parametrize("baseline", [NearestNeighbours(1), RepeatLast()])
def test_demonstrations_are_needed_first(baseline: NearestNeighbours | RepeatLast):
    with pytest.raises(ValueError, match="expected a call of fit"):
        baseline.predict(episode([[0]], [[0]]))
    with pytest.raises(ValueError, match="expected demonstrations with at least one frame"):
        baseline.fit(shown(episode(np.empty((0, 1)), np.empty((0, 1)))))


def test_bad_settings_and_other_percepts_are_refused():
    for k in (0, 1.0, True, "1"):
        with pytest.raises(ValueError, match="expected k as an integer ≥ 1, got"):
            NearestNeighbours(k)
    for history_s in (-0.1, float("nan"), float("inf"), None):
        with pytest.raises(ValueError, match="expected history_s ≥ 0"):
            NearestNeighbours(1, history_s)
    for history_s in (0, 0.3):
        fitted = NearestNeighbours(1, history_s).fit(shown(drawn(0, 9)))
        with pytest.raises(ValueError, match="expected percepts of 3 dimensions, as fitted, got 2"):
            fitted.predict(drawn(0, 9, 2))
    with pytest.raises(ValueError, match="expected pictures of 'top', episode 0 has none"):
        NearestNeighbours(1, cameras=["top"]).fit(shown(drawn(0, 9)))


MEMORY = """
import resource
import torch
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.evaluation import NearestNeighbours

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

def episode(frames):
    rows = torch.randn(frames, 4, generator=torch.Generator().manual_seed(frames))
    return Demonstration(0, "move", rows, torch.empty(frames, 0), rows)

fitted = NearestNeighbours(1).fit(Demonstrations(10, {}, (episode(20_000),)))
fitted.predict(episode(1))
before = peak()
fitted.predict(episode(10_000))
print(peak() - before)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is counted in other units there")
def test_memory_stays_bounded_in_a_process():
    # All distances at once would take 1,600 MB.
    done = subprocess.run(
        [sys.executable, "-c", MEMORY], cwd=PROJECT, capture_output=True, text=True, check=True
    )
    assert float(done.stdout) < 64  # [MB]

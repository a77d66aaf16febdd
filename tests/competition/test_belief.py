"""The belief against a plain forward algorithm; the timeline by brute force."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import torch
from torch import Tensor

from pacnet import CompetingSchemas, CompetingSchemasConfig, RecognitionConfig
from pacnet.competition.belief import Belief
from pacnet.competition.timeline import Timeline, build_timeline, make_timeline

PLACES = 32


def make_lines(samples: list[int], behaviour: list[int], places: int = PLACES) -> Timeline:
    """Episodes whose places have rows of their own: first those of the first."""
    rows = torch.arange(len(samples) * places).view(len(samples), places)
    numbers = torch.arange(len(samples))
    return make_timeline(rows, numbers, torch.tensor(samples), torch.tensor(behaviour))


def watch(belief: Belief, cues: Tensor, percepts: Tensor) -> Tensor:
    """The belief after each percept, `[T, E, P]`; cues [R, D] are those of the timeline's rows."""
    history = []
    for percept in percepts:
        belief.update(torch.linalg.vector_norm(cues - percept, dim=1).numpy())
        history.append(torch.from_numpy(belief.probability))
    return torch.stack(history)


def progress(history: Tensor) -> Tensor:
    """Mean place of each belief, from 0 to 1, `[T]`."""
    middle = (torch.arange(history.shape[2]) + 0.5) / history.shape[2]
    return history.sum(dim=1) @ middle.double()


# Where episodes begin and how fast they go


def test_every_behaviour_is_as_likely_however_many_episodes_it_has():
    timeline = make_lines([50, 60, 70, 80], behaviour=[7, 3, 3, 3])
    of_episodes = timeline.start.sum(axis=1).tolist()
    assert of_episodes == pytest.approx([1 / 2, 1 / 6, 1 / 6, 1 / 6])


def test_half_of_the_belief_says_that_an_episode_is_watched_from_its_beginning():
    start = make_lines([50], behaviour=[0], places=4).start
    assert start.tolist() == [pytest.approx([0.5 + 0.125, 0.125, 0.125, 0.125])]


def test_the_pace_is_that_of_the_episode_give_or_take():
    timeline = make_lines([PLACES, PLACES // 2, 10 * PLACES], behaviour=[0, 1, 2])
    steps = np.arange(timeline.advance.shape[1])
    np.testing.assert_allclose(timeline.advance.sum(axis=1), 1)
    mean = timeline.advance @ steps
    assert mean.tolist() == pytest.approx([1.0, 2.0, 0.1], rel=0.01)
    # Poisson of mean 1: 1 / (n! e), but for the tail that is cut off.
    expected = [math.exp(-1) / math.factorial(n) for n in range(4)]
    assert timeline.advance[0, :4].tolist() == pytest.approx(expected, rel=1e-3)


# The forward algorithm


def make_small(config: RecognitionConfig) -> Belief:
    """Two episodes of three places; the chances are no more than a test needs."""
    start = np.array([[0.5, 0.125, 0.0], [0.25, 0.0, 0.125]])
    advance = np.array([[0.5, 0.5, 0.0, 0.0], [0.25, 0.25, 0.25, 0.25]])
    rows = np.array([[0, 1, 2], [0, 3, 4]])  # they share the first
    return Belief(Timeline(rows, np.array([0, 1]), advance, start), config)


def test_one_sample_on_by_hand_the_end_keeps_what_runs_over_it():
    ahead = make_small(RecognitionConfig()).predict()
    # .5 -> .25, .25; .125 -> .0625, .0625. .25 -> quarters at 0, 1 and two at the end, which stays.
    expected = [[0.25, 0.3125, 0.0625], [0.0625, 0.0625, 0.125 + 0.125]]
    np.testing.assert_allclose(ahead, expected)


def plain_forward(belief: Belief, distances: list[list[float]]) -> list[dict[tuple, float]]:
    """α(place) = likelihood × Σ α(before) × chance of the step, in Python's own doubles."""
    rows, _, advance, start = (field.tolist() for field in belief.timeline)
    config = belief.config
    states = [(e, p) for e in range(len(rows)) for p in range(len(rows[0]))]
    alpha = {state: start[state[0]][state[1]] for state in states}
    history = []
    for sample, distance in enumerate(distances):
        if sample:
            moved = dict.fromkeys(states, 0.0)
            for (e, p), before in alpha.items():
                for step, chance in enumerate(advance[e]):
                    moved[e, min(p + step, len(rows[0]) - 1)] += before * chance
            alpha = {
                (e, p): (1 - config.restart_prob) * moved[e, p] + config.restart_prob * start[e][p]
                for e, p in states
            }
        for e, p in states:
            normal = math.exp(-0.5 * (distance[rows[e][p]] / config.obs_std) ** 2)
            alpha[e, p] *= normal + config.outlier_likelihood
        total = math.fsum(alpha.values())
        alpha = {state: value / total for state, value in alpha.items()}
        history.append(alpha)
    return history


@pytest.mark.parametrize("lines", [False, True])
def test_the_belief_is_that_of_a_plain_forward_algorithm(lines: bool):
    config = RecognitionConfig(n_states=5, obs_std=0.5, outlier_likelihood=0.01, restart_prob=0.05)
    generator = torch.Generator().manual_seed(0)
    belief = make_small(config)
    if lines:  # 3 samples for 5 places: steps of more than all of them are among the chances
        timeline = make_lines([3, 7, 40], behaviour=[0, 1, 1], places=5)
        belief = Belief(timeline, config)
    rows = int(belief.timeline.rows.max()) + 1
    distances = 2 * torch.rand(12, rows, generator=generator)
    for distance, expected in zip(
        distances, plain_forward(belief, distances.tolist()), strict=True
    ):
        belief.update(distance.numpy())
        got = {
            (e, p): value
            for e, of_episode in enumerate(belief.probability.tolist())
            for p, value in enumerate(of_episode)
        }
        assert got == pytest.approx(expected, rel=1e-6, abs=1e-12)
        assert math.fsum(got.values()) == pytest.approx(1)


def test_asking_what_is_ahead_changes_nothing():
    asked, other = (make_small(RecognitionConfig()) for _ in range(2))
    distances = np.float32([0.1, 0.2, 0.3, 0.4, 0.5])
    for _ in range(3):
        asked.update(distances)
        other.update(distances)
        np.testing.assert_array_equal(asked.predict(), asked.predict())
        np.testing.assert_array_equal(asked.probability, other.probability)
    asked.predict()
    assert asked.predict() is not asked.probability


def test_the_timeline_is_not_changed_by_what_is_watched():
    timeline = make_lines([20, 20], behaviour=[0, 1])
    before = copy.deepcopy(timeline)
    watch(Belief(timeline, RecognitionConfig()), torch.randn(2 * PLACES, 1), torch.randn(30, 1))
    for now, then in zip(timeline, before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_fewer_distances_than_rows_are_refused_and_change_nothing():
    belief = make_small(RecognitionConfig())
    with pytest.raises(ValueError, match="a distance for each row"):
        belief.update(np.zeros(4, np.float32))
    assert not belief.has_begun


# What it makes of what is watched. Two episodes along y = 0 that part half way, up and down.


def make_fork(samples: int = 100) -> tuple[Belief, Tensor]:
    """The belief about both, and the cues of their places [2 P, 2]."""
    cues = torch.cat([walk(side, torch.linspace(0, 1, PLACES)) for side in (1, -1)])
    config = RecognitionConfig(n_states=PLACES, obs_std=0.05)
    return Belief(make_lines([samples, samples], behaviour=[0, 1]), config), cues


def walk(side: int, time: Tensor) -> Tensor:
    """Where it is at these times [T] from 0 to 1, `[T, 2]`."""
    return torch.stack([2 * time, side * (2 * time - 1).clamp(min=0)], dim=1)


@pytest.mark.parametrize("samples", [50, 100, 180])
@pytest.mark.parametrize("side", [1, -1])
def test_it_keeps_pace_with_what_goes_faster_or_slower(samples: int, side: int):
    belief, cues = make_fork()
    time = torch.linspace(0, 1, samples)
    history = watch(belief, cues, walk(side, time))
    torch.testing.assert_close(
        history.sum(dim=(1, 2)), torch.ones(samples, dtype=torch.float64), rtol=0, atol=1e-12
    )
    assert (progress(history) - time).abs().max() < 1 / PLACES
    of_episode = history.sum(dim=2)[:, 0 if side == 1 else 1]
    assert (of_episode[time < 0.45] - 0.5).abs().max() < 1e-6  # nothing tells them apart yet
    assert of_episode[time > 0.65].min() > 0.99


def test_an_interruption_is_waited_for():
    belief, cues = make_fork()
    time = torch.cat([torch.linspace(0, 0.7, 70), torch.full((60,), 0.7)])
    history = watch(belief, cues, walk(1, time))
    assert progress(history)[-1] == pytest.approx(0.7, abs=2 / PLACES)


def test_what_is_watched_from_the_middle_is_found():
    belief, cues = make_fork()
    time = torch.linspace(0.8, 1, 20)
    assert progress(watch(belief, cues, walk(-1, time)))[0] == pytest.approx(0.8, abs=2 / PLACES)


def test_a_burst_of_noise_does_not_decide():
    belief, cues = make_fork()
    percepts = walk(1, torch.linspace(0, 1, 100))
    percepts[70] = walk(-1, torch.tensor([0.7]))[0]  # a single sample of the other one
    percepts[75:78] = 5 * torch.randn(3, 2, generator=torch.Generator().manual_seed(1))
    of_first = watch(belief, cues, percepts).sum(dim=2)[:, 0]
    assert of_first[65:].min() > 0.9


def test_a_real_change_is_seen_within_a_few_samples():
    belief, cues = make_fork()
    first, second = walk(1, torch.linspace(0, 0.8, 80)), walk(-1, torch.linspace(0.8, 1, 20))
    of_second = watch(belief, cues, torch.cat([first, second])).sum(dim=2)[:, 1]
    assert of_second[79] < 0.01
    assert of_second[88:].min() > 0.99


def test_what_fits_nothing_leaves_the_belief_as_likely_as_it_was():
    belief, cues = make_fork()
    history = watch(belief, cues, torch.full((50, 2), 1e6))
    assert history[-1].sum(dim=1).tolist() == pytest.approx([0.5, 0.5])


# The timeline, by brute force over every sample of every pass


def make_random(seed: int, forget: bool) -> CompetingSchemas:
    """Several episodes that share schemas, some of them deleted with their nodes."""
    generator = torch.Generator().manual_seed(seed)

    def draw(under: int) -> int:
        return int(torch.randint(under, (), generator=generator))

    schemas = CompetingSchemas(CompetingSchemasConfig(1, percept_dimensions=1, lookahead_samples=4))
    for _ in range(6):
        schemas.add_node()
    for episode in range(8):
        schemas.begin(episode, f"behaviour {episode % 3}")
        for node in [draw(6) for _ in range(5)]:
            for _ in range(2 + draw(9)):
                cue = node + 0.1 * torch.randn(1, generator=generator)
                habituated = draw(4) > 0
                schemas.write(node, cue, cue, activation=0.8, habituated=habituated)
    if forget:
        schemas.delete(torch.tensor([1, 4]))
    schemas.state_dict()  # closes the gaps
    return schemas


def shown_by_hand(schemas: CompetingSchemas) -> dict[int, list[tuple[float, int]]]:
    """Episode -> (time in it, row) of every sample that some pass stands for."""
    frames, shown = schemas.pool.live("frame").tolist(), {}
    columns = ("episode", "schema", "first", "last")
    passes = zip(*(schemas.visits.live(name).tolist() for name in columns), strict=True)
    for episode, schema, first, last in passes:
        start = int(schemas.blocks.live("start")[schema])
        rows = range(start, start + int(schemas.lengths[schema]))
        begin, span = frames[rows[0]], max(frames[rows[-1]] - frames[rows[0]], 1)
        for row in rows:
            time = first + (frames[row] - begin) / span * (last - first)
            shown.setdefault(episode, []).append((time, row))
    return shown


@pytest.mark.parametrize("places", [3, 16, 64])
@pytest.mark.parametrize("forget", [False, True])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_place_has_the_row_that_is_nearest_in_time(seed: int, places: int, forget: bool):
    schemas = make_random(seed, forget)
    timeline, shown = build_timeline(schemas, places), shown_by_hand(schemas)
    assert timeline.episode.tolist() == sorted(shown)
    samples = schemas.episodes.live("samples").tolist()
    for rows, episode in zip(timeline.rows.tolist(), sorted(shown), strict=True):
        at = [((time + 0.5) / samples[episode] * places, row) for time, row in shown[episode]]
        own = {int(place) for place, _ in at}
        for place, row in enumerate(rows):
            # A place without a row takes that of the nearest place that has one.
            near = min(abs(place - other) for other in own)
            sources = [other for other in own if abs(place - other) == near]
            best = []
            for source in sources:
                distance = {r: abs(p - source - 0.5) for p, r in at if int(p) == source}
                nearest = min(distance.values())
                best += [r for r, value in distance.items() if value < nearest + 1e-4]
            assert row in best
    np.testing.assert_array_equal(timeline.rows, build_timeline(schemas, places).rows)


@pytest.mark.parametrize(
    ("samples", "expected"),
    [
        ("0.1", [0, 0, 1]),
        ("0..1", [0, 0, 1, 1]),
        ("0...1", [0, 0, 0, 1, 1]),
        ("..0.1.", [0, 0, 0, 0, 1, 1]),
    ],
)
def test_a_place_between_two_that_are_equally_near_has_the_row_of_the_earlier(
    samples: str, expected: list[int]
):
    """There is a place for each sample, and a row only where node 0 or node 1 is habituated."""
    schemas = CompetingSchemas(CompetingSchemasConfig(1, percept_dimensions=1))
    for _ in range(2):
        schemas.add_node()
    schemas.begin(0, "")
    for sample in samples:
        node = 0 if sample == "." else int(sample)
        cue = torch.zeros(1)
        schemas.write(node, cue, cue, activation=1.0, habituated=sample != ".")
    schemas.state_dict()  # closes the gaps
    assert build_timeline(schemas, len(samples)).rows.tolist() == [expected]


def test_the_timeline_knows_behaviour_and_pace_of_each_episode():
    schemas = make_random(0, forget=False)
    timeline = build_timeline(schemas, 16)
    rate = 16 / schemas.episodes.live("samples").numpy()
    steps = np.arange(timeline.advance.shape[1])
    np.testing.assert_allclose(timeline.advance @ steps, rate, rtol=0.02)
    # Behaviours 0 and 1 were shown three times, behaviour 2 twice.
    expected = [1 / 9, 1 / 9, 1 / 6] * 3
    assert timeline.start.sum(axis=1).tolist() == pytest.approx(expected[:8])


def test_an_episode_that_was_forgotten_wholly_is_not_in_the_timeline():
    schemas = CompetingSchemas(CompetingSchemasConfig(1, percept_dimensions=1))
    for node in range(2):
        schemas.add_node()
        schemas.begin(node, "")
        for _ in range(3):
            schemas.write(node, torch.zeros(1), torch.zeros(1), activation=1.0, habituated=True)
    schemas.delete(torch.tensor([0]))
    assert build_timeline(schemas, 4).episode.tolist() == [1]
    schemas.delete(torch.tensor([0]))
    assert schemas.timeline() is None


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("n_states", 1),
        ("n_states", 8.0),
        ("n_states", 10**6),
        ("obs_std", 0.0),
        ("obs_std", math.inf),
        ("outlier_likelihood", 0.0),
        ("outlier_likelihood", 1.0),
        ("restart_prob", 0.0),
        ("restart_prob", 1.0),
        ("novel_above", 0.0),
        ("novel_above", 1.0),
        ("novel_above", None),
    ],
)
def test_a_config_without_meaning_is_refused_by_name(field: str, value: object):
    with pytest.raises(ValueError, match=f"RecognitionConfig.{field}.*got"):
        RecognitionConfig(**{field: value})

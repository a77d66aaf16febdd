"""Retraining: what makes one sequence of targets worse than another, and which of them stays."""

import math

import pytest
import torch

from pacnet import CompetingSchemas, CompetingSchemasConfig
from pacnet.schemas.consolidation import OPEN, Quality, _Comparison, compare, roughness

GOOD = Quality(fit=0.9, roughness=0.01, length=100)


def column(*values: float) -> torch.Tensor:
    return torch.tensor(values)[:, None]


# Roughness


@pytest.mark.parametrize("speed", [0.0, 0.25, 8.0])
def test_a_straight_course_of_any_speed_is_smooth(speed: float):
    course = torch.arange(9.0)[:, None] * torch.tensor([speed, -speed])
    assert roughness(course) == 0


def test_roughness_is_the_distance_from_the_middle_of_the_neighbours():
    # Of 0 1 4 9 the inner ones lie at 1 and 4, their neighbours' middles at 2 and 5.
    assert roughness(column(0, 1, 4, 9)) == 1
    # Of 0 0 6 0 0 the inner ones lie 3, 6 and 3 off: sqrt((9 + 36 + 9) / 3).
    assert roughness(column(0, 0, 6, 0, 0)) == pytest.approx(math.sqrt(18))


def test_roughness_adds_up_the_dimensions():
    # (3, 4) beside two zeros: 5, not the mean over its dimensions.
    assert roughness(torch.tensor([[0.0, 0.0], [3.0, 4.0], [0.0, 0.0]])) == 5


@pytest.mark.parametrize("targets", [(), (5,), (0, 9)])
def test_fewer_than_three_targets_have_no_course_to_leave(targets: tuple[float, ...]):
    assert roughness(torch.tensor(targets, dtype=torch.float32).reshape(-1, 1)) == 0


def test_a_tremor_is_rougher_than_a_faster_movement():
    time = torch.linspace(0, 1, 100)[:, None]
    trembling = time + 0.05 * (60 * time).sin()
    assert roughness(trembling) > 10 * roughness((2 * time).sin())


# Not worse


def is_not_worse(
    new: Quality, old: Quality, typical_length: float, max_quality_drop: float
) -> bool:
    return compare(new, old, typical_length) >= 1 - max_quality_drop


def test_an_equal_sequence_may_take_the_place_even_where_nothing_may_be_worse():
    assert is_not_worse(GOOD, GOOD, typical_length=100, max_quality_drop=0)


@pytest.mark.parametrize(
    ("new", "expected"),
    [
        (GOOD._replace(fit=0.73), True),  # .73 / .9 = .811
        (GOOD._replace(fit=0.71), False),  # .789
        (GOOD._replace(roughness=0.012), True),  # .01 / .012 = .833
        (GOOD._replace(roughness=0.013), False),  # .769
        (GOOD._replace(length=120), True),  # 100 / 120 = .833
        (GOOD._replace(length=130), False),  # .769
        (GOOD._replace(length=82), True),  # .82
        (GOOD._replace(length=78), False),  # .78
    ],
)
def test_each_ratio_alone_decides_at_what_may_be_worse(new: Quality, expected: bool):
    assert is_not_worse(new, GOOD, typical_length=100, max_quality_drop=0.2) == expected


def test_three_small_faults_add_up():
    # Each ratio is .9, their product .729.
    new = Quality(fit=0.81, roughness=0.01 / 0.9, length=90)
    assert not is_not_worse(new, GOOD, typical_length=100, max_quality_drop=0.2)
    assert is_not_worse(new, GOOD, typical_length=100, max_quality_drop=0.3)


def test_a_length_counts_by_how_near_it_is_to_the_typical_one():
    # From 100, 50 is as far as 200; 60 is nearer.
    half, double, nearer = (GOOD._replace(length=length) for length in (50, 200, 60))
    assert is_not_worse(half, double, typical_length=100, max_quality_drop=0)
    assert is_not_worse(double, half, typical_length=100, max_quality_drop=0)
    assert is_not_worse(nearer, double, typical_length=100, max_quality_drop=0)
    assert not is_not_worse(double, nearer, typical_length=100, max_quality_drop=0)


def test_fewer_than_three_targets_are_not_compared_for_roughness():
    two, three = Quality(0.9, 0.0, 2), Quality(0.9, 0.5, 3)
    assert is_not_worse(three, two, typical_length=3, max_quality_drop=0)
    assert is_not_worse(two, three, typical_length=2, max_quality_drop=0)


def test_below_what_can_be_told_smoother_is_not_better():
    smooth, smoother = GOOD._replace(roughness=1e-7), GOOD._replace(roughness=1e-12)
    assert is_not_worse(smooth, smoother, typical_length=100, max_quality_drop=0)


def test_frozen_tracking_does_not_buy_off_a_bad_fit_or_a_stub():
    # What stands still is perfectly smooth, which must not outweigh everything else.
    for frozen in (GOOD._replace(roughness=0.0, length=10), Quality(0.5, 0.0, 100)):
        assert not is_not_worse(frozen, GOOD, typical_length=100, max_quality_drop=0.2)


# Which one a node keeps

COURSE = torch.linspace(0, 1, 12)
TREMOR = COURSE + 0.1 * torch.tensor([1.0, -1.0]).repeat(6)
SPOILED = {
    "trembling": (TREMOR, 0.9),
    "broken off": (COURSE[:2], 0.9),
    "badly fitting": (COURSE, 0.5),
}


def make_schemas(**fields: object) -> CompetingSchemas:
    schemas = CompetingSchemas(CompetingSchemasConfig(2, percept_dimensions=1, **fields))
    schemas.add_node()
    return schemas


def show(schemas: CompetingSchemas, episode: int, targets: torch.Tensor, activation: float) -> None:
    """An episode at node 0; beside each target stands the episode, to tell whose it is.

    The cues are alike for all, so that all count as one schema.
    """
    schemas.begin(episode, "")
    for target in targets:
        marked = torch.stack([target, torch.tensor(float(episode))])
        schemas.write(0, marked, torch.zeros(1), activation=activation, habituated=True)


def kept(schemas: CompetingSchemas) -> list[int]:
    """Episodes whose sequences the node keeps, when all are over."""
    schemas.begin(10**6, "")
    return [int(schemas.targets(schema)[0, 1]) for schema in schemas.schemas_of(0).tolist()]


def test_of_equal_ones_the_newest_stays():
    schemas = make_schemas()
    for episode in range(3):
        show(schemas, episode, COURSE, 0.9)
    assert kept(schemas) == [2]
    assert schemas.blocks.live("support").tolist() == [3]


@pytest.mark.parametrize("kind", SPOILED)
@pytest.mark.parametrize("place", range(4))
def test_a_spoiled_sequence_does_not_stay_wherever_among_good_ones_it_came(kind: str, place: int):
    schemas = make_schemas()
    order = [False] * 3
    order.insert(place, True)
    for episode, spoiled in enumerate(order):
        targets, activation = SPOILED[kind] if spoiled else (COURSE, 0.9)
        show(schemas, episode, targets, activation)
    last_good = 3 if place < 3 else 2
    assert kept(schemas) == [last_good]
    assert schemas.blocks.live("support").tolist() == [4]  # it counts all the same


@pytest.mark.parametrize(("activation", "renewed"), [(0.54, True), (0.36, False)])
def test_a_sequence_that_is_far_worse_stays_out_where_its_episode_renews_others(
    activation: float, renewed: bool
):
    """The second node fits 0.6 or 0.4 times as well; 0.5 times is far worse."""
    schemas = make_schemas()
    schemas.add_node()
    for episode in range(2):
        show(schemas, episode, torch.zeros(40), 0.9)
        for _ in range(4):
            schemas.write(
                1,
                torch.tensor([0.0, episode]),
                torch.tensor([5.0]),
                activation=activation if episode == 1 else 0.9,
                habituated=True,
            )
    # The episode as a whole is good enough: (0.4 ^ 4) ^ (1 / 44) = 0.92, at least 0.75.
    schemas.begin(2, "")
    one, other = (schemas.schemas_of(node).tolist() for node in (0, 1))
    assert schemas.blocks.live("support")[one + other].tolist() == [2, 2]
    assert schemas.targets(one[0])[0, 1].item() == 1
    assert schemas.targets(other[0])[0, 1].item() == (1 if renewed else 0)


@pytest.mark.parametrize("stretch", [0.1, 10.0])
def test_far_too_long_or_short_does_not_stay_among_good_ones(stretch: float):
    for place in (0, 1, 2, 3):
        schemas = make_schemas()
        lengths = [20, 20, 20]
        lengths.insert(place, int(20 * stretch))
        for episode, length in enumerate(lengths):
            show(schemas, episode, torch.linspace(0, 1, length), 0.9)
        assert kept(schemas) == [3 if place < 3 else 2], place


def test_the_typical_length_is_the_geometric_mean_of_all_that_were_seen():
    schemas, means = make_schemas(), []
    for episode, length in enumerate((4, 16, 1)):
        show(schemas, 2 * episode, torch.zeros(length), 0.9)
        schemas.begin(2 * episode + 1, "")
        means += schemas.blocks.live("typical_length").tolist()
    # 4; the root of 4 · 16; the cube root of 4 · 16 · 1.
    assert means == pytest.approx([4, 8, 4])
    assert schemas.blocks.live("support").tolist() == [3]


def test_the_fit_is_the_mean_activation():
    schemas = make_schemas()
    schemas.begin(0, "")
    for activation in (0.5, 0.75, 1.0, 0.75):
        schemas.write(0, torch.ones(2), torch.zeros(1), activation=activation, habituated=True)
    assert schemas.blocks.live("fit").tolist() == [0.75]


@pytest.mark.parametrize("seed", range(3))
def test_the_match_is_the_most_alike_of_all_by_brute_force(seed: int):
    generator = torch.Generator().manual_seed(seed)
    fields = {"schemas_per_node": 50, "lookahead_samples": 2, "same_schema_similarity": 0.8}
    schemas = make_schemas(**fields)
    schemas.add_node()
    found = 0
    for episode in range(12):
        schemas.begin(episode, "")
        for _ in range(4):
            node, near = torch.randint(2, (2,), generator=generator).tolist()
            for cue in 0.2 * torch.randn(4, 1, generator=generator) + near:
                schemas.write(node, torch.zeros(2), cue, activation=0.9, habituated=True)
            away = 0.2 * torch.randn(1, generator=generator)
            for _ in range(3):
                schemas.write(node, torch.zeros(2), away, activation=0.9, habituated=False)
        known = _Comparison(schemas)
        for new in known.new:
            alike = match_by_hand(schemas, new)
            assert known.match(new, set()) == alike
            found += alike is not None
    assert 5 < found < 43


def match_by_hand(schemas: CompetingSchemas, new: int) -> int | None:
    """Each cue of the shorter sequence against each of the longer, one-dimensional."""
    node, support, after = (
        schemas.blocks.live(name).flatten().tolist() for name in ("node", "support", "continuation")
    )
    distances = {}
    for old in range(len(node)):
        if node[old] != node[new] or support[old] == OPEN:
            continue
        one, other = (schemas.cues(number).flatten().tolist() for number in (new, old))
        shorter, longer = sorted((one, other), key=len)
        nearest = [min(abs(cue - far) for far in longer) for cue in shorter]
        distances[old] = max(sum(nearest) / len(nearest), abs(after[new] - after[old]))
    match = min(distances, key=lambda old: distances[old], default=None)
    return match if match is not None and distances[match] <= -math.log(0.8) else None

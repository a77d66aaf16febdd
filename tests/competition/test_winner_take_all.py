"""Who wins a competition, rule by rule."""

import math
from dataclasses import asdict

import pytest
import torch

from pacnet.competition.winner_take_all import NO_SCHEMA, Competition, CompetitionConfig


def competition(threshold: float = 0.0, margin: float = 0.0) -> Competition:
    return Competition(CompetitionConfig(threshold, margin))


def test_the_most_confident_wins_and_of_equal_ones_the_lowest_number():
    confidences = torch.tensor([[0.1, 0.7, 0.3], [0.5, 0.2, 0.5], [0.0, 0.0, 0.0]])
    assert competition()(confidences).tolist() == [1, 0, 0]


def test_under_the_threshold_nobody_competes_and_at_it_one_does():
    confidences = torch.tensor([[0.5, 0.25], [0.25, 0.4375]])
    assert competition(threshold=0.5)(confidences).tolist() == [0, NO_SCHEMA]


@pytest.mark.parametrize("margin", [0.0, 0.5])
def test_of_no_schemas_nobody_wins(margin):
    rivals = competition(margin=margin)
    none = torch.tensor([NO_SCHEMA, NO_SCHEMA])
    assert rivals(torch.zeros(2, 0), none).tolist() == [NO_SCHEMA, NO_SCHEMA]
    assert rivals.over_time(torch.zeros(2, 0)).tolist() == [NO_SCHEMA, NO_SCHEMA]


@pytest.mark.parametrize(
    ("confidences", "incumbent", "winner", "why"),
    [
        ([0.5, 0.625], 0, 0, "0.125 more is not enough"),
        ([0.5, 0.75], 0, 0, "0.25 more is not more than 0.25"),
        ([0.5, 0.875], 0, 1, "0.375 more is"),
        ([0.25, 0.5], 0, 0, "at the threshold the incumbent competes"),
        ([0.125, 0.25], 0, 1, "the incumbent no longer competes"),
        ([0.125, 0.1875], 0, NO_SCHEMA, "none does"),
        ([0.5, 0.625], NO_SCHEMA, 1, "no incumbent"),
        ([0.75, 0.75], 1, 1, "a tie is the incumbent's"),
    ],
)
def test_hysteresis_by_hand(confidences, incumbent, winner, why):
    rivals = competition(threshold=0.25, margin=0.25)
    won = rivals(torch.tensor([confidences]), torch.tensor([incumbent]))
    assert won.tolist() == [winner], why


def test_without_a_margin_incumbents_count_for_nothing():
    confidences = torch.tensor([[0.5, 0.5], [0.25, 0.5]])
    assert competition()(confidences, torch.tensor([1, 0])).tolist() == [0, 1]


def test_over_time_each_winner_is_the_next_ones_incumbent():
    confidences = torch.tensor(
        # 0 leads; 1 is ahead by 0.125, then by 0.25, then by 0.375; then 0 by 0.125; none; 0
        [[0.75, 0.5], [0.5, 0.625], [0.5, 0.75], [0.5, 0.875], [0.625, 0.5], [0.0, 0.0], [0.5, 0.5]]
    )
    rivals = competition(threshold=0.25, margin=0.25)
    assert rivals.over_time(confidences).tolist() == [0, 0, 0, 1, 1, NO_SCHEMA, 0]
    assert rivals.over_time(confidences[4:], incumbent=1).tolist() == [1, NO_SCHEMA, 0]
    assert competition(0.25).over_time(confidences).tolist() == [0, 1, 1, 1, 0, NO_SCHEMA, 0]


@pytest.mark.parametrize("margin", [0.0, 0.125])
def test_a_batch_is_independent_competitions(margin):
    generator = torch.Generator().manual_seed(0)
    confidences = torch.randint(0, 9, (200, 4), generator=generator) / 8  # with ties
    incumbents = torch.randint(NO_SCHEMA, 4, (200,), generator=generator)
    rivals = competition(0.375, margin)
    one_by_one = [
        rivals(confidences[row : row + 1], incumbents[row : row + 1]).item() for row in range(200)
    ]
    assert rivals(confidences, incumbents).tolist() == one_by_one
    assert len(set(one_by_one)) == 5


@pytest.mark.parametrize("threshold", [0.1, 0.375])
@pytest.mark.parametrize("margin", [0.0, 0.1, 0.125])
def test_the_winner_of_one_is_that_of_a_batch(margin, threshold):
    generator = torch.Generator().manual_seed(0)
    eighths = torch.randint(0, 9, (200, 4), generator=generator) / 8  # with ties
    tenths = torch.randint(0, 11, (200, 4), generator=generator) / 10  # and with rounding
    incumbents = torch.randint(NO_SCHEMA, 4, (200,), generator=generator)
    rivals = competition(threshold, margin)
    for confidences in (eighths, tenths, tenths.double()):
        pairs = zip(confidences, incumbents.tolist(), strict=True)
        winners = [rivals.winner(row.numpy(), incumbent) for row, incumbent in pairs]
        assert rivals(confidences, incumbents).tolist() == winners


@pytest.mark.parametrize("margin", [0.0, 0.125])
def test_time_can_be_cut_anywhere(margin):
    confidences = torch.rand(60, 3, generator=torch.Generator().manual_seed(1))
    rivals = competition(0.5, margin)
    whole = rivals.over_time(confidences)
    first = rivals.over_time(confidences[:23])
    rest = rivals.over_time(confidences[23:], incumbent=int(first[-1]))
    assert torch.equal(torch.cat([first, rest]), whole)


@pytest.mark.parametrize(
    ("confidences", "message"),
    [
        ([[0.5]], r"expected confidences as .*got list"),
        (torch.zeros(3), r"expected confidences as .*got shape \[3\]"),
        (torch.zeros(2, 2, dtype=torch.int64), r"got dtype torch.int64"),
        (torch.zeros(0, 2), "got an empty one"),
        (torch.tensor([[0.5, math.nan]]), "expected finite confidences, got .* in row 0"),
        (torch.tensor([[0.5], [math.inf]]), "expected finite confidences, got .* in row 1"),
    ],
)
def test_bad_confidences_are_refused(confidences, message):
    for ask in (competition(), competition().over_time):
        with pytest.raises(ValueError, match=message):
            ask(confidences)


@pytest.mark.parametrize(
    ("incumbents", "message"),
    [
        ([0, 0], "expected incumbents as .*got list"),
        (torch.zeros(2), r"got torch.float32 of shape \[2\]"),
        (torch.zeros(3, dtype=torch.int64), r"of shape \[2\] on cpu, got torch.int64 .* \[3\]"),
        (torch.tensor([0, 2]), r"expected incumbents from -1 to 1, got \[0, 2\]"),
        (torch.tensor([-2, 0]), r"expected incumbents from -1 to 1, got \[-2, 0\]"),
    ],
)
def test_bad_incumbents_are_refused(incumbents, message):
    with pytest.raises(ValueError, match=message):
        competition()(torch.zeros(2, 2), incumbents)


def test_a_bad_incumbent_over_time_is_refused():
    with pytest.raises(ValueError, match="expected incumbents from -1 to 1"):
        competition().over_time(torch.zeros(3, 2), incumbent=2)


@pytest.mark.parametrize(
    ("field", "value", "wanted"),
    [
        ("threshold", -0.1, r"in \[0, 1\]"),
        ("threshold", 1.1, r"in \[0, 1\]"),
        ("threshold", math.nan, r"in \[0, 1\]"),
        ("margin", -0.1, "≥ 0 and finite"),
        ("margin", math.inf, "≥ 0 and finite"),
        ("margin", "0", "≥ 0 and finite"),
    ],
)
def test_bad_config_is_refused(field, value, wanted):
    fields = asdict(CompetitionConfig()) | {field: value}
    with pytest.raises(ValueError, match=f"expected CompetitionConfig.{field} {wanted}"):
        CompetitionConfig(**fields)

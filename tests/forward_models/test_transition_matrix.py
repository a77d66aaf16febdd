"""The paper's transition matrix, on three clusters whose counts stand in the comments."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from pacnet.forward_models.config import TransitionMatrixConfig
from pacnet.forward_models.transition_matrix import TransitionMatrix

LEFT, RIGHT = -1.0, 1.0
JITTER = 0.25  # of every second visit to a place; the centroids come out in between

# From place, by action: to places, one for each transition. Nothing was ever tried at 20 but LEFT.
WALKS = {
    (0.0, LEFT): (0.0, 0.0),
    (0.0, RIGHT): (0.0, 10.0, 10.0, 20.0),
    (10.0, LEFT): (0.0, 0.0),
    (10.0, RIGHT): (20.0, 20.0),
    (20.0, LEFT): (10.0, 20.0),
}


def transitions() -> tuple[Tensor, Tensor, Tensor]:
    """[T, 1] each; the second of two equal walks starts a jitter aside of the first."""
    rows = [
        (place + JITTER * (number % 2), action, end)
        for (place, action), ends in WALKS.items()
        for number, end in enumerate(ends)
    ]
    states, actions, ends = torch.tensor(rows).T[:, :, None]
    return states, actions, ends


def matrix(steps: int = 1, abstain_below: float = 0.03) -> TransitionMatrix:
    config = TransitionMatrixConfig(
        1, 1, ((LEFT,), (RIGHT,)), clusters=3, steps=steps, abstain_below=abstain_below
    )
    model = TransitionMatrix(config)
    model.fit(*transitions(), seed=0)
    return model


MIDDLE = JITTER / 2  # what half of the visits, a jitter aside, add to each centroid


def order(model: TransitionMatrix) -> list[int]:
    """Numbers of the clusters at 0, 10 and 20."""
    return model(torch.tensor([[0.0], [10.0], [20.0]])).tolist()


def test_centroids_and_counts():
    model = matrix()
    places = order(model)
    expected = [MIDDLE, 10 + MIDDLE, 20 + MIDDLE]
    assert model.centroids[places, 0].tolist() == expected
    # From 0, 10, 20 (rows) to 0, 10, 20 (columns), as in WALKS.
    left, right = (model.counts[places][:, action][:, places].tolist() for action in (0, 1))
    assert left == [[2, 0, 0], [2, 0, 0], [0, 1, 1]]
    assert right == [[1, 2, 1], [0, 0, 2], [0, 0, 0]]


def test_the_report_by_hand():
    report = TransitionMatrix(matrix().config).fit(*transitions(), seed=0)
    assert report.distortion == JITTER / 2  # every state is that far from its centroid
    assert report.tried == 5 / 6
    assert report.iterations >= 1


def test_the_expected_state_decides():
    # From 0 LEFT stays, RIGHT is expected at (0 + 2 · 10 + 20) / 4 = 10; so 6 is nearer to 10,
    # although cluster 0 is entered by LEFT with certainty.
    model = matrix()
    selection = model.select(torch.tensor([0.5]), torch.tensor([6.0]))
    assert selection.costs.tolist() == pytest.approx([6 - MIDDLE, 4 + MIDDLE])
    assert (selection.index, selection.action.tolist()) == (1, [RIGHT])
    assert selection.spread == pytest.approx(5.0)  # 0 and 10 lie 5 from their mean
    assert not selection.abstained
    command = model.command(torch.tensor([[0.5], [9.0]]), torch.tensor([[4.0], [12.0]]))
    assert command.has_action.tolist() == [True, True]
    assert command.action.tolist() == [[LEFT], [RIGHT]]


def test_what_was_never_tried_is_not_chosen_and_one_action_is_no_choice():
    model = matrix(abstain_below=0.0)
    selection = model.select(torch.tensor([21.0]), torch.tensor([30.0]))
    # LEFT from 20 is expected at 15, RIGHT is unknown.
    assert selection.costs.tolist() == pytest.approx([15 - MIDDLE, math.inf])
    assert (selection.index, selection.spread, selection.abstained) == (0, 0.0, True)
    command = model.command(torch.tensor([[21.0], [0.0]]), torch.tensor([[30.0], [0.0]]))
    assert command.has_action.tolist() == [False, True]
    assert command.action.isnan().tolist() == [[True], [False]]
    predicted = model.predict(torch.tensor([[21.0], [21.0]]), torch.tensor([[LEFT], [RIGHT]]))
    assert predicted.flatten().tolist() == pytest.approx([15 + MIDDLE, math.nan], nan_ok=True)


@pytest.mark.parametrize(("threshold", "has_action"), [(5.0, True), (5.001, False)])
def test_it_abstains_exactly_when_the_spread_is_below_the_threshold(threshold, has_action):
    # From 0 they are expected at 0 and 10, plus the same eighth: a spread of 5, exact in binary.
    command = matrix(abstain_below=threshold).command(torch.zeros(1, 1), torch.zeros(1, 1))
    assert command.has_action.tolist() == [has_action]


def test_other_candidates_count_as_the_nearest_of_the_configs():
    state, target = torch.tensor([10.0]), torch.tensor([19.0])
    plain = matrix().select(state, target)
    offered = torch.tensor([[7.0], [0.25], [-0.25], [-9.0]])  # RIGHT, RIGHT, LEFT, LEFT
    selection = matrix().select(state, target, offered)
    left, right = plain.costs.tolist()
    assert selection.costs.tolist() == [right, right, left, left]
    assert (selection.index, selection.action.tolist()) == (0, [7.0])  # the caller's own action
    assert matrix().select(state, target, offered.flip(0)).index == 2


def test_actions_are_counted_as_the_nearest_candidate():
    states, actions, ends = transitions()
    model = TransitionMatrix(matrix().config)
    model.fit(states, actions * torch.linspace(0.1, 5, len(actions))[:, None], ends, seed=0)
    assert torch.equal(model.counts, matrix().counts)


def test_an_action_held_for_two_steps():
    # RIGHT twice. From 0: a quarter stays at 0 and is expected at 10 once more; half was at 10 and
    # goes to 20; a quarter was at 20, where RIGHT is unknown, and stays: 2.5 + 10 + 5 = 17.5.
    # From 10: to 20, and stays. LEFT twice from 20: half to 10 and then 0, half 15: 7.5.
    model = matrix(steps=2)
    states = torch.tensor([[0.0], [10.0], [20.0]])
    predicted = model.predict(states, torch.tensor([[RIGHT], [RIGHT], [LEFT]]))
    assert (predicted - MIDDLE).flatten().tolist() == pytest.approx([17.5, 20.0, 7.5])
    outcomes = model.outcomes(states, model.candidates)
    assert outcomes.isnan()[..., 0].tolist() == [[False, False], [False, False], [False, True]]
    assert outcomes[:2, 1].tolist() == predicted[:2].tolist()


def test_more_steps_are_powers_of_the_matrix():
    generator = torch.Generator().manual_seed(0)
    config = TransitionMatrixConfig(2, 1, ((LEFT,), (RIGHT,)), clusters=4, steps=5)
    model = TransitionMatrix(config).double()
    model.centroids.copy_(torch.rand(4, 2, generator=generator))
    model.counts.copy_(torch.randint(1, 9, (4, 2, 4), generator=generator))
    counts = model.counts.numpy()
    for action in range(2):
        chances = counts[:, action] / counts[:, action].sum(axis=1, keepdims=True)
        expected = np.linalg.matrix_power(chances, 5) @ model.centroids.numpy()
        after = model.predict(model.centroids, model.candidates[[action] * 4])
        np.testing.assert_allclose(after.numpy(), expected, rtol=1e-12)


def test_before_a_fit_it_abstains_everywhere():
    model = TransitionMatrix(TransitionMatrixConfig(2, 1, ((LEFT,), (RIGHT,)), abstain_below=0.0))
    selection = model.select(torch.zeros(2), torch.zeros(2))
    assert selection.costs.tolist() == [math.inf, math.inf]
    assert (selection.index, selection.abstained) == (0, True)
    assert not model.command(torch.zeros(3, 2), torch.zeros(3, 2)).has_action.any()


def test_the_seed_decides_every_draw():
    generator = torch.Generator().manual_seed(0)
    states, ends = (torch.rand(300, 3, generator=generator) for _ in range(2))
    actions = torch.rand(300, 1, generator=generator) * 2 - 1
    found = []
    for seed in (1, 1, 2):
        model = TransitionMatrix(TransitionMatrixConfig(3, 1, ((LEFT,), (RIGHT,)), clusters=20))
        torch.manual_seed(len(found))  # the global generator has no say
        model.fit(states, actions, ends, seed=seed)
        assert int(model.counts.sum()) == 300
        found.append(model)
    assert torch.equal(found[0].centroids, found[1].centroids)
    assert torch.equal(found[0].counts, found[1].counts)
    assert not torch.equal(found[0].centroids, found[2].centroids)


def test_it_needs_as_many_different_states_as_clusters():
    model = matrix()
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    states = torch.tensor([[0.0], [0.0], [1.0]])
    with pytest.raises(ValueError, match=r"different states as clusters, 3, got 2"):
        model.fit(states, torch.zeros(3, 1), states, seed=0)
    with pytest.raises(ValueError, match="expected equally many rows"):
        model.fit(torch.zeros(3, 1), torch.zeros(2, 1), torch.zeros(3, 1), seed=0)
    for name, tensor in model.state_dict().items():
        assert torch.equal(tensor, before[name])
    model.fit(torch.tensor([[0.0], [5.0], [1.0]]), torch.zeros(3, 1), torch.zeros(3, 1), seed=0)


def test_a_saved_matrix_comes_back_whole(tmp_path):
    model = matrix(steps=2)
    model.save_pretrained(tmp_path)
    loaded = TransitionMatrix.from_pretrained(tmp_path)
    assert loaded.config == model.config
    assert torch.equal(loaded.counts, model.counts)
    assert torch.equal(loaded.centroids, model.centroids)


def test_negative_counts_are_refused(tmp_path):
    model = matrix()
    model.counts[0, 0, 0] = -1
    model.save_pretrained(tmp_path)
    with pytest.raises(ValueError, match="expected counts ≥ 0, got -1"):
        TransitionMatrix.from_pretrained(tmp_path)

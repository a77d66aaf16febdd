"""Parts of a fit: blocks held out, normalisation, explained share of the change."""

import pytest
import torch

from pacnet.forward_models.fitting import BLOCK, mean_and_std, r2_of_change, split_by_blocks


def test_r2_of_the_change_by_hand():
    changes = torch.tensor([[1.0, 2.0, 0.0, 3.0], [-3.0, 2.0, 0.0, 1.0]])
    predicted = torch.tensor([[0.0, 2.0, 0.5, 2.0], [0.0, 2.0, 0.5, 2.0]])
    # Nothing predicted; all predicted; nothing to predict; 1 − (1 + 1) / (9 + 1).
    assert r2_of_change(changes, predicted).tolist() == pytest.approx([0.0, 1.0, 0.0, 0.8])


def test_whole_blocks_are_held_out():
    for rows in (100, 130, 1020):
        learning, held_out = split_by_blocks(rows, torch.Generator().manual_seed(rows))
        assert torch.equal(torch.cat([learning, held_out]).sort().values, torch.arange(rows))
        blocks = (held_out // BLOCK).clamp(max=rows // BLOCK - 1).tolist()
        sizes = {block: blocks.count(block) for block in set(blocks)}
        assert len(sizes) == max(1, round(0.2 * (rows // BLOCK)))
        last = rows // BLOCK - 1
        whole = {block: BLOCK + (rows % BLOCK if block == last else 0) for block in sizes}
        assert sizes == whole


def test_a_constant_dimension_has_unit_std_even_if_its_mean_is_rounded():
    mean, std = mean_and_std(torch.full((7, 1), 0.1, dtype=torch.float64))
    assert mean.item() == pytest.approx(0.1)
    assert std.item() == 1.0

"""Fitting a small network to transitions: rows held out by blocks, minibatches, early stopping."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

from pacnet.core.validation import check_rows
from pacnet.forward_models.candidates import check_equally_many

BLOCK = 50
"""Successive transitions that are held out together: neighbours in time are nearly copies."""
HELD_OUT = 0.2
"""Share of the blocks that is held out."""
MAX_EPOCHS = 200
PATIENCE = 20
"""Epochs without a lower validation loss after which the fit ends."""
_BATCH = 256  # smaller ones cost nearly as much each on a CPU
_LEARNING_RATE = 1e-2
_HALVED_AFTER = 10  # epochs without a lower validation loss; then the learning rate is halved
_WEIGHT_DECAY = 0.1

Progress = Callable[[int, float, float], None]
"""Called after each epoch with its number (from 1), training loss and validation loss."""


class FitReport(NamedTuple):
    """How a fit went. Losses are mean squared errors of the normalised change."""

    epochs: int
    """How many were run; the weights are those of the one with the lowest validation loss."""
    train_loss: float
    """Of that epoch: the mean over its minibatches."""
    validation_loss: float
    """Of that epoch, on the rows held out."""
    validation_rows: Tensor
    """Numbers of the rows held out, int64 `[V]`, rising."""
    r2: Tensor
    """Share of the change explained on those rows, float64 `[S]`; see `r2_of_change`."""


class Trained(NamedTuple):
    """What `train` found; the network has the weights of the best epoch."""

    epochs: int
    train_loss: float
    validation_loss: float


def check_transitions(
    states: Tensor, actions: Tensor, next_states: Tensor, columns: tuple[int, int], like: Tensor
) -> None:
    """Checks transitions [T, S], [T, U], [T, S].

    Args:
        states: before.
        actions: taken.
        next_states: after.
        columns: S and U.
        like: a tensor of the expected dtype and device.

    Raises:
        ValueError: wrong shape, dtype or device, not finite, or of unequal length.
    """
    check_rows("states", states, columns[0], like)
    check_rows("actions", actions, columns[1], like)
    check_rows("next_states", next_states, columns[0], like)
    check_equally_many(states=states, actions=actions, next_states=next_states)


def split_by_blocks(rows: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Draws the blocks to hold out; what is left over after the last whole block belongs to it.

    Returns:
        The numbers of the rows to learn from and of those held out, both rising.

    Raises:
        ValueError: fewer rows than two blocks.
    """
    blocks = rows // BLOCK
    if blocks < 2:
        raise ValueError(
            f"expected at least {2 * BLOCK} transitions, two blocks of {BLOCK}, got {rows}"
        )
    drawn = torch.randperm(blocks, generator=generator)[: max(1, round(HELD_OUT * blocks))]
    block = (torch.arange(rows) // BLOCK).clamp(max=blocks - 1)  # of each row
    held_out = torch.isin(block, drawn)
    return (~held_out).nonzero().flatten(), held_out.nonzero().flatten()


def mean_and_std(rows: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation of each column, in float64; 1 for one that does not vary."""
    rows = rows.double()
    mean = rows.mean(dim=0)
    std = (rows - mean).square().mean(dim=0).sqrt()
    constant = rows.amin(dim=0) == rows.amax(dim=0)
    return mean, std.masked_fill(constant, 1.0)


def r2_of_change(changes: Tensor, predicted: Tensor) -> Tensor:
    """Share of the change that a prediction explains: 1 − Σ(change − predicted)² / Σ change².

    So predicting that nothing changes (persistence) has 0 by definition, a worse prediction less.
    A dimension that does not change at all counts as 0.

    Args:
        changes: `[T, S]`.
        predicted: `[T, S]`.

    Returns:
        For each dimension, float64 `[S]`.
    """
    changes, predicted = changes.double(), predicted.double()
    error = (changes - predicted).square().sum(dim=0)
    total = changes.square().sum(dim=0)
    return torch.where(total > 0, 1 - error / total, 0.0)


def train(
    network: nn.Module,
    learning: tuple[Tensor, Tensor],
    held_out: tuple[Tensor, Tensor],
    generator: torch.Generator,
    progress: Progress | None,
) -> Trained:
    """Fits the network by AdamW on the mean squared error and keeps the best epoch's weights.

    Args:
        network: changed in place; half trained if an exception comes in between.
        learning: inputs and outputs to learn from.
        held_out: inputs and outputs that decide when to stop.
        generator: draws the minibatches.
        progress: see `Progress`.
    """
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=_LEARNING_RATE, weight_decay=_WEIGHT_DECAY, fused=True
    )
    epoch, best, best_weights = 0, Trained(0, torch.inf, torch.inf), _copy(network)
    while epoch < MAX_EPOCHS and epoch - best.epochs < PATIENCE:
        epoch += 1
        train_loss = _one_epoch(network, optimiser, learning, generator)
        with torch.no_grad():
            validation_loss = float(_loss(network, *held_out))
        if validation_loss < best.validation_loss:
            best, best_weights = Trained(epoch, train_loss, validation_loss), _copy(network)
        elif epoch - best.epochs == _HALVED_AFTER:
            optimiser.param_groups[0]["lr"] /= 2
        if progress is not None:
            progress(epoch, train_loss, validation_loss)
    if best.epochs == 0 < epoch:
        raise ValueError("expected transitions to learn from, got a loss that is never finite")
    network.load_state_dict(best_weights)
    return best._replace(epochs=epoch)


def _one_epoch(
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    learning: tuple[Tensor, Tensor],
    generator: torch.Generator,
) -> float:
    inputs, outputs = learning
    total = torch.zeros(())
    for rows in torch.randperm(len(inputs), generator=generator).split(_BATCH):
        loss = _loss(network, inputs[rows], outputs[rows])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        total += loss.detach() * len(rows)
    return float(total) / len(inputs)


def _loss(network: nn.Module, inputs: Tensor, outputs: Tensor) -> Tensor:
    return (network(inputs) - outputs).square().mean()


def _copy(network: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in network.state_dict().items()}

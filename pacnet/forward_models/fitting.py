"""Fitting a small network to transitions: rows held out by blocks, minibatches, early stopping."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

BLOCK = 50
"""Successive transitions that are held out together, because neighbours in time are alike."""
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
    """Number of epochs; the weights are those of the one with the lowest validation loss."""
    train_loss: float
    """Mean over the minibatches of that epoch."""
    validation_loss: float
    """Loss on the held-out rows after that epoch."""
    validation_rows: Tensor
    """Indices of the held-out rows, int64 `[V]`, ascending."""
    r2: Tensor
    """Share of the change explained on those rows, float64 `[S]`; see `r2_of_change`."""


def split_by_blocks(rows: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Draw the blocks to hold out; rows after the last whole block belong to that block.

    Returns:
        The indices of the rows to learn from and of the held-out rows, both ascending.

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
    """Return mean and standard deviation of each column, float64; std 1 of a constant column."""
    rows = rows.double()
    mean = rows.mean(dim=0)
    std = (rows - mean).square().mean(dim=0).sqrt()
    constant = rows.amin(dim=0) == rows.amax(dim=0)
    return mean, std.masked_fill(constant, 1.0)


def r2_of_change(changes: Tensor, predicted: Tensor) -> Tensor:
    """Return 1 − Σ(change − predicted)² / Σ change² of each dimension, float64 `[S]`.

    It is the share of the changes `[T, S]` that is explained: 0 for a prediction of no change,
    negative for a worse one. A dimension that never changes scores 0.
    """
    changes, predicted = changes.double(), predicted.double()
    error = (changes - predicted).square().sum(dim=0)
    total = changes.square().sum(dim=0)
    return torch.where(total > 0, 1 - error / total, 0.0)


def train(
    network: nn.Module,
    samples: tuple[Tensor, Tensor],
    split: tuple[Tensor, Tensor],
    generator: torch.Generator,
    progress: Progress | None,
) -> tuple[int, float, float]:
    """Minimise the mean squared error by AdamW; give the network the weights of the best epoch.

    Args:
        network: changed in place, also if an exception interrupts the training.
        samples: inputs and outputs.
        split: indices of the training samples and of the validation samples.
        generator: for the minibatches.
        progress: called after each epoch.

    Returns:
        The number of epochs, and the training and validation loss of the best one.

    Raises:
        ValueError: the validation loss is never finite.
    """
    learning, held_out = ([rows[indices] for rows in samples] for indices in split)
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=_LEARNING_RATE, weight_decay=_WEIGHT_DECAY, fused=True
    )
    epoch = best_epoch = 0
    losses, weights = (torch.inf, torch.inf), _copy_weights(network)
    while epoch < MAX_EPOCHS and epoch - best_epoch < PATIENCE:
        epoch += 1
        train_loss = _train_epoch(network, optimiser, learning, generator)
        with torch.no_grad():
            validation_loss = float(_loss(network, *held_out))
        if validation_loss < losses[1]:
            best_epoch, losses = epoch, (train_loss, validation_loss)
            weights = _copy_weights(network)
        elif epoch - best_epoch == _HALVED_AFTER:
            optimiser.param_groups[0]["lr"] /= 2
        if progress is not None:
            progress(epoch, train_loss, validation_loss)
    if best_epoch == 0 < epoch:
        raise ValueError("expected transitions to learn from, got a loss that is never finite")
    network.load_state_dict(weights)
    return epoch, *losses


def _train_epoch(
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    samples: list[Tensor],
    generator: torch.Generator,
) -> float:
    """Return the mean loss over the minibatches."""
    inputs, outputs = samples
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


def _copy_weights(network: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in network.state_dict().items()}

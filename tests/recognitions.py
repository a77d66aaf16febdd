"""Recognitions written by hand, for the tests of whatever scores or draws one."""

import torch

from pacnet.competition.recognition import Recognition


def make_recognition(named: list[int], progress: list[float], novelty: list[float]) -> Recognition:
    """A recognition of two behaviours, written by hand; the named one has a probability of 0.8."""
    behaviour, samples = torch.tensor(named), len(named)
    probability = torch.full((samples, 2), 0.2)
    probability[torch.arange(samples), behaviour] = 0.8
    return Recognition(
        probability=probability,
        behaviour=behaviour,
        progress=torch.tensor(progress),
        next_percept=torch.zeros(samples, 3),
        end_percept=torch.ones(samples, 3),
        novelty=torch.tensor(novelty),
        is_novel=torch.tensor(novelty) > 0.5,
        winner=torch.tensor(
            [-1 if value > 0.7 else sample for sample, value in enumerate(novelty)]
        ),
    )

"""One imitator that learns three behaviours, one after the other, in the postural environment."""

from pathlib import Path

import pytest

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator.imitator import Imitator
from train.postural.correction.episodes import USUAL, Situation, attempt
from train.postural.episodes import Condition, make_environment
from train.postural.learning import record

TAUGHT = {"drink": 61, "toast": 1061, "move": 2061}  # behaviour -> seed of its demonstrations


@pytest.mark.slow
def test_the_first_behaviour_still_succeeds_after_two_more(tmp_path: Path):
    """For a sixth of the first behaviour's percepts the nearest node came with another one."""
    for behaviour, seed in TAUGHT.items():
        record(tmp_path / behaviour, seed, 8, behaviour, behaviour)
    datasets = [load_demonstrations(tmp_path / behaviour) for behaviour in TAUGHT]
    imitator = Imitator.from_demonstrations(datasets[0])
    for dataset in datasets:
        imitator.learn(dataset)
    environment = make_environment(Condition())
    tried = [attempt(imitator, environment, Situation(56100 + i, USUAL)) for i in range(4)]
    assert all(one.is_autonomous for one in tried)

"""What the tests of the imitator share: a few demonstrations, and one that has learned them."""

from __future__ import annotations

import pytest
from reaching import reach, shown

from pacnet.datasets.demonstrations import Demonstrations
from pacnet.imitator import Imitator


@pytest.fixture(scope="module")
def demonstrations() -> Demonstrations:
    return shown(*(reach(seed) for seed in range(4)))


@pytest.fixture(scope="module")
def trained(demonstrations: Demonstrations) -> Imitator:
    imitator = Imitator.from_demonstrations(demonstrations)
    imitator.learn(demonstrations)
    return imitator

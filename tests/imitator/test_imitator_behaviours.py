"""One imitator, taught one behaviour after the other, in the scene of both humanoids."""

from pathlib import Path

import pytest

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator.imitator import Imitator
from train.postural.correction.episodes import USUAL, Situation, attempt
from train.postural.episodes import Condition, make_environment
from train.postural.learning import record

TAUGHT = {"drink": 61, "toast": 1061, "move": 2061}  # behaviour -> seed of its demonstrations


@pytest.mark.slow
def test_what_was_learned_first_is_done_after_two_more_behaviours(tmp_path: Path):
    """Nodes that came with the others are nearest to a sixth of what is seen of the first."""
    for behaviour, seed in TAUGHT.items():
        record(tmp_path / behaviour, seed, 8, behaviour, behaviour)
    lessons = [load_demonstrations(tmp_path / behaviour) for behaviour in TAUGHT]
    imitator = Imitator.from_demonstrations(lessons[0])
    for lesson in lessons:
        imitator.learn(lesson)
    environment = make_environment(Condition())
    tried = [attempt(imitator, environment, Situation(56100 + i, USUAL)) for i in range(4)]
    assert all(one.needs_nobody for one in tried)

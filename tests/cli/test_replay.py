"""The reasons for acting and holding."""

from typing import Any

import numpy as np
import pytest

from pacnet.cli.replay import reason_of
from pacnet.imitator import ImitatorStep
from pacnet.imitator.records import Followed

KNOWN = ImitatorStep(
    action=np.zeros(2, np.float32),
    is_novel=False,
    novelty=0.5,
    dimension="elbow",
    deviation=0.1,
    threshold=0.2,
    progress=0.3,
    is_done=False,
    followed=(Followed(0, 7, 1.0),),
    target=np.zeros(2, np.float32),
)


@pytest.mark.parametrize(
    ("changes", "short", "sentence"),
    [
        ({}, "known", "the percept is known"),
        ({"is_novel": True, "action": None}, "novel percept", "the percept is novel in elbow"),
        (
            {"action": None},
            "no action found",
            "the forward model finds no action that leads to the target",
        ),
        (
            {"is_novel": True, "action": None, "followed": (), "target": None},
            "nothing to follow",  # which says more than that all is novel
            "no demonstration is kept that could be followed",
        ),
    ],
)
def test_every_step_has_a_reason(changes: dict[str, Any], short: str, sentence: str):
    assert reason_of(KNOWN._replace(**changes)) == (short, sentence)

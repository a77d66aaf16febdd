"""The reasons for acting and holding."""

from typing import Any

import numpy as np
import pytest

from pacnet.cli.replay import reason_of
from pacnet.imitator import ImitatorStep
from pacnet.network import Decision

KNOWN = Decision(
    target=np.zeros(2),
    has_target=True,
    winner=7,
    activation=0.9,
    is_novel=False,
    offset=0,
    schema=3,
)


@pytest.mark.parametrize(
    ("decision", "changes", "sentence"),
    [
        (KNOWN, {}, "the percept is known and a motor schema is confident"),
        (KNOWN, {"is_novel": True, "action": None}, "the percept is novel in elbow"),
        (
            KNOWN._replace(target=None, is_novel=True),
            {"is_novel": True, "action": None},
            "the percept is novel in elbow",  # which says more than that nothing matches
        ),
        (
            KNOWN._replace(target=None, is_novel=True),
            {"action": None},
            "no node of the map matches the percept",
        ),
        (
            KNOWN._replace(target=None),
            {"action": None},
            "no motor schema of node 7 or near the percept is confident",
        ),
        (KNOWN, {"action": None}, "the forward model finds no action that leads to the target"),
    ],
)
def test_every_decision_has_a_reason(decision: Decision, changes: dict[str, Any], sentence: str):
    step = ImitatorStep(np.zeros(2), False, 0.5, "elbow", 0.1, 0.2, decision)
    assert reason_of(step._replace(**changes)).sentence == sentence

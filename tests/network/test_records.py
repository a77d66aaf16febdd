"""Decisions: their fields also answer under the names of the last release."""

import numpy as np
import pytest

from pacnet import Decision

NEW_BY_OLD = {
    "targets": "target",
    "commanded": "has_target",
    "novelty": "is_novel",
    "position": "offset",
    "given": "has_action",
}


def make_decision() -> Decision:
    return Decision(np.ones(1), True, 3, 0.5, False, 7, 3, np.zeros(2), True)


@pytest.mark.parametrize("old", NEW_BY_OLD)
def test_an_old_field_warns_and_gives_the_new_one(old: str):
    decision = make_decision()
    with pytest.warns(DeprecationWarning, match=f"^{old} is now {NEW_BY_OLD[old]}$"):
        assert getattr(decision, old) is getattr(decision, NEW_BY_OLD[old])


def test_the_recall_of_a_decision_is_the_decision_itself():
    decision = make_decision()
    with pytest.warns(DeprecationWarning, match="is now Decision"):
        assert decision.recall is decision

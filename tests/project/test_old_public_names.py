"""Names that `pacnet` offered in the last release: they work for one more, with a warning."""

import pytest

import pacnet


@pytest.mark.parametrize(
    ("old", "new"), [("NOBODY", "NO_NODE"), ("Recall", "Decision"), ("Action", "Decision")]
)
def test_an_old_name_warns_and_gives_the_new_one(old: str, new: str):
    with pytest.warns(DeprecationWarning, match=f"^pacnet.{old} is now pacnet.{new}$"):
        assert getattr(pacnet, old) is getattr(pacnet, new)
    assert old not in pacnet.__all__

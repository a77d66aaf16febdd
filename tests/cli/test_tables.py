"""Tables."""

import pytest

from pacnet.cli.printing import print_table

TASK = "Pick up the {} cube and place it carefully into the {} box on the far side of the table"


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (["drink", "a\nb\tc", 40 * "d"], ["drink", "a b c", 40 * "d"]),
        ([20 * "a" + 10 * "-" + 20 * "b"], [20 * "a" + "…" + 19 * "b"]),
        (
            [TASK.format("red", "left"), TASK.format("red", "right"), TASK.format("red", "left")],
            [
                "Pick up the red cube and place it…left…",
                "Pick up the red cube and place it…right…",
                "Pick up the red cube and place it…left…",
            ],
        ),
        ([f"{30 * 'a'}{number}{30 * 'b'}" for number in (1, 2)],) * 2,  # not one word to cut at
    ],
)
def test_names_in_tables_are_short_and_distinct(
    names: list[str], shown: list[str], capsys: pytest.CaptureFixture[str]
):
    print_table(("<name",), [(name,) for name in names])
    assert capsys.readouterr().out.splitlines() == ["name", *shown]

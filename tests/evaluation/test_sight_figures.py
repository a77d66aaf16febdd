"""What a camera sees is drawn beside what is remembered, with boxes where they belong."""

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from pacnet.evaluation.sight_figures import Picture, Sighting, beside_remembered

BOXES = ((0.1, 0.2, 0.3, 0.4), (0.5, 0.5, 0.75, 0.9))  # left, top, right, bottom


def sighting(camera: str, is_found: bool = True, height: int = 20) -> Sighting:
    now = np.full((height, 40, 3), 100, np.uint8)
    return Sighting(
        camera,
        Picture(now, BOXES, "now", is_found),
        Picture(now // 2, BOXES[::-1], "remembered"),
        "known",
    )


def boxes(axes) -> list[Rectangle]:
    """Those in colour; each has a black one beneath."""
    return [one for one in axes.patches if to_hex(one.get_edgecolor()) != "#000000"]


def test_boxes_are_where_they_are_said_to_be_in_pixels():
    figure = beside_remembered([sighting("top")], "acts", "to the goal")
    now, remembered = figure.axes
    first, second = boxes(now)
    assert first.get_bbox().extents == pytest.approx((4, 4, 12, 8))  # of 40 x 20 pixels
    assert second.get_bbox().extents == pytest.approx((20, 10, 30, 18))
    assert boxes(remembered)[1].get_bbox().extents == pytest.approx((4, 4, 12, 8))
    assert now.images[0].get_array().max() == 100
    assert remembered.images[0].get_array().max() == 50
    assert now.get_ylim()[0] > now.get_ylim()[1]  # rows go down


def test_the_same_number_has_the_same_colour_in_both_pictures():
    figure = beside_remembered([sighting("top")], "acts", "to the goal")
    now, remembered = ([to_hex(one.get_edgecolor()) for one in boxes(a)] for a in figure.axes)
    assert now == remembered
    assert now[0] != now[1]
    assert [[text.get_text() for text in axes.texts] for axes in figure.axes] == [["1", "2"]] * 2


def test_what_is_not_found_is_dashed_and_asked():
    figure = beside_remembered([sighting("top", is_found=False)], "holds", "nothing is followed")
    now, remembered = figure.axes
    assert [text.get_text() for text in now.texts] == ["1?", "2?"]
    assert all(one.get_linestyle() != "-" for one in boxes(now))
    assert all(one.get_linestyle() == "-" for one in boxes(remembered))


def test_it_says_so_where_nothing_is_remembered():
    one = sighting("top")._replace(remembered=None)
    _, remembered = beside_remembered([one], "acts", "to the goal").axes
    assert remembered.get_title("left") == "no picture is remembered"
    assert not remembered.axison
    assert len(remembered.images) == 0


def test_each_camera_has_a_row_of_its_own_height():
    figure = beside_remembered([sighting("top"), sighting("wrist", height=40)], "acts", "away")
    assert len(figure.axes) == 4
    assert [axes.get_xlabel().split(",")[0] for axes in figure.axes[::2]] == ["top", "wrist"]
    one = beside_remembered([sighting("top")], "acts", "away")
    assert figure.get_figheight() > 2 * one.get_figheight()


def test_no_camera_is_refused():
    with pytest.raises(ValueError, match="expected what one camera sees at least, got none"):
        beside_remembered([], "acts", "away")

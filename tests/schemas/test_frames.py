"""Settings of frames of reference survive JSON, and bad ones are refused."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace

import pytest

from pacnet.attention.cutting import Size
from pacnet.forward_models.config import AffineForwardModelConfig
from pacnet.schemas.frames import FramesConfig
from pacnet.schemas.points import Point, Points

CONFIG = FramesConfig(
    Points(Point("hand", (0, 1, 2), (3,)), (Point("cup", (4, 5, 6)), Point("plate", (7, 8, 9)))),
    Size(0.5, 0.01),
    ((1.0, 1.0), (0.5, 0.2), (0.0, 0.0)),
    (10, 12),
    (0.04, 1.0),
    AffineForwardModelConfig(4, 5, 3, (-1,) * 5),
)


def test_settings_survive_json():
    loaded = FramesConfig.from_dict(json.loads(json.dumps(asdict(CONFIG))))
    assert loaded == CONFIG
    assert isinstance(loaded.size, Size)
    assert hash(loaded) == hash(CONFIG)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("size", Size(0.0, 0.01)),
        ("size", Size(0.5, math.nan)),
        ("size", Size(0.5, -1.0)),
        ("smoothing", ((1.0, 1.0), (0.5, 0.2))),
        ("smoothing", ((1.0, 1.0), (0.5, 0.2), (0.1,))),
        ("smoothing", ((1.0,), (0.5, 0.2, 0.3), (0.1, 0.1))),
        ("smoothing", ((1.0, 1.0), (0.5, 0.2), (1.1, 0.0))),
        ("smoothing", ((1.0, 1.0), (0.5, 0.2), (0.5, -0.1))),
        ("smoothing", ((1.0, 1.0), (0.5, 0.2), (0.5, math.nan))),
        ("others", (9, 10)),
        ("others", (10, -1)),
        ("others", (10, 10)),
        ("others", (10, 1.5)),
        ("ranges", (0.04,)),
        ("ranges", (0.04, 0.0)),
        ("ranges", (0.04, math.inf)),
        ("forward_model", AffineForwardModelConfig(3, 5, 3, (-1,) * 5)),
    ],
)
def test_fields_out_of_range_are_refused(field: str, value: object):
    with pytest.raises(ValueError, match=rf"expected FramesConfig\.{field} .*, got"):
        replace(CONFIG, **{field: value})
    read = asdict(value) if field == "forward_model" else value
    with pytest.raises(ValueError, match=rf"expected FramesConfig\.{field} .*, got"):
        FramesConfig.from_dict({**asdict(CONFIG), field: read})


@pytest.mark.parametrize("field", [*asdict(CONFIG)])
@pytest.mark.parametrize("value", [None, 5, "text", [None], {"of": 1}])
def test_fields_of_another_kind_are_refused(field: str, value: object):
    with pytest.raises(ValueError, match=r"^expected "):
        FramesConfig.from_dict({**asdict(CONFIG), field: value})


def test_missing_and_unknown_fields_are_refused():
    fields = asdict(CONFIG)
    for name in fields:
        rest = {key: value for key, value in fields.items() if key != name}
        with pytest.raises(ValueError, match=f"expected the fields of FramesConfig.*{name}"):
            FramesConfig.from_dict(rest)
    with pytest.raises(ValueError, match=r"expected the fields of FramesConfig.*colour"):
        FramesConfig.from_dict({**fields, "colour": 1})

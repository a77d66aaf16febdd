"""Settings of frames of reference survive JSON, and bad ones are refused."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace

import pytest

from pacnet.attention.cutting import Size
from pacnet.forward_models.config import AffineForwardModelConfig, KinematicModelConfig
from pacnet.schemas.body import BodyConfig
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
WITH_BODY = FramesConfig(
    Points(
        Point("hand", (9, 10, 11), (12, 13, 14, 15)),
        (
            Point("cup", (3, 4, 5)),
            Point("plate", (6, 7, 8)),
            Point("cup's place", (16, 17, 18)),
        ),
    ),
    Size(0.5, 0.01),
    ((1.0, 1.0), (0.5, 0.2), (0.0, 0.0), (1.0, 1.0)),
    (2,),
    (0.04,),
    None,
    BodyConfig(KinematicModelConfig(("shoulder", "elbow"), (0, 1)), (1, 0), (0, 2)),
    (0,),
)


@pytest.mark.parametrize("config", [CONFIG, WITH_BODY])
def test_settings_survive_json(config: FramesConfig):
    loaded = FramesConfig.from_dict(json.loads(json.dumps(asdict(config))))
    assert loaded == config
    assert isinstance(loaded.size, Size)
    assert hash(loaded) == hash(config)


@pytest.mark.parametrize("field", ["angles", "commands"])
@pytest.mark.parametrize("value", [(0,), (0, 0), (0, -1), (0, 1.5), (0, 1, 2), "ab", (0, True)])
def test_a_body_has_a_dimension_for_each_angle(field: str, value: object):
    body = WITH_BODY.body
    assert body is not None
    with pytest.raises(ValueError, match=rf"expected BodyConfig\.{field} as 2 different dimens"):
        replace(body, **{field: value})


@pytest.mark.parametrize("field", ["model", "angles", "commands"])
@pytest.mark.parametrize("value", [None, 5, "text", [None], {"of": 1}, "missing"])
def test_fields_of_a_body_of_another_kind_are_refused(field: str, value: object):
    fields = asdict(WITH_BODY)
    fields["body"][field] = value
    if value == "missing":
        del fields["body"][field]
    with pytest.raises(ValueError, match=r"^expected "):
        FramesConfig.from_dict(fields)


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


@pytest.mark.parametrize("config", [CONFIG, WITH_BODY])
@pytest.mark.parametrize("field", [*asdict(CONFIG)])
@pytest.mark.parametrize("value", [None, 5, "text", [None], {"of": 1}])
def test_fields_of_another_kind_are_refused(config: FramesConfig, field: str, value: object):
    fields = {**asdict(config), field: value}
    if value is None and getattr(config, field) is None:
        fields["size"] = None  # None is valid there
    with pytest.raises(ValueError, match=r"^expected "):
        FramesConfig.from_dict(fields)


def test_either_a_forward_model_or_a_body_finds_actions():
    for fields in ({"body": WITH_BODY.body}, {"forward_model": None}):
        with pytest.raises(ValueError, match=r"expected FramesConfig\.forward_model .*or a body"):
            replace(CONFIG, **fields)


@pytest.mark.parametrize("back", [(2,), (-1,), (0, 0), (0.5,), (0, 1, 2)])
def test_only_landmarks_that_are_perceived_are_put_back(back: tuple[float, ...]):
    """The last of the three landmarks is where the cup stood."""
    with pytest.raises(ValueError, match=r"expected FramesConfig\.put_back as different landmarks"):
        replace(WITH_BODY, put_back=back)


def test_what_a_percept_implies_has_names():
    assert WITH_BODY.added == (
        *("hand.x", "hand.y", "hand.z", "hand.qw", "hand.qx", "hand.qy", "hand.qz"),
        *("cup's place.x", "cup's place.y", "cup's place.z"),
    )
    assert CONFIG.added == ()
    flat = Points(Point("hand", (0, 1)), (Point("cup", (2, 3)), Point("cup's place", (4, 5))))
    model = AffineForwardModelConfig(2, 2, 1, (-1,) * 2)
    config = replace(CONFIG, points=flat, others=(), ranges=(), forward_model=model, put_back=(0,))
    assert config.added == ("cup's place.x", "cup's place.y")


def test_settings_of_an_older_version_have_no_body():
    fields = asdict(CONFIG)
    del fields["body"], fields["put_back"]
    assert FramesConfig.from_dict(fields) == CONFIG


def test_missing_and_unknown_fields_are_refused():
    fields = asdict(CONFIG)
    for name in fields.keys() - {"body", "put_back"}:
        rest = {key: value for key, value in fields.items() if key != name}
        with pytest.raises(ValueError, match=f"expected the fields of FramesConfig.*{name}"):
            FramesConfig.from_dict(rest)
    with pytest.raises(ValueError, match=r"expected the fields of FramesConfig.*colour"):
        FramesConfig.from_dict({**fields, "colour": 1})

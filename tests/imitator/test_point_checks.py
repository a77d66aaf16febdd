"""Whether points hold in demonstrations, and what an imitator makes of them."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch
from reaching import reach, shown

from pacnet.core.checkpoint import read_checkpoint, write_checkpoint
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.datasets.format import DatasetWarning
from pacnet.imitator import Imitator, ImitatorConfig
from pacnet.imitator.points import check_points
from pacnet.schemas.points import Point, Points

SURROUNDINGS = "observation.environment_state"
NAMES = {
    "observation.state": ("hand.x", "hand.y"),
    SURROUNDINGS: ("box.x", "box.y", "goal.x", "goal.y"),
    "action": ("hand.x", "hand.y"),
}
HAND, BOX, GOAL = Point("hand", (0, 1)), Point("box", (2, 3)), Point("goal", (4, 5))
ALL = Points(HAND, (BOX, GOAL))
TEXTS = [
    "hand=observation.state",
    "box=observation.environment_state[0:2]",
    "goal=observation.environment_state[2:4]",
]


def push(number: int) -> Demonstration:
    """A hand on its way from the origin to a box, which stands still beside a goal."""
    path = torch.linspace(0, 1, 50)[:, None] * torch.tensor([[0.3 + number, 0.2]])
    place = torch.tensor([0.3 + number, 0.2, 0.5, 0.1 * number]).expand(50, 4)
    return Demonstration(number, "push", path, place, path.roll(-1, dims=0))


def pushes(*changed: tuple[int, int, float | int]) -> Demonstrations:
    """Three demonstrations; in some episodes a dimension of the surroundings is all one number."""
    episodes = [*map(push, range(3))]
    for episode, dimension, value in changed:
        place = episodes[episode].environment_state.clone()
        place[:, dimension] = value
        episodes[episode] = replace(episodes[episode], environment_state=place)
    return Demonstrations(10, NAMES, tuple(episodes), "pushing")


def without_goal(*numbers: int) -> Demonstrations:
    return pushes(*((number, dimension, 0) for number in numbers for dimension in (2, 3)))


def alike() -> Demonstrations:
    """The goal is where the box is, at every frame."""
    episodes = tuple(
        replace(one, environment_state=one.environment_state[:, [0, 1, 0, 1]]) for one in pushes()
    )
    return replace(pushes(), episodes=episodes)


def still(demonstrations: Demonstrations) -> Demonstrations:
    """The hand stays where it is, at another place in each episode."""
    episodes = tuple(
        replace(one, state=torch.full_like(one.state, number + 1))
        for number, one in enumerate(demonstrations)
    )
    return replace(demonstrations, episodes=episodes)


def test_points_that_hold_are_accepted():
    check_points(ALL, pushes())
    check_points(ALL, pushes((1, 2, 0.0)))  # one coordinate may be zero
    check_points(Points(HAND, (BOX,)), without_goal(0, 1, 2))


def test_the_moved_point_moves():
    with pytest.raises(ValueError, match=r"expected 'hand' to be what .* never moves in any"):
        check_points(ALL, still(pushes()))
    moves = replace(pushes(), episodes=(*still(pushes()), push(3)))
    check_points(ALL, moves)


def test_a_landmark_is_another_place_than_others():
    with pytest.raises(ValueError, match="expected 'goal' to be another place than 'box'"):
        check_points(ALL, alike())
    as_hand = [replace(one, environment_state=one.state.repeat(1, 2)) for one in pushes()]
    with pytest.raises(ValueError, match="expected 'box' to be another place than 'hand'"):
        check_points(ALL, replace(pushes(), episodes=tuple(as_hand)))
    nearly = alike().episodes[0].environment_state.clone()
    nearly[-1, 2] += 0.01
    check_points(
        ALL,
        replace(
            alike(),
            episodes=(
                replace(alike().episodes[0], environment_state=nearly),
                *alike().episodes[1:],
            ),
        ),
    )


def test_a_landmark_is_there_in_every_episode():
    with pytest.raises(ValueError, match=r"frames of episode 1: .* with --exclude 1 \(exclude="):
        check_points(ALL, without_goal(1))
    with pytest.raises(ValueError, match=r"frames of episodes 0-1: .* with --exclude 0-1 "):
        check_points(ALL, without_goal(0, 1))


def test_a_landmark_that_is_given_may_be_at_the_origin():
    with pytest.warns(DatasetWarning, match="'goal' is zero in all frames: .* at the origin"):
        check_points(ALL, without_goal(0, 1, 2))
    with pytest.warns(DatasetWarning, match="'goal' is zero in all frames"):
        imitator = Imitator.from_demonstrations(without_goal(0, 1, 2), points=TEXTS)
    assert imitator.config.points == ALL
    both = pushes(*((number, dimension, 0) for number in range(3) for dimension in range(4)))
    with pytest.raises(ValueError, match="landmarks at different places, got box, goal at zero"):
        check_points(ALL, both)


def test_points_lie_within_the_percept():
    with pytest.raises(ValueError, match=r"within the 6 dimensions of percepts, got 6"):
        check_points(Points(HAND, (Point("box", (2, 6)),)), pushes())


@pytest.mark.parametrize("given", [TEXTS, tuple(TEXTS), ALL, "auto"])
def test_an_imitator_keeps_the_points(given):
    assert Imitator.from_demonstrations(pushes(), points=given).config.points == ALL


def test_points_are_found_by_default_and_may_be_switched_off():
    assert Imitator.from_demonstrations(pushes()).config.points == ALL
    assert Imitator.from_demonstrations(pushes(), points=None).config.points is None
    assert Imitator.from_demonstrations(shown(reach(0))).config.points is None
    pairs = {"pointer": "observation.state[0:2]", "box": f"{SURROUNDINGS}[0:2]"}
    points = Imitator.from_demonstrations(pushes(), points=pairs).config.points
    assert points == Points(Point("pointer", (0, 1)), (BOX,))


def test_points_that_were_given_are_checked():
    for demonstrations in (without_goal(1), alike(), still(pushes())):
        with pytest.raises(ValueError, match=r"expected '(goal|hand)' to be"):
            Imitator.from_demonstrations(demonstrations, points=TEXTS)
    for nothing in ("none", "hand=observation.state", [], 3):
        with pytest.raises(ValueError, match=r"expected (points as a list|the point that)"):
            Imitator.from_demonstrations(pushes(), points=nothing)


def test_padding_that_was_found_is_left_out_silently():
    points = Imitator.from_demonstrations(without_goal(0, 1, 2)).config.points
    assert points == Points(HAND, (BOX,))


@pytest.mark.parametrize(
    ("demonstrations", "told", "kept"),
    [
        (without_goal(1), "not used as one: expected 'goal' to be there", Points(HAND, (BOX,))),
        (alike(), "not used as one: expected 'goal' to be another", Points(HAND, (BOX,))),
        (still(pushes()), "not used as one: expected 'hand' to be what", None),
    ],
)
def test_what_was_found_and_does_not_hold_is_left_out_with_a_warning(demonstrations, told, kept):
    with pytest.warns(DatasetWarning, match=told):
        imitator = Imitator.from_demonstrations(demonstrations)
    assert imitator.config.points == kept


def test_a_quaternion_in_an_unknown_order_is_left_out_with_a_warning():
    names = {
        "observation.state": ("hand.x", "hand.y", "hand.z"),
        "observation.box_pos": ("0", "1", "2"),
        "observation.box_quat": ("0", "1", "2", "3"),
        "action": ("x", "y", "z"),
    }
    path = torch.linspace(0, 1, 50)[:, None] * torch.tensor([[0.3, 0.2, 0.1]])
    box = torch.tensor([0.3, 0.2, 0.1, 0, 0, 0, 1]).expand(50, 7)
    one = Demonstration(0, "push", path, box, path.roll(-1, dims=0))
    with pytest.warns(DatasetWarning, match=r"box_quat' is not used as the orientation of 'box'"):
        points = Imitator.from_demonstrations(Demonstrations(10, names, (one,), "a")).config.points
    assert points == Points(Point("hand", (0, 1, 2)), (Point("box", (3, 4, 5)),))


def test_where_all_that_was_found_is_padding_a_warning_says_so():
    nothing = pushes(*((number, dimension, 0) for number in range(3) for dimension in range(4)))
    with pytest.warns(DatasetWarning, match="padding is no landmark") as told:
        assert Imitator.from_demonstrations(nothing).config.points is None
    assert len(told) == 2


def test_episodes_are_whole_when_points_are_checked():
    """A hand that is still within each part of an episode, but not from part to part."""
    jump = push(0)
    state = (torch.arange(50) >= 25).float()[:, None].expand(50, 2)
    jump = replace(jump, state=state.clone(), gaps=(25,))
    jumps = replace(pushes(), episodes=(jump,))
    check_points(ALL, jumps)
    with pytest.raises(ValueError, match="expected 'hand' to be what"):
        check_points(ALL, jumps.continuous())
    with pytest.raises(ValueError, match=r"expected actions that move 'hand', got some"):
        Imitator.from_demonstrations(jumps, points=TEXTS)  # within a part they never do
    with pytest.warns(DatasetWarning, match=r"points are not used: expected actions that move"):
        assert Imitator.from_demonstrations(jumps).config.points is None


def test_points_survive_a_checkpoint(tmp_path: Path):
    imitator = Imitator.from_demonstrations(pushes())
    imitator.learn(pushes())
    imitator.save_pretrained(tmp_path)
    assert Imitator.from_pretrained(tmp_path).config == imitator.config
    fields, _ = read_checkpoint(tmp_path)
    assert Points.from_dict(fields["frames"]["points"]) == ALL


def test_a_checkpoint_from_before_there_were_points_is_read(tmp_path: Path):
    imitator = Imitator.from_demonstrations(pushes(), points=None)
    imitator.learn(pushes())
    imitator.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    del fields["frames"]
    write_checkpoint(tmp_path, fields, tensors)
    assert Imitator.from_pretrained(tmp_path).config.points is None


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (asdict(Points(HAND, (Point("box", (2, 6)),))), "ImitatorConfig.frames of 6 dimensions"),
        ({}, "the fields of Points"),
        ([], "the fields of Points"),
        (3, "the fields of Points"),
        (asdict(ALL) | {"landmarks": []}, "Points.landmarks as Points"),
        (asdict(ALL) | {"landmarks": [asdict(HAND)]}, "Points.landmarks of different names"),
        (asdict(Points(HAND, (BOX,))), "FramesConfig.smoothing as 2 pairs"),
    ],
)
def test_damaged_points_are_refused(points, message: str, tmp_path: Path):
    imitator = Imitator.from_demonstrations(pushes())
    imitator.save_pretrained(tmp_path)
    fields, tensors = read_checkpoint(tmp_path)
    fields["frames"]["points"] = json.loads(json.dumps(points))
    if points == asdict(Points(HAND, (Point("box", (2, 6)),))):
        del fields["frames"]["smoothing"][2]
    write_checkpoint(tmp_path, fields, tensors)
    with pytest.raises(ValueError, match=f"expected {message}"):
        Imitator.from_pretrained(tmp_path)


def test_a_config_has_frames_of_its_percept_and_its_actions():
    config = Imitator.from_demonstrations(pushes()).config
    frames = config.frames
    assert frames is not None
    assert isinstance(replace(config, frames=None), ImitatorConfig)
    model = frames.forward_model
    wider = replace(model, action_dimensions=3, follows=(*model.follows, -1))
    beyond = replace(frames, points=Points(HAND, (BOX, Point("goal", (4, 6)))))
    wanted = r"ImitatorConfig.frames of 6 dimensions, with targets that are actions"
    for other in (beyond, replace(frames, forward_model=wider), asdict(frames), "auto"):
        with pytest.raises(ValueError, match=wanted):
            replace(config, frames=other)
    assert replace(config, budget=10).frames == frames

"""`pacnet fit --body` takes a model of a body; the other commands work with what was learned."""

import json
import shutil
from pathlib import Path

import pytest
from command_line import assert_equal, refusal, run, value_of
from lifting import CUP, JOINTS, NAMES, STATE, SURROUNDINGS, arm, arm_in, hand_of, record_lifts

from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.datasets.recorder import Recorder
from pacnet.forward_models.config import MLPForwardModelConfig
from pacnet.forward_models.kinematics import KinematicModel
from pacnet.forward_models.mlp import MLPForwardModel
from pacnet.imitator import Imitator

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def lifting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_lifts(tmp_path_factory.mktemp("data") / "lifting", (0.35, 0.1, 0.02))


@pytest.fixture(scope="module")
def body(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return arm_in(tmp_path_factory.mktemp("bodies") / "arm")


@pytest.fixture(scope="module")
def lifter(lifting: Path, body: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint that the command wrote; the body's folder is not needed afterwards."""
    folder, copied = tmp_path_factory.mktemp("learned") / "lifter", body.parent / "copied"
    shutil.copytree(body, copied)
    assert run("fit", lifting, "--out", folder, "--body", copied, "--points", CUP) == 0
    shutil.rmtree(copied)
    return folder


def test_what_is_learned_is_printed_and_the_same_as_in_python(
    lifting: Path, body: Path, tmp_path: Path, capsys: Capture
):
    out = tmp_path / "out"
    assert run("fit", lifting, "--out", out, "--body", body, "--points", CUP) == 0
    printed = capsys.readouterr().out
    assert value_of("points", printed) == "hand (of the body), cup, cup's place"
    assert value_of("segments", printed) == "cup, world, cup's place, world"
    assert "with the angles perceived" in value_of("movement", printed)
    shown = load_demonstrations(lifting)
    python = Imitator.from_demonstrations(shown, points=[CUP], body=arm())
    python.learn(shown)
    assert_equal(Imitator.from_pretrained(out), python)


def test_a_body_is_used_within_a_budget(lifting: Path, body: Path, tmp_path: Path, capsys: Capture):
    assert run("fit", lifting, "--out", tmp_path, "--body", body, "--budget", 30) == 0
    printed = capsys.readouterr().out
    assert value_of("points", printed) == "hand (of the body), cup, cup's place"
    assert value_of("segments", printed) == "cup, world, cup's place, world"
    saved = Imitator.from_pretrained(tmp_path)
    assert 0 < len(saved.memory.rows) <= 30
    assert value_of("targets", printed) == f"{len(saved.memory.rows)} actions of 144 shown"


def test_landmarks_are_found_by_their_names(
    lifting: Path, body: Path, lifter: Path, tmp_path: Path, capsys: Capture
):
    assert run("fit", lifting, "--out", tmp_path / "out", "--body", body) == 0
    points = value_of("points", capsys.readouterr().out)
    assert points == "hand (of the body), cup, cup's place"
    assert_equal(Imitator.from_pretrained(tmp_path / "out"), Imitator.from_pretrained(lifter))


def test_info_describes_the_body(lifter: Path, body: Path, capsys: Capture):
    assert run("info", lifter) == 0
    printed = capsys.readouterr().out
    assert value_of("body", printed) == "turn, shoulder, elbow move the hand, of 4 joints"
    assert value_of("points", printed) == "hand (of the body), cup, cup's place"
    assert run("info", lifter, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["body"] == {"joints": [*JOINTS], "moving": ["turn", "shoulder", "elbow"]}
    assert document["points"]["hand"][:3] == ["hand.x", "hand.y", "hand.z"]
    assert document["explained"] is None
    assert run("info", body) == 0
    printed = capsys.readouterr().out
    assert value_of("body", printed) == "turn, shoulder, elbow move the hand, of 4 joints"


def test_an_imitator_without_a_body_has_none(imitator: Path, capsys: Capture):
    assert run("info", imitator, "--json") == 0
    assert json.loads(capsys.readouterr().out)["body"] is None


def test_explain_says_where_angles_come_from(lifting: Path, lifter: Path, capsys: Capture):
    assert run("explain", lifter, lifting, "--episode", 0, "--frame", 20) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "segment 1 of 4, on the way to cup" in printed
    assert "the angles near these that take hand, or what it carries, to where it was" in printed
    assert run("explain", lifter, lifting, "--episode", 0, "--frame", 20, "--json") == 0
    segment = json.loads(capsys.readouterr().out)["segment"]
    shown = load_demonstrations(lifting).episodes[0]
    hand = hand_of(shown.state[20].numpy())[0]
    apart = hand - shown.environment_state[20, :3].numpy()
    assert segment["distance"] == pytest.approx((apart**2).sum() ** 0.5, abs=0.01)


def test_all_of_a_demonstration_is_known_and_drawn(
    lifting: Path, lifter: Path, tmp_path: Path, capsys: Capture
):
    assert run("watch", lifter, lifting, "--out", tmp_path / "watched") == 0
    (row,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("      0")]
    assert "100.0%" in row
    assert row.split()[-1] == "100.0%"  # it follows it to its end
    names = {file.name for file in (tmp_path / "watched").iterdir()}
    assert names == {"episode_000.png", "episode_000_segments.png"}
    assert run("export", lifter, lifting, "--out", tmp_path / "annotated") == 0
    copy = load_demonstrations(tmp_path / "annotated", environment_state="expected_end")
    assert copy.episodes[0].environment_state.isfinite().all()


def test_what_is_held_out_is_compared(body: Path, tmp_path: Path, capsys: Capture):
    three = record_lifts(tmp_path / "three", *[(0.35, y, 0.02) for y in (0.0, 0.1, 0.05)])
    assert run("fit", three, "--out", tmp_path / "out", "--body", body, "--held-out", 2) == 0
    printed = capsys.readouterr().out
    assert "each was left out in turn" in printed
    assert "with points the imitator leads hand back" in printed


def test_it_is_continued_with_its_own_body(
    lifter: Path, body: Path, tmp_path: Path, capsys: Capture
):
    more = record_lifts(tmp_path / "more", (0.3, 0.0, 0.02), seed=1)
    assert run("fit", more, "--from", lifter, "--out", tmp_path / "both") == 0
    printed = capsys.readouterr().out
    assert value_of("points", printed) == "hand (of the body), cup, cup's place"
    both = Imitator.from_pretrained(tmp_path / "both")
    assert len(both.reports) == 2
    assert both.frames is not None
    assert both.frames.has_body(arm())
    assert run("fit", more, "--from", lifter, "--out", tmp_path / "no", "--body", body) == 2
    assert "argument --body: not with --from, which has its own" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--points", "none"), "argument --body: not with --points none, it needs a landmark"),
        (("--targets", "state"), "argument --body: not with --targets state"),
    ],
)
def test_usage_is_checked(
    options: tuple[str, ...], message: str, lifting: Path, body: Path, tmp_path: Path,
    capsys: Capture,
):  # fmt: skip
    assert run("fit", lifting, "--out", tmp_path / "out", "--body", body, *options) == 2
    assert message in capsys.readouterr().err


def test_what_is_no_body_of_these_percepts_is_refused(
    lifting: Path, body: Path, tmp_path: Path, capsys: Capture
):
    def refused(folder: Path, *options: str, dataset: Path = lifting) -> str:
        out = tmp_path / "out"
        error = refusal(capsys, "fit", dataset, "--out", out, "--body", folder, *options)
        assert not out.exists()
        return error

    assert "expected a checkpoint folder with model.safetensors" in refused(tmp_path / "nowhere")
    network = MLPForwardModel(MLPForwardModelConfig(2, 2, ((0.0, 0.0), (1.0, 1.0))))
    network.save_pretrained(tmp_path / "network")
    error = refused(tmp_path / "network")
    assert "expected a checkpoint of KinematicModel" in error
    assert "got one of 'MLPForwardModel'" in error

    leg = ("turn", "shoulder", "neck", "knee")
    other = KinematicModel.from_function(hand_of, leg, [-1] * 4, [1] * 4)
    other.save_pretrained(tmp_path / "leg")
    error = refused(tmp_path / "leg")
    assert "expected percepts with an angle of each of the 4 joints" in error
    assert "got none of 'knee' among turn.pos" in error

    assert "got none of 'turn' among" in refused(
        body, "--state", SURROUNDINGS, "--environment-state", "none"
    )
    assert "3 dimensions beside a body's hand" in refused(
        body, "--points", f"cup={SURROUNDINGS}[0:2]"
    )
    error = refused(body, "--points", f"hand={SURROUNDINGS}[0:3]")
    assert "expected landmarks alone beside a body, got 'hand'" in error


def test_angles_in_degrees_are_refused(lifting: Path, body: Path, tmp_path: Path, capsys: Capture):
    shown = load_demonstrations(lifting).episodes[0]
    with Recorder(tmp_path / "degrees", 25, NAMES, "arm") as recorder:
        values = (57.3 * shown.state, shown.environment_state, 57.3 * shown.action)
        named = zip(NAMES, (value.numpy() for value in values), strict=True)
        recorder.save_episode("lift", dict(named))
    out = ("--out", tmp_path / "out")
    error = refusal(capsys, "fit", tmp_path / "degrees", *out, "--body", body)
    assert "episode 0: expected the angle 'turn' of the body within -1.50 to 1.50 rad" in error


def test_without_a_landmark_it_is_refused(
    lifting: Path, body: Path, tmp_path: Path, capsys: Capture
):
    error = refusal(
        capsys, "fit", lifting, "--environment-state", "none", "--state", STATE,
        "--out", tmp_path / "out", "--body", body,
    )  # fmt: skip
    assert "expected a landmark beside the body's hand" in error


def test_help_explains_a_body(capsys: Capture):
    assert run("fit", "--help") == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "--body FOLDER checkpoint of a KinematicModel" in text

"""The paper's Figure 2: segmentation, scores by hand, files of a run."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from training_runs import only_run

from pacnet import NO_NODE, MotorSchemasConfig, PACNet, PACNetConfig, SOFMConfig
from pacnet.network.schema_network import SchemaNetwork
from train.postural.episodes import (
    Condition,
    demonstration_seeds,
    make_environment,
    motor_targets,
    recall_seeds,
)
from train.postural.schema_network import segments
from train.postural.schema_network.episodes import (
    BY_ATTENTION,
    MARGIN,
    PACNET,
    SCHEMA_NETWORK,
    SCHEMA_NETWORK_HELD,
    SCHEMAS,
    SYSTEMS,
    Episode,
    Shown,
    held_winners,
    make_schema_network,
    watch,
    with_margin,
)
from train.postural.schema_network.figures import (
    Behaviour,
    side_by_side,
    switches_per_episode,
    winners_and_confidences,
)
from train.postural.schema_network.scores import (
    order_of_medians,
    score_duplicates,
    score_order,
    score_schemas,
    score_system,
    strict_order,
)
from train.postural.schema_network.segments import divide, stretches
from train.schema_network import deal

PROJECT = Path(__file__).parents[2]


def ramp(start: float, samples: int, grasp: int) -> Shown:
    """All dimensions rise by 0.01 a sample, which smoothing keeps; the grasp begins at `grasp`."""
    values = start + 0.01 * np.arange(samples)
    percepts = np.repeat(values[:, None], 28, axis=1).astype(np.float32)
    return Shown(percepts, ("approach",) * grasp + ("grasp",) * (samples - grasp))


def shown() -> dict[str, Shown]:
    return {"drink": ramp(0, 30, 10), "toast": ramp(10, 36, 12), "move": ramp(20, 42, 5)}


def test_the_cut_is_the_shared_approach_and_four_equal_parts_of_each_rest():
    network = make_schema_network(shown())
    # drink: 10 up to the grasp, then 20 in 4; toast: 24 from its grasp on, in 4; move: 42 in 4.
    bounds = [0, 10, 21, 32, 42]  # 10.5 rounds to the even 10, 31.5 to 32
    assert network.lengths.tolist() == [10, *[5] * 4, *[6] * 4, *np.diff(bounds)]
    firsts = [network.percepts(schema)[0, 0].item() for schema in range(13)]
    drink, toast = [0, 0.1, 0.15, 0.2, 0.25], [10.12, 10.18, 10.24, 10.3]
    move = [20, 20.1, 20.21, 20.32]
    assert firsts == pytest.approx([*drink, *toast, *move], abs=1e-4)


def test_each_schema_keeps_the_targets_of_its_own_percepts():
    network = make_schema_network(shown())
    expected = torch.from_numpy(motor_targets(shown()["toast"].percepts)[18:24])
    assert torch.equal(network.targets(6), expected)  # schema 7: the second part after the grasp


def test_every_part_wins_where_it_was_cut_from():
    network = make_schema_network(shown())
    percepts = torch.from_numpy(shown()["drink"].percepts)
    winners = 1 + network.recall(percepts[[3, 12, 17, 22, 27]]).winner
    assert winners.tolist() == list(SCHEMAS["drink"])


def test_a_margin_changes_only_the_competition():
    network = make_schema_network(shown())
    held = with_margin(network, 0.25)
    assert held.config.competition.margin == 0.25
    assert held.config.competition.threshold == network.config.competition.threshold
    assert network.config.competition.margin == 0
    for name, tensor in held.state_dict().items():
        assert torch.equal(tensor, network.state_dict()[name]), name


def test_seeds_are_used_once_and_never_shared_with_demonstrations():
    dealt = deal(recall_seeds(0, 9))
    assert dealt == {name: recall_seeds(0, 9)[place::3] for place, name in enumerate(SCHEMAS)}
    assert [seeds[0] for seeds in deal(recall_seeds(0, 3)).values()] == recall_seeds(0, 3)
    taught = {seed for seeds in deal(demonstration_seeds(0, 3)).values() for seed in seeds}
    assert not taught & set(recall_seeds(0, 300))


def test_nodes_held_by_hysteresis_switch_later():
    attention = SOFMConfig.paper(1, novelty_threshold=0.4)
    network = PACNet(PACNetConfig(attention, MotorSchemasConfig(1, 1)))
    for episode, place in enumerate((0.0, 1.0)):
        network.observe(torch.full((30, 1), place), torch.zeros(30, 1), episode)
    percepts = np.array([[0.3], [0.52], [0.55], [0.7], [0.48], [9.0]], dtype=np.float32)
    # e^-.45 − e^-.55 = .06 is under the margin of .1, e^-.3 − e^-.7 = .24 is over it.
    assert MARGIN == 0.1
    assert held_winners(network, percepts).tolist() == [0, 0, 0, 1, 1, NO_NODE]


def runs(*pairs: tuple[int, int]) -> np.ndarray:
    """Winner and how long, one after the other."""
    return np.concatenate([np.full(length, winner) for winner, length in pairs])


def test_the_order_of_medians_is_robust_against_flicker_and_returns():
    won = runs((1, 30), (8, 1), (6, 1), (1, 1), (6, 20), (7, 20), (2, 9), (8, 20), (6, 5), (9, 20))
    assert order_of_medians(won, SCHEMAS["toast"]) == (1, 6, 7, 8, 9)
    assert order_of_medians(won, SCHEMAS["drink"]) == (1,)  # 2 won too little to count
    swapped = runs((1, 30), (7, 20), (6, 20), (8, 20), (9, 20))
    assert order_of_medians(swapped, SCHEMAS["toast"]) == (1, 7, 6, 8, 9)


def test_the_strict_order_allows_only_the_alternation_in_the_grasp():
    won = runs((1, 9), (2, 3), (6, 3), (2, 3), (6, 9), (4, 2), (7, 9), (8, 9), (9, 9))
    assert strict_order(won, SCHEMAS["toast"]) == (1, 6, 7, 8, 9)
    assert strict_order(won, SCHEMAS["drink"]) == (1, 2, 7, 8, 9)
    assert strict_order(runs((1, 9), (6, 9), (4, 3), (7, 9)), SCHEMAS["toast"]) == (1, 6, 4, 7)
    assert strict_order(runs((10, 9), (2, 9), (6, 9)), SCHEMAS["move"]) == (10, 2, 6)


def episode(winners: np.ndarray, phases: tuple[str, ...], success: bool = True) -> Episode:
    seen = Shown(np.zeros((len(winners), 28), dtype=np.float32), phases)
    return Episode("toast", seen, {SCHEMA_NETWORK: winners}, {SCHEMA_NETWORK: success})


def hand_made() -> list[Episode]:
    alternating = runs((1, 4), (2, 1), (6, 1), (4, 1), (2, 1), (6, 10), (NO_NODE, 2))
    return [
        episode(alternating, ("approach",) * 4 + ("grasp",) * 3 + ("toast",) * 13),
        episode(runs((1, 10), (6, 10)), ("approach",) * 10 + ("toast",) * 10, success=False),
    ]


def test_scores_of_any_system_by_hand():
    scores = score_system(hand_made(), SCHEMA_NETWORK)
    # Switches: 1|2|6|4|2|6 are five, 1|6 is one. 2 of 20 samples have no winner, then none.
    assert scores == {
        "switches": 3.0, "nobody_share": pytest.approx(0.05), "task_success_rate": 0.5
    }  # fmt: skip


def test_scores_of_a_schema_network_by_hand():
    scores = score_schemas(hand_made(), SCHEMA_NETWORK)
    # 2, 6, (4,) 2, 6: three changes, the first in the grasp.
    assert scores["alternations_2_6"] == 1.5
    assert scores["alternations_2_6_by_phase"] == {"approach": 0.0, "grasp": 0.5, "toast": 1.0}
    assert scores["switches_by_phase"] == {"approach": 0.0, "grasp": 1.5, "toast": 1.5}
    assert scores["switching_pairs"]["2-6"] == 1.0
    assert scores["own_share"] == pytest.approx((15 / 18 + 1) / 2)
    assert scores["in_order_rate"] == scores["strictly_in_order_rate"] == 0.0


def test_an_order_kept_is_counted():
    won = runs((1, 20), (6, 20), (7, 20), (8, 20), (9, 20))
    scores = score_schemas([episode(won, ("toast",) * 100)], SCHEMA_NETWORK)
    assert scores["in_order_rate"] == scores["strictly_in_order_rate"] == 1.0


def test_a_strict_order_may_come_back_to_a_schema():
    phases = ("toast",) * 40
    kept = episode(runs((1, 10), (2, 2), (3, 8), (2, 10), (1, 10)), phases)  # flicker of two
    lost = episode(runs((1, 10), (2, 3), (3, 7), (2, 10), (NO_NODE, 5), (4, 5)), phases)
    scores = score_order([kept, lost], SCHEMA_NETWORK, (1, 3, 2, 1))
    assert scores == {"strictly_in_order_rate": 0.5, "own_share": pytest.approx((1 + 30 / 35) / 2)}


def test_stretches_leave_no_sample_out():
    winners = runs((NO_NODE, 3), (4, 9), (7, 4), (2, 6), (NO_NODE, 2), (4, 5), (2, 1))
    # 7 wins for four samples, fewer than five: they belong to the stretch of 4 before them.
    assert stretches(winners) == [(0, 16, 4), (16, 24, 2), (24, 30, 4)]


def test_all_that_a_node_wins_is_one_schema(monkeypatch: pytest.MonkeyPatch):
    # Places from 0 to 0.29 in the drink, from 10 to 10.35 in the toast; node 5 wins up to 0.095,
    # from 0.195 on, and all of the toast.
    def node(_: PACNet, percepts: np.ndarray) -> np.ndarray:
        place = percepts[:, 0]
        return np.where((place > 0.095) & (place < 0.195), 8, 5)

    monkeypatch.setattr(segments, "winners_of", node)
    both = {name: shown()[name] for name in ("drink", "toast")}
    division = divide(both, PACNet(PACNetConfig(SOFMConfig.paper(28), MotorSchemasConfig(11, 28))))
    assert division.orders == {"drink": (1, 2, 1), "toast": (1,)}
    assert division.network.lengths.tolist() == [10 + 10 + 36, 10]
    firsts = division.network.percepts(0)[[0, 10, 20], 0]
    assert firsts.tolist() == pytest.approx([0, 0.2, 10], abs=1e-4)
    expected = torch.from_numpy(motor_targets(both["drink"].percepts)[10:20])
    assert torch.equal(division.network.targets(1), expected)


def test_duplicates_by_hand():
    degrees = torch.tensor
    schemas = [
        torch.deg2rad(degrees([[0.0, 0.0], [10.0, 10.0]])),
        torch.deg2rad(degrees([[10.0, 11.0]])),  # 1/√2 from the second of the first: adds nothing
        torch.deg2rad(degrees([[11.5, 11.5], [30.0, 30.0]])),  # 1.14 from that of the second
    ]
    assert score_duplicates(schemas) == {
        "motor_schemas": 3,
        "stored_targets": 5,
        "duplicate_pairs": 1,
        "redundant_share": pytest.approx(2 / 5),
    }


def test_the_figures_say_what_is_shown():
    scene = Behaviour("toast", ("rest",) * 5 + ("approach",) * 5, (1, 6))
    won, confidences = runs((1, 5), (6, 3), (NO_NODE, 2)), np.full((10, 7), 0.5)
    figure = winners_and_confidences(scene, won, confidences, 0.02, (2, 6))
    assert figure.axes[0].get_title("left").endswith("shown toast: 1-6")
    assert [text.get_text() for text in figure.axes[0].texts] == ["approach"]
    bars = [line.get_segments()[0].tolist() for line in figure.axes[0].collections]
    np.testing.assert_allclose(bars, [[[0, 1], [0.1, 1]], [[0.1, 6], [0.16, 6]]])
    rows = side_by_side([(scene, {"one": won, "other": won - 1})], 0.02, 7)
    titles = [axes.get_title("left") for axes in rows.axes]
    assert titles == ["toast: 1 switches of one", "toast: 1 switches of other"]
    assert [label.get_text() for label in rows.axes[1].get_yticklabels()] == ["0", "5"]
    means = {"one": {"drink": 20.0, "toast": 30.0}, "other": {"drink": 4.0, "toast": 5.0}}
    bars = switches_per_episode(means)
    assert [bar.get_width() for bar in bars.axes[0].patches] == [20, 30, 4, 5]
    for drawn in (figure, rows, bars):
        drawn.draw_without_rendering()


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folders = []
    for name in ("one", "two"):
        folder = tmp_path_factory.mktemp(name)
        command = [sys.executable, "-m", "train.schema_network", "--seed", "1011"]
        command += ["--episodes", "1", "--runs", str(folder)]
        subprocess.run(command, cwd=PROJECT, capture_output=True, check=True)
        folders.append(only_run(folder))
    return folders


@pytest.mark.slow
def test_pacnet_switches_and_repeats_less_than_schemas_made_by_hand(two_runs: list[Path]):
    scores = json.loads((two_runs[0] / "metrics.json").read_text())
    assert set(scores["systems"]) == set(SYSTEMS)
    assert scores["switches_pacnet_to_schema_network"]["all"] <= 1 / 3
    one, other = scores["duplicates"][SCHEMA_NETWORK], scores["duplicates"][PACNET]
    assert other["redundant_share"] < one["redundant_share"] / 2
    plain = scores["systems"][SCHEMA_NETWORK]
    for behaviour in SCHEMAS:
        assert plain[behaviour]["in_order_rate"] == 1.0
        assert plain[behaviour]["nobody_share"] < 0.02
    assert plain["drink"]["alternations_2_6"] > 2
    held = scores["systems"][SCHEMA_NETWORK_HELD]
    assert held["all"]["switches"] < plain["all"]["switches"] / 3
    divided = scores["systems"][BY_ATTENTION]
    for behaviour in SCHEMAS:
        assert divided[behaviour]["strictly_in_order_rate"] == 1.0
        assert divided[behaviour]["task_success_rate"] == 1.0
        assert plain[behaviour]["strictly_in_order_rate"] < 1.0


@pytest.mark.slow
def test_a_run_writes_all_its_files(two_runs: list[Path]):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    folder = two_runs[0]
    figures = {path.stem for path in (folder / "figures").iterdir()}
    assert figures == {"figure2", "side_by_side", "switches"}
    assert len(SchemaNetwork.from_pretrained(folder / "checkpoint" / "schema_network")) == 13
    network = PACNet.from_pretrained(folder / "checkpoint" / "pacnet")
    divided = SchemaNetwork.from_pretrained(folder / "checkpoint" / "by_attention")
    assert len(divided) <= len(network.sofm)
    log = EventAccumulator(str(folder / "tensorboard"))
    log.Reload()
    assert log.Scalars("learning/nodes")[-1].value == len(network.sofm)
    assert figures <= set(log.Tags()["images"])
    assert "PACNet/toast/switches" in log.Tags()["scalars"]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(two_runs: list[Path]):
    one, two = two_runs
    for file in ("metrics.json", "checkpoint/schema_network/model.safetensors",
                 "checkpoint/pacnet/model.safetensors"):  # fmt: skip
        assert (one / file).read_bytes() == (two / file).read_bytes(), file


@pytest.mark.slow
def test_the_imitators_movement_does_not_change_its_percepts():
    environment = make_environment(Condition())
    resting = watch(environment, seed=1000)
    observation, _ = environment.reset(seed=1000)
    seen, truncated = [], False
    while not truncated:
        seen.append(np.concatenate([observation["demonstrator"], observation["glass"]]))
        target = environment.demonstrator_target
        observation, _, _, truncated, _ = environment.step_to(target)
    np.testing.assert_allclose(np.stack(seen), resting.percepts, atol=1e-6)  # float32 rounding
    assert resting.phases[0] == "rest"
    assert resting.phases.index("grasp") > 80

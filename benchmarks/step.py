"""One step of a control loop, by the map alone, a whole network, and an imitator.

Run it alone with `python -m benchmarks.step`.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from benchmarks.harness import NOTHING, Table, factor, latencies, number, run_alone, timed
from benchmarks.streams import demonstrations
from pacnet import HabituatingSOFM, MLPForwardModel, PACNet, SOFMConfig
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
from pacnet.imitator.imitator import Imitator
from pacnet.kernels.engine import Engine

CHECKPOINTS = Path(__file__).parents[1] / "checkpoints"
STEPS, EAGER_STEPS = 20_000, 1_000
NODES, DIMENSIONS = 30, 28
THRESHOLD = 0.58  # gives about this many nodes
SHOWN, LENGTH, JOINTS = 8, 500, 11  # demonstrations of an imitator, their frames, its actions
NOISE = 0.01  # standard deviation of a percept around its prototype
WANTED = {10: 0.1, 100: 0.2, 1_000: 0.5}  # demonstrations shown -> median of a step [ms]
WANTED_P99, WANTED_GROWTH = 2, 2  # [ms]; time to learn the last demonstrations over the first
LEARNED = 10  # demonstrations that are learned beforehand, and whose learning is timed

TEXT = f"""Each call is timed alone, on one float32 array: median and 99th percentile of {STEPS:,}
calls ({EAGER_STEPS:,} of eager torch), one thread. The map has about {NODES} nodes and percepts of
{DIMENSIONS} numbers. Experiment 2 is the shipped network with its forward model, which tries 21
actions; its percepts are noisy copies of learned ones, and {{commanded:.0%}} of them recall a
target. A step that learns passes sixteen arrays to its kernel and checks the list of edges. Passing
addresses instead of arrays took less than half as long.
"""
SHOWN_TEXT = f"""`Imitator.step` after so many demonstrations of {LENGTH} frames, {DIMENSIONS}
dimensions and {JOINTS} actions: median and 99th percentile of {STEPS:,} calls, while it watches
another {LENGTH} frames repeatedly, one thread. {LEARNED} demonstrations are learned beforehand, the
others are put into its memory. Then one more is learned, with which the thresholds of novelty are
due. "To learn" is the median over the {LEARNED} after that, when they are not: one demonstration,
from percepts to thresholds.
"""


def small_map() -> tuple[HabituatingSOFM, np.ndarray]:
    """Return a learned map, and more percepts of the same stream, float32 `[T, D]`."""
    stream = demonstrations(2_500 + STEPS, DIMENSIONS, 1, seed=0)
    som = HabituatingSOFM(
        SOFMConfig.paper(DIMENSIONS, novelty_threshold=THRESHOLD), engine="compiled"
    )
    som.observe(torch.from_numpy(stream[:2_500]))
    return som, stream[2_500:]


def experiment_2(engine: Engine) -> PACNet:
    """Return the shipped network that follows walls."""
    model = MLPForwardModel.from_pretrained(CHECKPOINTS / "forward_model")
    return PACNet.from_pretrained(CHECKPOINTS / "wall_following", model, engine).eval()


def percepts_near_nodes(network: PACNet, seed: int = 0) -> np.ndarray:
    """Return percepts near random prototypes, 20 samples at each, float32 `[T, D]`."""
    rng = np.random.default_rng(seed)
    prototypes = network.sofm.prototypes.numpy()
    places = np.repeat(rng.integers(len(prototypes), size=STEPS // 20), 20)
    percepts = prototypes[places] + NOISE * rng.standard_normal((STEPS, prototypes.shape[1]))
    return percepts.clip(0, 1).astype(np.float32)


def imitator(engine: Engine) -> tuple[Imitator, np.ndarray]:
    """Return a trained imitator, and percepts of another demonstration `[LENGTH, DIMENSIONS]`."""
    episodes, shown = laps(SHOWN, LENGTH)
    taught = Imitator.from_demonstrations(episodes, engine=engine)
    taught.learn(episodes)
    return taught.eval(), shown


def laps(shown: int, length: int) -> tuple[Demonstrations, np.ndarray]:
    """Return `shown` demonstrations, and the percepts of another one `[length, DIMENSIONS]`."""
    stream = demonstrations((shown + 1) * length + 1, DIMENSIONS, 1, seed=0)
    percepts, actions = torch.from_numpy(stream[:-1]), torch.from_numpy(stream[1:, :JOINTS])
    names = {
        "observation.state": tuple(f"state {number}" for number in range(DIMENSIONS)),
        "action": tuple(f"joint {number}" for number in range(JOINTS)),
    }
    pairs = zip(percepts.split(length)[:shown], actions.split(length)[:shown], strict=True)
    episodes = tuple(
        Demonstration(number, "go round", state, state[:, :0], action)
        for number, (state, action) in enumerate(pairs)
    )
    return Demonstrations(50, names, episodes, "laps"), stream[shown * length : -1]


def measure() -> list[Table]:
    """Measure one row for each kind of step."""
    som, percepts = small_map()
    nodes = len(som)
    som.eval()
    reading = _summary(latencies(som.step, _warm(som.step, percepts)))
    som.train()
    learning = _summary(latencies(som.step, _warm(som.step, percepts)))
    compiled, eager = experiment_2("compiled"), experiment_2("eager")
    places = percepts_near_nodes(compiled)
    whole = _summary(latencies(compiled.step, _warm(compiled.step, places)))

    def act(percept: np.ndarray) -> object:
        return eager.act(torch.from_numpy(percept)[None])

    slow = _summary(latencies(act, _warm(act, places[:EAGER_STEPS])))
    commanded = float(
        experiment_2("eager").recall(torch.from_numpy(places)).has_target.float().mean()
    )
    rows = [
        _row(f"`HabituatingSOFM.step`, reading, {nodes} nodes", reading, (5, 20)),
        _row(f"`HabituatingSOFM.step`, learning, {nodes} nodes and more", learning, (5, 20)),
        _row("`PACNet.step`, Experiment 2", whole, (60, 200)),
        _row("`PACNet.act` of one percept, eager torch", slow, None),
    ]
    rows.append(("`act` in eager torch over `step`", factor(slow[0] / whole[0]), *[NOTHING] * 3))
    columns = ("what", "p50 [µs]", "wanted", "p99 [µs]", "wanted")
    text = TEXT.format(commanded=commanded)
    return [Table("One step of a control loop", text, columns, rows), measure_imitators(WANTED)]


def measure_imitators(
    wanted: Mapping[int, float], length: int = LENGTH, steps: int = STEPS
) -> Table:
    """Measure imitators that were shown much: demonstrations -> wanted median of a step [ms]."""
    episodes, percepts = laps(max(wanted) + 1 + LEARNED, length)
    watched, rows, first = np.tile(percepts, (-(-steps // length), 1)), [], None
    for count, limit in wanted.items():
        imitating = shown_many(episodes, count)
        more = episodes.episodes[count + 1 : count + 1 + LEARNED]
        learn = statistics.median(
            timed(partial(imitating.learn, replace(episodes, episodes=(one,)))) for one in more
        )
        growth = [NOTHING] * 2 if first is None else [factor(learn / first), f"≤ {WANTED_GROWTH} ×"]
        first = learn if first is None else first
        p50, p99 = _summary(latencies(imitating.step, _warm(imitating.step, watched)))
        step = number(p50 / 1e3), f"≤ {limit}", number(p99 / 1e3), f"≤ {WANTED_P99}"
        rows.append((f"{count:,}", *step, number(learn * 1e3), *growth))
    columns = ("shown", "p50 [ms]", "wanted", "p99 [ms]", "wanted", "to learn [ms]")
    columns += ("over the first", "wanted")
    return Table("One step after many demonstrations", SHOWN_TEXT, columns, rows)


def shown_many(episodes: Demonstrations, count: int) -> Imitator:
    """Return an imitator that knows `count` demonstrations, and has learned one more."""
    first = replace(episodes, episodes=episodes.episodes[:LEARNED])
    imitating = Imitator.from_demonstrations(first)
    imitating.learn(replace(first, episodes=first.episodes[:count]))
    config, memory = imitating.config, imitating.memory
    for shown in episodes.episodes[LEARNED:count]:
        scaled = shown.percepts.numpy() * config.scaling.array
        changes = config.scaling.recent(config.fps).changes(scaled) * config.scaling.change_ratio
        memory.append(scaled, changes.astype(np.float32), shown.action.numpy(), 0, correction=False)
        imitating.reports.append(imitating.reports[-1]._replace(episode=shown.episode))
    imitating.learn(replace(first, episodes=episodes.episodes[count : count + 1]))
    return imitating


def _warm(step: Callable[[np.ndarray], object], percepts: np.ndarray) -> np.ndarray:
    for percept in percepts[:100]:
        step(percept)
    return percepts[100:]


def _summary(times: np.ndarray) -> tuple[float, float]:
    """Return median and 99th percentile [µs]."""
    return float(np.percentile(times, 50)), float(np.percentile(times, 99))


def _row(
    what: str, measured: tuple[float, float], wanted: tuple[int, int] | None
) -> tuple[str, ...]:
    limits = [f"≤ {limit}" for limit in wanted] if wanted else [NOTHING, NOTHING]
    return what, number(measured[0]), limits[0], number(measured[1]), limits[1]


if __name__ == "__main__":
    run_alone(__doc__, measure)

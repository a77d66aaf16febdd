"""The time of imports and first calls in new processes.

Run it alone with `python -m benchmarks.import_time`.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile

from benchmarks.harness import NOTHING, Table, number, run_alone
from benchmarks.step import CHECKPOINTS

RUNS = 7
WANTED_FIRST, WANTED_LATER, WANTED_IMPORT = 6, 0.5, 0.3  # [s] beyond torch

IMPORTS = {"torch": "import torch", "pacnet": "from pacnet import PACNet"}
CALLS = f"""
import numpy as np, torch
from pacnet import HabituatingSOFM, Imitator, MLPForwardModel, PACNet, SOFMConfig
from pacnet.datasets.demonstrations import Demonstration, Demonstrations
torch.set_num_threads(1)
percepts = torch.rand(200, 28)
som = HabituatingSOFM(SOFMConfig.paper(28), engine="compiled")
som.observe(percepts)
som(percepts)
som.step(percepts[0].numpy())
model = MLPForwardModel.from_pretrained({str(CHECKPOINTS / "forward_model")!r})
network = PACNet.from_pretrained({str(CHECKPOINTS / "wall_following")!r}, model).eval()
network.step(np.full(6, 0.5, np.float32))
wave = (torch.linspace(0, 12, 241)[:, None] + torch.linspace(0, 5, 28)).sin()
pairs = zip(wave[:-1].split(80), wave[1:, :11].split(80), strict=True)
shown = tuple(Demonstration(n, "wave", s, s[:, :0], a) for n, (s, a) in enumerate(pairs))
names = {{"observation.state": tuple("s%d" % n for n in range(28))}}
names |= {{"action": tuple("a%d" % n for n in range(11))}}
episodes = Demonstrations(50, names, shown)
imitator = Imitator.from_demonstrations(episodes)
imitator.learn(episodes)
for percept in wave[:3].numpy():
    imitator.step(percept)
"""

TEXT = """Medians over {runs} fresh, interleaved processes, without the start of the interpreter.
The calls are `observe`, `forward` and `step` of a map, `step` of the network of Experiment 2 with
its forward model, loaded from its checkpoint, and `Imitator.learn` of three short demonstrations,
then three of `Imitator.step`. The first calls after an installation compile the kernels (once, into
an empty cache) and print a message; later processes load them from the cache.
"""


def run_time(code: str, cache: str | None = None) -> float:
    """Return the time that a new interpreter needs for a piece of code [s]."""
    clocked = (
        f"import time; start = time.perf_counter()\n{code}\nprint(time.perf_counter() - start)"
    )
    environment = dict(os.environ) | ({"NUMBA_CACHE_DIR": cache} if cache else {})
    command = [sys.executable, "-c", clocked]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return float(done.stdout.splitlines()[-1])


def measure() -> list[Table]:
    """Measure imports and first calls."""
    with tempfile.TemporaryDirectory() as cache:
        cold = run_time(CALLS, cache)
        codes = {**IMPORTS, "calls": CALLS}
        times: dict[str, list[float]] = {name: [] for name in codes}
        run_time(codes["pacnet"])  # fills the disk cache and writes bytecode
        for _ in range(RUNS):
            for name, code in codes.items():
                times[name].append(run_time(code, cache))
    median = {name: statistics.median(measured) for name, measured in times.items()}
    torch = median["torch"]

    def row(what: str, measured: float, wanted: float | None) -> tuple[str, ...]:
        beyond = NOTHING if wanted is None else f"{measured - torch:+.2f}"
        return what, number(measured), beyond, NOTHING if wanted is None else f"≤ {wanted}"

    rows = [
        row(f"`{IMPORTS['torch']}`", torch, None),
        row(f"`{IMPORTS['pacnet']}`", median["pacnet"], WANTED_IMPORT),
        row("import and first calls after an installation", cold, WANTED_FIRST),
        row("import and first calls later", median["calls"], WANTED_LATER),
    ]
    columns = ("what", "s", "beyond torch [s]", "wanted")
    return [Table("Imports and first calls", TEXT.format(runs=RUNS), columns, rows)]


if __name__ == "__main__":
    run_alone(__doc__, measure)

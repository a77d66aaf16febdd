"""Helpers of the tests: a small dataset, commands in this process or their own, their output."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
import torch

from pacnet.cli import main
from pacnet.datasets.demonstrations import load_demonstrations
from pacnet.imitator import Imitator

PROJECT = Path(__file__).parents[2]
STATE, SURROUNDINGS, ACTION = "observation.state", "observation.environment_state", "action"
NAMES = {STATE: ("x", "y"), SURROUNDINGS: ("z",), ACTION: ("right", "up")}
BENDS = {"drink": 1.0, "wave": -1.0, "juggle": 3.0}  # of any other task 0


def record(
    root: Path,
    tasks: Sequence[str],
    seed: int,
    frames: int = 80,
    names: Mapping[str, Sequence[str]] = NAMES,
    fps: int = 20,
) -> Path:
    """A dataset of an episode for each task: noisy paths, straight for a third, then bending."""
    from pacnet.datasets.recorder import Recorder

    rng = np.random.default_rng(seed)
    with Recorder(root, fps, names, "hand") as recorder:
        for task in tasks:
            along = np.linspace(0, 3, frames)
            bent = BENDS.get(task, 0) * np.clip(along - 1, 0, None)
            path = np.stack([along, bent, np.sin(along)], axis=1)
            path += 0.01 * rng.standard_normal(path.shape)
            features = (path[:, :2], path[:, 2:], np.gradient(path[:, :2], axis=0))
            recorder.save_episode(task, dict(zip(names, features, strict=True)))
    return root


def run(*arguments: object) -> int:
    """The exit code of a command in this process."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as end:  # as argparse ends
        return int(end.code or 0)


def refusal(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line with which a command fails."""
    capsys.readouterr()
    assert run(*arguments) == 1
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    return error


def rows_under(head: str, printed: str) -> list[list[str]]:
    """The cells of a table's rows, from the line after its head on."""
    lines = printed.splitlines()
    first = next(place for place, line in enumerate(lines) if re.match(rf" *{head}\b", line))
    cells = [re.split(" {2,}", line.strip()) for line in lines[first:]]
    return [row for row in cells[1:] if len(row) == len(cells[0])]


def value_of(name: str, printed: str) -> str:
    """The value printed beside a name at the start of a line."""
    (value,) = re.findall(rf"^{name} {{2,}}(.*)$", printed, re.MULTILINE)
    return value


def unannounced(error: str) -> str:
    """What went to standard error, without what the first run on a machine says."""
    return re.sub(r"^pacnet: compiling for this machine, once, .*\n", "", error)


def trained(*datasets: Path) -> Imitator:
    """The second method: the same learned in Python."""
    shown = [load_demonstrations(dataset) for dataset in datasets]
    imitator = Imitator.from_demonstrations(shown[0])
    for demonstrations in shown:
        imitator.learn(demonstrations)
    return imitator


def assert_equal(imitator: Imitator, other: Imitator) -> None:
    tensors = other.state_dict()
    assert imitator.state_dict().keys() == tensors.keys()
    for name, tensor in imitator.state_dict().items():
        torch.testing.assert_close(tensor, tensors[name], rtol=0, atol=0, msg=name)
    assert imitator.config == other.config
    assert list(map(repr, imitator.reports)) == list(map(repr, other.reports))  # NaN equals NaN


def edit_info(root: Path, change) -> None:
    path = root / "meta" / "info.json"
    info = json.loads(path.read_text())
    change(info)
    path.write_text(json.dumps(info))


def edit_frames(root: Path, change: Callable[[dict[str, list]], None]) -> None:
    """Change the columns of a dataset's frames; new columns may be added."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    (path,) = (root / "data").rglob("*.parquet")
    table = pq.read_table(path)
    types = {field.name: field.type for field in table.schema}
    columns = table.to_pydict()
    change(columns)
    pq.write_table(
        pa.table({name: pa.array(columns[name], types.get(name)) for name in columns}), path
    )


COMMANDS = {
    "fit": "fit {dataset} --out {out}",
    "fit --from": "fit {dataset} --from {checkpoint} --out {out}",
    "info": "info {checkpoint}",
    "watch": "watch {checkpoint} {dataset} --out {out}",
    "export": "export {checkpoint} {dataset} --out {out}",
    "explain": "explain {checkpoint} {dataset} --episode 0 --frame 0",
}


def command_line(command: str, checkpoint: Path, dataset: Path, out: Path) -> list[str]:
    line = COMMANDS[command].split()
    return [word.format(checkpoint=checkpoint, dataset=dataset, out=out) for word in line]


def process(*arguments: object, code: str = "") -> subprocess.CompletedProcess[str]:
    """A process of its own; `code` runs before the command."""
    start = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    end = f"from pacnet.cli import main; raise SystemExit(main({list(map(str, arguments))}))"
    command = [sys.executable, "-c", f"{start}{code}\n{end}"]
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, timeout=1800
    )


INTERRUPT = "import os; os.kill(os.getpid(), signal.SIGINT)"

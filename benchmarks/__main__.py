"""Measure every table, each in its own process, and write docs/performance.md."""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks import machine, page
from benchmarks.harness import Table

MODULES = {
    "observe": "learning a stream, compared with a C loop and other packages",
    "nodes": "1,000 to 100,000 nodes, compared with the memory's bandwidth",
    "step": "one step of a control loop",
    "acting": "a control loop while another thread learns",
    "batch": "many percepts at once, compared with faiss",
    "ensemble": "many maps in one call",
    "import_time": "imports and first calls",
    "environments": "control steps of the scenes, compared with plain physics",
    "memory": "ten million samples from a generator",
    "datasets": "recording and reading datasets, compared with LeRobot",
    "pictures": "recording and decoding the pictures of cameras, compared with LeRobot",
    "fit": "pacnet fit, from the command to the checkpoint",
    "cameras": "learning and acting with two cameras",
}
WITH_LEROBOT = "datasets"


class Arguments(NamedTuple):
    """What to measure."""

    names: list[str]
    """Names of the modules."""
    also: str | None
    """Interpreter with another LeRobot, to measure the module that needs LeRobot again."""


def parse_arguments(arguments: list[str] | None = None) -> Arguments:
    """Parse the command line."""
    listed = "\n".join(f"  {name:<14}{does}" for name, does in MODULES.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        epilog=f"names:\n{listed}\n\nPackages that are not installed are left out, and so is the "
        "C loop without a C compiler.\nAll together take about ten minutes; Ctrl-C keeps the "
        "finished ones.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="measure only these; the page keeps its other tables",
    )
    parser.add_argument(
        "--also",
        metavar="PYTHON",
        help=f"also measure {WITH_LEROBOT} with this interpreter, which has another LeRobot",
    )
    parsed = parser.parse_args(arguments)
    unknown = [name for name in parsed.names if name not in MODULES]
    if unknown:
        parser.error(f"expected names out of {', '.join(MODULES)}, got {', '.join(unknown)}")
    if parsed.also is not None and shutil.which(parsed.also) is None:
        parser.error(f"expected an interpreter for --also, got {parsed.also}")
    return Arguments(parsed.names or list(MODULES), parsed.also)


def measure_in_process(name: str, python: str = sys.executable) -> list[Table] | None:
    """Measure a module's tables in a new process; if it fails, print why and return None."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "tables.json"
        code = f"from benchmarks.harness import write_json; write_json({name!r}, {str(result)!r})"
        command = [python, "-c", code]
        done = subprocess.run(
            command, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False
        )
        if done.returncode:
            print(f"{name} failed:\n{done.stderr}", file=sys.stderr)
            return None
        tables = json.loads(result.read_text("utf-8"))
    return [
        Table(t["title"], t["text"], tuple(t["columns"]), [tuple(row) for row in t["rows"]])
        for t in tables
    ]


def measure_all(names: list[str], also: str | None = None) -> dict[str, str]:
    """Return module -> Markdown of its tables, for those that succeeded."""
    parts: dict[str, str] = {}
    for count, name in enumerate(names, start=1):
        start = time.perf_counter()
        print(f"[{count}/{len(names)}] {name}: {MODULES[name]} ...", file=sys.stderr, flush=True)
        try:
            tables = measure_in_process(name)
            if tables is not None and also is not None and name == WITH_LEROBOT:
                others = measure_in_process(name, also)
                tables = None if others is None else tables + others
        except KeyboardInterrupt:
            print("interrupted: writing the finished tables", file=sys.stderr)
            break
        if tables is not None:
            parts[name] = "\n\n".join(str(table) for table in tables)
            print(f"{parts[name]}\n", flush=True)
            print(f"      {time.perf_counter() - start:.0f} s", file=sys.stderr)
    return parts


def main() -> int:
    """Measure, print and write."""
    names, also = parse_arguments()
    parts = measure_all(names, also)
    if parts:
        page.update(parts, tuple(MODULES), machine.describe())
        print(f"wrote {page.PAGE.relative_to(Path(__file__).parents[1])}", file=sys.stderr)
    return 0 if len(parts) == len(names) else 1


if __name__ == "__main__":
    sys.exit(main())

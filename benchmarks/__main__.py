"""Measures every table, each in a process of its own, and writes docs/performance.md."""

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
    "observe": "learning a stream, beside a C loop and every peer",
    "nodes": "1,000 to 100,000 nodes, against the memory's bandwidth",
    "step": "one step of a control loop",
    "acting": "a control loop beside a thread that learns",
    "batch": "many percepts at once, beside faiss",
    "ensemble": "many maps in one call",
    "import_time": "imports and first calls",
    "environments": "control steps of the scenes, beside bare physics",
    "memory": "ten million samples from a generator",
    "datasets": "recording and reading datasets, beside LeRobot",
    "fit": "pacnet fit, from the command to the checkpoint",
}
WITH_LEROBOT = "datasets"


class Arguments(NamedTuple):
    """What to measure."""

    names: list[str]
    """Of the modules."""
    also: str | None
    """The interpreter with which the module that needs LeRobot is measured once more."""


def parse_arguments(arguments: list[str] | None = None) -> Arguments:
    """What the command line asks for."""
    listed = "\n".join(f"  {name:<14}{does}" for name, does in MODULES.items())
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        epilog=f"names:\n{listed}\n\nPeers that are not installed are left out, and so is the C "
        "loop without a C compiler.\nAll together take some ten minutes; Ctrl-C keeps what is "
        "done.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="measure only these; the page keeps the others"
    )
    parser.add_argument(
        "--also",
        metavar="PYTHON",
        help=f"measure {WITH_LEROBOT} with this interpreter too, whose environment has another "
        "LeRobot",
    )
    parsed = parser.parse_args(arguments)
    unknown = [name for name in parsed.names if name not in MODULES]
    if unknown:
        parser.error(f"expected names out of {', '.join(MODULES)}, got {', '.join(unknown)}")
    if parsed.also is not None and shutil.which(parsed.also) is None:
        parser.error(f"expected an interpreter for --also, got {parsed.also}")
    return Arguments(parsed.names or list(MODULES), parsed.also)


def measure_apart(name: str, python: str = sys.executable) -> list[Table] | None:
    """A module's tables, measured in a fresh process; None where it failed, and says why."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "tables.json"
        code = f"from benchmarks.harness import hand_over; hand_over({name!r}, {str(result)!r})"
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
    """Markdown of the tables by module, of those that were done; arguments as of `Arguments`."""
    parts: dict[str, str] = {}
    for count, name in enumerate(names, start=1):
        start = time.perf_counter()
        print(f"[{count}/{len(names)}] {name}: {MODULES[name]} ...", file=sys.stderr, flush=True)
        try:
            tables = measure_apart(name)
            if tables is not None and also is not None and name == WITH_LEROBOT:
                others = measure_apart(name, also)
                tables = None if others is None else tables + others
        except KeyboardInterrupt:
            print("interrupted: the page gets what is done", file=sys.stderr)
            break
        if tables is not None:
            parts[name] = "\n\n".join(str(table) for table in tables)
            print(f"{parts[name]}\n", flush=True)
            print(f"      {time.perf_counter() - start:.0f} s", file=sys.stderr)
    return parts


def main() -> int:
    """Measures, prints and writes."""
    names, also = parse_arguments()
    parts = measure_all(names, also)
    if parts:
        page.update(parts, tuple(MODULES), machine.describe())
        print(f"wrote {page.PAGE.relative_to(Path(__file__).parents[1])}", file=sys.stderr)
    return 0 if len(parts) == len(names) else 1


if __name__ == "__main__":
    sys.exit(main())

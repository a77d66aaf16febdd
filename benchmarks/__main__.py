"""Measures every table, each in a process of its own, and writes docs/performance.md."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

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


def parse_arguments(arguments: list[str] | None = None) -> list[str]:
    """The names of the modules to measure."""
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
    names = parser.parse_args(arguments).names
    unknown = [name for name in names if name not in MODULES]
    if unknown:
        parser.error(f"expected names out of {', '.join(MODULES)}, got {', '.join(unknown)}")
    return names or list(MODULES)


def measure_apart(name: str) -> list[Table] | None:
    """A module's tables, measured in a fresh process; None where it failed, and says why."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "tables.json"
        code = f"from benchmarks.harness import hand_over; hand_over({name!r}, {str(result)!r})"
        command = [sys.executable, "-c", code]
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


def measure_all(names: list[str]) -> dict[str, str]:
    """Markdown of the tables by module, of those that were done."""
    parts: dict[str, str] = {}
    for count, name in enumerate(names, start=1):
        start = time.perf_counter()
        print(f"[{count}/{len(names)}] {name}: {MODULES[name]} ...", file=sys.stderr, flush=True)
        try:
            tables = measure_apart(name)
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
    names = parse_arguments()
    parts = measure_all(names)
    if parts:
        page.update(parts, tuple(MODULES), machine.describe())
        print(f"wrote {page.PAGE.relative_to(Path(__file__).parents[1])}", file=sys.stderr)
    return 0 if len(parts) == len(names) else 1


if __name__ == "__main__":
    sys.exit(main())

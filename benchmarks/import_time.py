"""How much longer `import pacnet` takes than `import torch`: medians over fresh processes, in turn.

The project allows 0.3 s. Run it from the project's folder: `python -m benchmarks.import_time`.
"""

import argparse
import statistics
import subprocess
import sys

TIMED = "import time; start = time.perf_counter(); import {}; print(time.perf_counter() - start)"


def import_time(module: str) -> float:
    """Time that a fresh interpreter needs to import a module [s]."""
    command = [sys.executable, "-c", TIMED.format(module)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9, help="imports of each module")
    runs = parser.parse_args().runs

    import_time("pacnet")  # the first one reads from the disk and writes bytecode
    times: dict[str, list[float]] = {"torch": [], "pacnet": []}
    for _ in range(runs):
        for module, measured in times.items():
            measured.append(import_time(module))
    for module, measured in times.items():
        print(
            f"import {module:7}{statistics.median(measured):6.2f} s"
            f"  (of {runs}: {min(measured):.2f} to {max(measured):.2f})"
        )
    extra = statistics.median(times["pacnet"]) - statistics.median(times["torch"])
    print(f"pacnet beyond torch {extra:.3f} s (allowed 0.3)")


if __name__ == "__main__":
    main()

"""What both commands do about a measurement: ranges of arguments, preparations, Ctrl-C."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence

from benchmarks.metaworld.simulation import is_installed


def check_ranges(
    ranges: Mapping[str, tuple[Sequence[int], int, int]], parser: argparse.ArgumentParser
) -> None:
    """End the program if an argument is out of range.

    Args:
        ranges: option -> what was given, the least and the most of it.
        parser: ends the program.
    """
    for option, (given, least, most) in ranges.items():
        for value in given:
            if not least <= value <= most:
                parser.error(f"argument {option}: expected {least} to {most}, got {value}")


def run(measure: Callable[[], None]) -> bool:
    """Measure with one thread; return whether Ctrl-C ended it. Exit where it cannot be done."""
    if not is_installed():
        sys.exit("expected Metaworld to be installed: `make metaworld` does it, in .venv-metaworld")
    from pacnet.kernels.threads import use_one_thread

    use_one_thread()
    warnings.filterwarnings("ignore", "Constant", module="metaworld")  # actions are clipped
    try:
        measure()
    except KeyboardInterrupt:
        print("interrupted: the same command goes on from here", file=sys.stderr)
        return True
    except ValueError as error:
        sys.exit(str(error))
    return False

"""Records demonstrations of one behaviour into a LeRobot dataset, or at the end of one.

An imitator at rest watches the demonstrator, and perceives with noise what it does. Every finished
episode is on the disk, after Ctrl-C and even after a kill.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from train.behaviours import TASKS
from train.common.runs import natural, positive
from train.postural_imitation import record


def parse_arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m train.demonstrate",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("dataset", help="folder to make, or of a dataset to append to")
    parser.add_argument(
        "--behaviour", choices=tuple(TASKS), default="drink", help="what is demonstrated (drink)"
    )
    parser.add_argument(
        "--demonstrations", type=positive, default=8, help="how many, all a little different (8)"
    )
    parser.add_argument(
        "--seed", type=natural, default=0, help="decides every draw: another seed, others (0)"
    )
    return parser.parse_args()


def main() -> None:
    """Record."""
    arguments = parse_arguments()
    folder, behaviour = Path(arguments.dataset), arguments.behaviour
    try:
        record(folder, arguments.seed, arguments.demonstrations, behaviour, task=TASKS[behaviour])
    except (OSError, ValueError) as error:
        raise SystemExit(f"error: {error}") from error
    except KeyboardInterrupt:
        print(f"\nInterrupted. What was finished is in {folder}", file=sys.stderr)
        raise SystemExit(130) from None
    print(f"dataset   {folder}")


if __name__ == "__main__":
    main()

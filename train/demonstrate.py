"""Record demonstrations of one behaviour into a new LeRobot dataset, or append to one.

A resting imitator watches the demonstrator; its percepts are noisy. Finished episodes stay on disk
after Ctrl-C or a kill.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from train.common.runs import natural, positive
from train.postural.behaviours.episodes import TASKS
from train.postural.learning import record


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m train.demonstrate",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("dataset", help="folder of the dataset; appended to if it exists")
    parser.add_argument(
        "--behaviour",
        choices=tuple(TASKS),
        default="drink",
        help="behaviour to demonstrate (drink)",
    )
    parser.add_argument(
        "--demonstrations",
        type=positive,
        default=8,
        help="number of demonstrations, each a little different (8)",
    )
    parser.add_argument("--seed", type=natural, default=0, help="seed of all random numbers (0)")
    return parser.parse_args()


def main() -> None:
    """Record the demonstrations."""
    arguments = parse_arguments()
    folder, behaviour = Path(arguments.dataset), arguments.behaviour
    try:
        record(folder, arguments.seed, arguments.demonstrations, behaviour, task=TASKS[behaviour])
    except (OSError, ValueError) as error:
        raise SystemExit(f"error: {error}") from error
    except KeyboardInterrupt:
        print(f"\nInterrupted. Finished episodes are in {folder}", file=sys.stderr)
        raise SystemExit(130) from None
    print(f"dataset   {folder}")


if __name__ == "__main__":
    main()

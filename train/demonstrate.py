"""Record demonstrations of one behaviour into a new LeRobot dataset, or append to one.

A resting imitator watches the demonstrator; its percepts are noisy. With --camera they are the
demonstrator's angles and velocities and what a camera beside its head sees, and its glass stands
elsewhere in each episode. Finished episodes stay on disk after Ctrl-C or a kill.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from envs.glass_offset import MAX_OFFSET
from train.common.runs import natural, number, positive
from train.postural.behaviours.episodes import TASKS
from train.postural.learning import record
from train.postural.seeing.watching import RADIUS
from train.postural.seeing.watching import record as record_seen


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
    parser.add_argument(
        "--camera",
        action="store_true",
        help="record what a camera beside the demonstrator's head sees, instead of the glass",
    )
    parser.add_argument(
        "--radius",
        type=_radius,
        help=f"with --camera: largest distance of a glass from its usual place [m] ({RADIUS})",
    )
    arguments = parser.parse_args()
    if arguments.radius is not None and not arguments.camera:
        parser.error("expected --radius beside --camera, got it alone")
    return arguments


def _radius(text: str) -> float:
    """Parse a distance at which a whole drink is possible [m]."""
    return number(text, 0.0, MAX_OFFSET, f"a distance from 0 to {MAX_OFFSET} m")


def main() -> None:
    """Record the demonstrations."""
    arguments = parse_arguments()
    folder, behaviour = Path(arguments.dataset), arguments.behaviour
    what = (folder, arguments.seed, arguments.demonstrations, behaviour, TASKS[behaviour])
    try:
        if arguments.camera:
            radius = RADIUS if arguments.radius is None else arguments.radius
            record_seen(*what, radius=radius)
        else:
            record(*what)
    except (OSError, ValueError) as error:
        raise SystemExit(f"error: {error}") from error
    except KeyboardInterrupt:
        print(f"\nInterrupted. Finished episodes are in {folder}", file=sys.stderr)
        raise SystemExit(130) from None
    print(f"dataset   {folder}")


if __name__ == "__main__":
    main()

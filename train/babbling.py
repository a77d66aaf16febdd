"""Learn a model of the body of Experiment 1 by babbling: where is the hand in each posture?

The imitator moves its joints at random, feels their angles and sees where its hand is, both with
noise; the postures are recorded as a LeRobot dataset. Products of sines and cosines are fitted to
them, saved, loaded, and scored on postures over the whole range of the joints, beside networks and
the simulator's own kinematics. Scores, a figure and a tensorboard log go into
`runs/babbling/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from envs.humanoid import JOINTS
from pacnet import KinematicModel
from pacnet.forward_models.kinematics_fit import least_postures
from pacnet.kernels.threads import use_one_thread
from train.common.learning_log import LearningLog
from train.common.runs import (
    command_line,
    make_parser,
    positive,
    run_folder,
    save_figures,
    write_metrics,
)
from train.postural.babbling.figures import error_curves
from train.postural.babbling.recording import POSTURES, load, record
from train.postural.babbling.scores import PRODUCTS, Score, compare, held_out, score

LEAST_POSTURES = least_postures(len(JOINTS), moving=4)  # three of the shoulder, the elbow


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.babbling", __doc__)
    parser.add_argument(
        "--postures", type=positive, default=POSTURES, help="random postures to learn from"
    )
    arguments = parser.parse_args()
    if arguments.postures < LEAST_POSTURES:
        got = arguments.postures
        parser.error(f"argument --postures: expected ≥ {LEAST_POSTURES}, got {got}")
    return arguments


def main() -> None:
    """Make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    with run_folder("babbling", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Babble, fit, score and draw."""
    use_one_thread()
    seed = arguments.seed
    record(folder / "dataset", seed, arguments.postures)
    babble = load(folder / "dataset")

    begin = time.process_time()
    model, fit = KinematicModel.fitted(JOINTS, *babble)
    fit_s = time.process_time() - begin
    model.save_pretrained(folder / "checkpoint")

    model = KinematicModel.from_pretrained(folder / "checkpoint")
    truth = held_out(seed)
    own = score(model, truth, fit_s)
    compared = compare(babble, truth, seed)
    scores = {
        "postures": arguments.postures,
        "moving": list(fit.moving),
        "seen_place_rms_mm": 1000 * fit.place_rms,
        "seen_turn_rms_rad": fit.turn_rms,
        **own._asdict(),
        "ways": _as_json(compared[arguments.postures]),
        "by_postures": {str(count): _as_json(ways) for count, ways in compared.items()},
    }
    command = command_line("train.babbling", arguments)
    write_metrics(folder / "metrics.json", command, seed, scores)
    save_figures(folder / "figures", {"babbling": error_curves(compared)})
    with LearningLog(folder / "tensorboard") as log:
        log.scores(own._asdict(), "body")
        log.pictures(*sorted((folder / "figures").iterdir()))
    _print(folder, compared[arguments.postures], fit.moving)


def _as_json(ways: dict[str, Score]) -> dict[str, dict[str, Any]]:
    return {way: found._asdict() for way, found in ways.items()}


def _print(folder: Path, ways: dict[str, Score], moving: tuple[str, ...]) -> None:
    print(f"\nWhat moves the hand: {', '.join(moving)}.")
    print("Errors on postures that were not tried, over the whole range of each joint, RMS:\n")
    print(f"{'':44}{'grip [mm]':>10}{'turn [°]':>10}{'fit [s]':>9}")
    for way, found in ways.items():
        print(f"{way:44}{found.place_rms_mm:10.2f}{found.turn_rms_deg:10.2f}{found.fit_s:9.1f}")
    print(f"\nscores     {folder / 'metrics.json'}")
    print(f"figure     {folder / 'figures'}")
    print(f"model      {folder / 'checkpoint'} ({PRODUCTS})")
    print(f"to browse  tensorboard --logdir {folder / 'tensorboard'}")


if __name__ == "__main__":
    main()

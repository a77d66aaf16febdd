"""Learn a forward model for Experiment 2: how wheel speeds change the infra-red readings.

The robot wanders alone; the transitions are recorded as a LeRobot dataset. The model is fitted to
the dataset and to what the robot feels while it follows its teacher, as in the experiment. It is
saved, loaded, and scored on new wandering in an arena that it has not seen. Scores, figures and a
tensorboard log go into `runs/forward_model/<time>-seed<N>/`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from envs.khepera import INFRARED_NAMES
from pacnet import MLPForwardModel
from pacnet.forward_models.fitting import r2_of_change
from pacnet.kernels.threads import use_one_thread
from train.common.learning_log import LearningLog
from train.common.runs import (
    UNSEEN_ARENAS,
    command_line,
    make_parser,
    positive,
    run_folder,
    save_figures,
    taught_arena,
    write_metrics,
)
from train.walls.episodes import Transitions, testing_seed, wander
from train.walls.forward_model import fit, make_forward_model, walks_of
from train.walls.forward_model_figures import calibration, fit_curves
from train.walls.learning import (
    TRANSITIONS,
    follow_both_sides,
    load_wandering,
    record_wandering,
)

TEST_STEPS = 3000  # of wandering in another arena


class Predictions(NamedTuple):
    """Predicted and true changes of the readings."""

    predicted: Tensor  # change of the readings [T, 6]
    true: Tensor  # [T, 6]


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser("train.forward_model", __doc__)
    parser.add_argument(
        "--arena",
        type=taught_arena,
        default="paper",
        help="arena to wander in: paper, or the seed of a random one",
    )
    parser.add_argument(
        "--transitions", type=positive, default=TRANSITIONS, help="steps of wandering to learn from"
    )
    arguments = parser.parse_args()
    if arguments.transitions < 200:
        parser.error(f"argument --transitions: expected ≥ 200, got {arguments.transitions}")
    return arguments


def predict(model: MLPForwardModel, wandering: Transitions) -> Predictions:
    """Predict the change of the readings in one step, for every transition."""
    percepts, actions = map(torch.from_numpy, wandering)
    with torch.no_grad():
        predicted = model(percepts[:-1], actions[:-1])
    return Predictions(predicted, percepts[1:] - percepts[:-1])


def score(model: MLPForwardModel, wandering: Transitions) -> dict[str, float]:
    """Return R² of the change against persistence, for each sensor and their mean."""
    predictions = predict(model, wandering)
    r2 = r2_of_change(predictions.true, predictions.predicted)
    scores = {f"r2_{name}": float(value) for name, value in zip(INFRARED_NAMES, r2, strict=True)}
    return {"r2_mean": float(r2.mean()), **scores}


def main() -> None:
    """Make a run's folder and run the experiment in it."""
    arguments = parse_arguments()
    with run_folder("forward_model", arguments.seed, arguments.runs) as folder:
        run(arguments, folder)


def run(arguments: argparse.Namespace, folder: Path) -> None:
    """Wander, fit, score and draw."""
    use_one_thread()
    seed = arguments.seed
    record_wandering(folder / "dataset", arguments.arena, seed, arguments.transitions)
    wandering = load_wandering(folder / "dataset")

    model = make_forward_model(seed)
    followed = follow_both_sides(arguments.arena, seed)
    report, losses = fit(model, walks_of(wandering, followed), seed)
    model.save_pretrained(folder / "checkpoint")

    model = MLPForwardModel.from_pretrained(folder / "checkpoint")
    unseen = wander(UNSEEN_ARENAS + seed, TEST_STEPS, testing_seed(seed))
    scores = {
        "transitions": arguments.transitions,
        "epochs": report.epochs,
        **score(model, unseen),
        "r2_validation_mean": float(report.r2.mean()),
    }
    command = command_line("train.forward_model", arguments)
    write_metrics(folder / "metrics.json", command, seed, scores)
    figures = {
        "calibration": calibration(*predict(model, unseen), INFRARED_NAMES),
        "fit": fit_curves(*losses.T),
    }
    save_figures(folder / "figures", figures)
    _log(folder, losses, scores)
    _print(folder, scores)


def _log(folder: Path, losses: Tensor, scores: dict[str, float]) -> None:
    with LearningLog(folder / "tensorboard") as log:
        log.losses(losses.tolist())
        log.scores(scores, "prediction")
        log.pictures(*sorted((folder / "figures").iterdir()))


def _print(folder: Path, scores: dict[str, float]) -> None:
    print("\nShare of the change of each reading explained, in an unseen arena (R²; 0 is")
    print("persistence, which predicts no change):")
    for name in (*INFRARED_NAMES, "mean"):
        print(f"  {name:10}{scores[f'r2_{name}']:6.2f}")
    print(f"\nscores     {folder / 'metrics.json'}")
    print(f"figures    {folder / 'figures'}")
    print(f"model      {folder / 'checkpoint'}")
    print(f"to browse  tensorboard --logdir {folder / 'tensorboard'}")


if __name__ == "__main__":
    main()

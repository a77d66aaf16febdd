"""Which options of `pacnet fit` go together, and where it may write."""

from __future__ import annotations

import argparse
from pathlib import Path

from pacnet.cli.parsing import check_folder
from pacnet.cli.points import NONE


def check_usage(arguments: argparse.Namespace) -> None:
    """End with an error of usage where options contradict one another."""
    _check_states(arguments)
    _check_continuing(arguments)
    _check_names(arguments)
    _check_body(arguments)


def check_out(arguments: argparse.Namespace, folder: Path) -> None:
    """Raise a ValueError if writing would replace a checkpoint unasked."""
    from pacnet.cli.loading import checkpoint_folder
    from pacnet.core.checkpoint import TENSOR_FILE

    out, origin = arguments.out, arguments.origin
    check_folder("--out", out)
    continues = origin is not None and folder.resolve() == checkpoint_folder(origin).resolve()
    if (folder / TENSOR_FILE).exists() and not continues and not arguments.overwrite:
        raise ValueError(
            f"expected a folder without a checkpoint, '{out}' has one: continue from it with "
            f"--from {out}, or replace it with --overwrite"
        )


def _check_states(arguments: argparse.Namespace) -> None:
    if arguments.lead is not None and arguments.targets != "state" and arguments.origin is None:
        arguments.usage_error("argument --lead: only with --targets state")


def _check_continuing(arguments: argparse.Namespace) -> None:
    """Check what depends on whether another imitator is continued from."""
    if arguments.origin is None:
        if arguments.corrections:
            arguments.usage_error("argument --corrections: only with --from")
        return
    if arguments.held_out is not None:
        arguments.usage_error("argument --held-out: not with --from, which has learned other data")
    for option in ("targets", "lead", "budget", "points", "body", "cameras", "encoder"):
        if getattr(arguments, option) is not None:
            arguments.usage_error(f"argument --{option}: not with --from, which has its own")


def _check_names(arguments: argparse.Namespace) -> None:
    for option in ("state", "environment_state", "points", "cameras"):
        given = getattr(arguments, option) or ()
        if NONE in given and len(given) > 1:
            name = option.replace("_", "-")
            arguments.usage_error(f"argument --{name}: {NONE} only by itself")


def _check_body(arguments: argparse.Namespace) -> None:
    if arguments.body is None:
        return
    if arguments.points == [NONE]:
        arguments.usage_error("argument --body: not with --points none, it needs a landmark")
    if arguments.targets == "state":
        arguments.usage_error("argument --body: not with --targets state")

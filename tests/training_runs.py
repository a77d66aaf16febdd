"""Runs of training commands, for the tests of whatever a command leaves behind."""

import os
import signal
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

PROJECT = Path(__file__).parents[1]


def only_run(runs: Path) -> Path:
    (folder,) = runs.glob("*/*")
    return folder


def interrupt(command: Sequence[str], runs: Path, when: Callable[[str], object]) -> str:
    """Start a command, press Ctrl-C once its error stream fulfils a condition; return the stream.

    The command ends as interrupted, says where its results are, and shows no traceback.
    """
    process = subprocess.Popen(
        command,
        cwd=PROJECT,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        # A background job hands down an ignored SIGINT.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    with process:
        assert process.stderr is not None
        text = ""
        while not when(text):
            read = process.stderr.read(1)
            assert read, text
            text += read
        os.kill(process.pid, signal.SIGINT)
        text += process.stderr.read()
    assert process.returncode == 130, text
    assert f"Interrupted. Finished results are in {only_run(runs)}" in text
    assert "Traceback" not in text
    return text

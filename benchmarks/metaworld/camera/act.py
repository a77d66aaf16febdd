"""LeRobot's ACT, trained for a time on two cores, in a process of its own.

LeRobot and Metaworld need environments of their own: this end lies in Metaworld's; `act_worker`
runs where LeRobot is installed. Arrays go through pipes.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path
from typing import IO

import numpy as np

from benchmarks.metaworld.camera.recording import CAMERA
from benchmarks.metaworld.camera.world import Picture
from benchmarks.metaworld.features import ACTION, Array
from pacnet.datasets.demonstrations import Demonstrations

PYTHON = "PACNET_LEROBOT_PYTHON"  # a variable: the Python that has LeRobot
ROOT = Path(__file__).parents[3]
USUAL = ROOT / ".venv" / "bin" / "python"
THREADS = 2
RESET = b"r"
FRAME = b"f"


class ActionChunks:
    """A policy of LeRobot that is trained and asked in another process."""

    sees, note = True, ""
    _process: subprocess.Popen[bytes] | None = None

    def learn(self, demonstrations: Demonstrations) -> None:
        """Train the policy.

        Raises:
            ValueError: no Python with LeRobot.
        """
        python = Path(os.environ.get(PYTHON, USUAL))
        if not python.exists():
            raise ValueError(
                f"expected a Python that has LeRobot in {USUAL.relative_to(ROOT)} (`make setup`), "
                f"or named by {PYTHON}, got none"
            )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "shown.npz"
            shown = list(demonstrations)
            np.savez(
                path,
                states=np.concatenate([one.state.numpy() for one in shown]),
                actions=np.concatenate([one.action.numpy() for one in shown]),
                pictures=np.concatenate([one.pictures[CAMERA] for one in shown]),
                lengths=[len(one.state) for one in shown],
            )
            environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": str(THREADS)}
            self._process = subprocess.Popen(
                [python, "-m", "benchmarks.metaworld.camera.act_worker", path],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
            )
            self.note = self._pipes()[1].readline().decode().strip()

    def reset(self) -> None:
        """Start an episode."""
        self._send(RESET)

    def act(self, state: Array, picture: Picture) -> Array:
        """Return the action `[4]`."""
        self._send(FRAME + state.astype(np.float32).tobytes() + picture.tobytes())
        answer = self._pipes()[1].read(4 * len(ACTION))
        return np.frombuffer(answer, np.float32)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._pipes()[0].close()
            self._process.wait()

    def _send(self, message: bytes) -> None:
        pipe = self._pipes()[0]
        pipe.write(message)
        pipe.flush()

    def _pipes(self) -> tuple[IO[bytes], IO[bytes]]:
        """Return the process's input and output."""
        process = self._process
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        return process.stdin, process.stdout

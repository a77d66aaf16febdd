"""What docs/lerobot.md shows is true: its commands and its Python run, in the order of the page."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch

PROJECT = Path(__file__).parents[2]
PAGE = (PROJECT / "docs/lerobot.md").read_text()
BLOCKS = re.findall(r"^```(sh|python)\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)


def run(language: str, code: str, folder: Path) -> None:
    """Run a block of the page in a folder outside the clone, as the page says to set it up."""
    python = [sys.executable, "-W", "error::DeprecationWarning:__main__", "-c"]
    program = ["bash", "-euc"] if language == "sh" else python
    commands = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    found = os.pathsep.join(filter(None, [str(PROJECT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [*program, code],
        cwd=folder,
        env={**os.environ, "PATH": commands, "PYTHONPATH": found, "CLONE": str(PROJECT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0, f"{code}\n{done.stdout[-3000:]}"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The video decoding and encoding:UserWarning")
def test_the_page_runs_from_its_top_to_its_end(tmp_path: Path):
    from pictures import write_pictures

    from pacnet.imitator.imitator import Imitator

    write_pictures(tmp_path / "with_images", "image")
    for language, code in BLOCKS:
        run(language, code, tmp_path)

    # After one pass the policy is what `pacnet fit` makes of the same dataset.
    fitted = Imitator.from_pretrained(tmp_path / "imitator").state_dict()
    checkpoint = tmp_path / "training/checkpoints/last/pretrained_model/imitator"
    trained = Imitator.from_pretrained(checkpoint).state_dict()
    assert all(torch.equal(tensor, trained[name]) for name, tensor in fitted.items())


def test_the_page_shows_each_command():
    shown = "\n".join(code for language, code in BLOCKS if language == "sh")
    for command in ("fit", "info", "watch", "export", "explain"):
        assert f"pacnet {command} " in shown
    for command in ("lerobot-train", "lerobot-eval", "python -m train.correct"):
        assert command in shown


def test_its_files_are_there():
    for path in set(re.findall(r"`((?:pacnet|tests)/[\w/]+\.py)`", PAGE)):
        assert (PROJECT / path).is_file(), path

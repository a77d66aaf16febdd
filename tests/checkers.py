"""Independent checkers of datasets, `robovet` and `rdq`, for the tests of whatever writes one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


def assert_clean(dataset: Path, fail_under: int = 95) -> None:
    """Neither checker finds anything wrong, and `rdq` gives so many points of 100."""
    for command in ("robovet doctor", f"rdq check --no-color --fail-under {fail_under}"):
        name, *arguments = command.split()
        program = shutil.which(name, path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
        if program is None:
            pytest.skip(f"{name} is not installed")
        done = subprocess.run(
            [program, *arguments, str(dataset)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout
        assert "WARN" not in done.stdout, done.stdout
        assert "CRITICAL" not in done.stdout, done.stdout

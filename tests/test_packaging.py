"""Claims about what `import pacnet` costs and what the wheel holds."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]
LEFT_OUT = (
    "matplotlib",
    "lerobot",
    "numba",
    "pyarrow",
    "dm_control",
    "gymnasium",
    "safetensors",
    "mujoco",
    "tensorboard",
)


def test_importing_pacnet_imports_torch_and_numpy_alone():
    code = f"import sys, pacnet; print(sorted(set({LEFT_OUT}) & set(sys.modules)))"

    done = subprocess.run(
        [sys.executable, "-c", code], cwd=PROJECT, capture_output=True, text=True, check=True
    )

    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_the_wheel_holds_pacnet_alone(tmp_path: Path):
    source = tmp_path / "source"
    ignored = shutil.ignore_patterns(".*", "__pycache__", "build", "*.egg-info", "runs")
    shutil.copytree(PROJECT, source, ignore=ignored)

    command = "from setuptools.build_meta import build_wheel; print(build_wheel('..'))"
    done = subprocess.run(
        [sys.executable, "-c", command], cwd=source, capture_output=True, text=True, check=True
    )

    wheel = tmp_path / done.stdout.split()[-1]
    names = set(zipfile.ZipFile(wheel).namelist())
    library = {name for name in names if not name.split("/")[0].endswith(".dist-info")}
    expected = {
        path.relative_to(PROJECT).as_posix()
        for path in (PROJECT / "pacnet").rglob("*")
        if path.suffix == ".py" or path.name == "py.typed"
    }
    assert library == expected
    assert any(name.endswith("/licenses/LICENSE") for name in names)

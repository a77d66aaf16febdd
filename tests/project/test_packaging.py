"""Claims about what `import pacnet` costs and what the wheel holds."""

import importlib.metadata
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import pacnet

PROJECT = Path(__file__).parents[2]
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


def loaded(code: str, modules: tuple[str, ...]) -> str:
    """Which of the modules a new process has loaded after running the code."""
    code = f"import sys; {code}; print(*sorted(set({modules}) & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=PROJECT, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_the_names_of_pacnet_need_torch_and_numpy_alone():
    assert loaded("from pacnet import *; PACNet", LEFT_OUT) == ""


def test_the_command_line_explains_itself_without_torch():
    assert loaded("import pacnet.cli; pacnet.cli.make_parser()", ("torch", "numpy")) == ""


def test_the_version_is_that_of_pyproject_and_needs_no_torch():
    declared = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["version"]
    assert pacnet.__version__ == declared
    assert "__version__" in dir(pacnet)
    assert loaded("import pacnet; pacnet.__version__", ("torch", "numpy")) == ""


def test_without_an_installed_distribution_the_version_is_unknown(monkeypatch: pytest.MonkeyPatch):
    def missing(name: str) -> str:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", missing)
    assert pacnet.__version__ == "0+unknown"


def test_pacnet_has_the_names_that_it_lists_and_no_others():
    assert set(pacnet.__all__) <= set(dir(pacnet))
    assert all(getattr(pacnet, name) is not None for name in pacnet.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Teacher'"):
        pacnet.Teacher  # noqa: B018


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

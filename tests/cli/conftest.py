"""Datasets and a checkpoint that the tests of all commands share."""

from pathlib import Path

import pytest
from command_line import record, run


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("data") / "shown", ("drink", "wave") * 3, 1000)


@pytest.fixture(scope="session")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What was shown, and something that was not."""
    return record(tmp_path_factory.mktemp("data") / "others", ("wave", "drink", "juggle"), 1001)


@pytest.fixture(scope="session")
def imitator(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint that the command wrote."""
    folder = tmp_path_factory.mktemp("checkpoint") / "imitator"
    assert run("fit", dataset, "--out", folder) == 0
    return folder

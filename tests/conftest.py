"""What several test modules need: processes to be killed."""

import multiprocessing
from multiprocessing.context import ForkServerContext

import pytest


@pytest.fixture(scope="session")
def forks() -> ForkServerContext:
    """Forks processes from one that has imported everything, so each costs milliseconds."""
    context = multiprocessing.get_context("forkserver")
    # What the test modules import; Python 3.11 cannot find the modules themselves there.
    context.set_forkserver_preload(
        ["pytest", "pyarrow.parquet", "pacnet.datasets", "pacnet.network"]
    )
    return context

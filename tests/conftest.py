"""What several test modules need: processes to be killed, and a cache of their own."""

import multiprocessing
from collections.abc import Iterator
from multiprocessing.context import ForkServerContext

import pytest


@pytest.fixture(scope="session")
def forks() -> ForkServerContext:
    """Forks processes from one that has imported everything, so each costs milliseconds."""
    context = multiprocessing.get_context("forkserver")
    # What the test modules import, and what recording does; Python 3.11 cannot find the modules
    # themselves there.
    context.set_forkserver_preload(
        ["pytest", "pandas", "pyarrow.parquet", "pacnet.datasets.journal.folding", "pacnet.network"]
    )
    return context


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep decoded pictures out of the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PACNET_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield

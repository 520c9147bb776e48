"""What tests of several kinds share."""

from __future__ import annotations

import os
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

# As the command `gfm` does, and before NumPy is loaded: arrays are small, threads would only wait.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest

from gfm.core import Trajectory
from gfm.importing import imported, load_mapping
from gfm.recording import write_recording
from swings import swing

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
MEASURED = DATA / "measured"

# A shell starts what it puts in the background with SIGINT ignored, and whatever that starts
# inherits it. Services under test are told to stop by SIGINT, so it has to reach them.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keeps together, where tests are shared out, those of a module: they share what it takes long
    to make. Those that start services go one after the other: each needs the machine in time.
    """
    for item in items:
        module = item.nodeid.split("::", maxsplit=1)[0]
        group = "services" if module.startswith("tests/integration") else module
        item.add_marker(pytest.mark.xdist_group(group))


@pytest.fixture(scope="session")
def data() -> Path:
    """The recordings at hand, outside the repository: as for `measured`."""
    if not DATA.is_dir() and os.environ.get("CI") != "true":
        pytest.skip(f"no recordings in {DATA}")
    assert DATA.is_dir(), f"no recordings in {DATA}"
    return DATA


@pytest.fixture(scope="session")
def measured() -> Callable[[str, str], list[Trajectory]]:
    """Imports recordings of others by a pattern and a mapping.

    The data stay outside the repository: on a user's machine that lacks them the test is skipped,
    in CI it fails.
    """

    def load(pattern: str, mapping: str) -> list[Trajectory]:
        paths = sorted(MEASURED.glob(pattern))
        if not paths and os.environ.get("CI") != "true":
            pytest.skip(f"no measured data {pattern} in {MEASURED}")
        assert paths, f"no measured data {pattern} in {MEASURED}"
        return list(imported(paths, load_mapping(ROOT / "models" / "mappings" / mapping)))

    return load


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """A recording of `swings.swing`."""
    write_recording(tmp_path / "swing.mcap", swing())
    return tmp_path / "swing.mcap"


@pytest.fixture
def full_disk() -> Callable[[int], AbstractContextManager[None]]:
    """Returns a context in which no file grows beyond some bytes: to a writer, a full disk."""

    @contextmanager
    def full(limit_bytes: int) -> Iterator[None]:
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return full

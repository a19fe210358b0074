import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactile_fem import ranks
from tactile_fem.finger.load import shipped_file
from tactile_fem.logs import PACKAGE
from tactile_fem.study import Finger

os.environ.update(ranks.SHARED_CORES)


@pytest.fixture(scope="session")
def small_finger() -> Path:
    """The shipped finger of 3,000 tetrahedra."""
    path = shipped_file(Finger(pad_size_mm=3.0, far_size_mm=6.0))
    assert path is not None
    return path


@pytest.fixture(autouse=True)
def no_log_left() -> Iterator[None]:
    """Take away what a test's command set up: it would write to that test's closed stderr."""
    package = logging.getLogger(PACKAGE)
    handlers, level, propagate = package.handlers[:], package.level, package.propagate
    yield
    package.handlers[:] = handlers
    package.setLevel(level)
    package.propagate = propagate

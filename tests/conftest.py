import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactile_fem import ranks
from tactile_fem.finger import build_finger, write_msh
from tactile_fem.logs import PACKAGE
from tactile_fem.study import Finger

os.environ.update(ranks.SHARED_CORES)


@pytest.fixture(scope="session")
def small_finger(tmp_path_factory) -> Path:
    """A finger of 2,000 tetrahedra."""
    path = tmp_path_factory.mktemp("mesh") / "small.msh"
    write_msh(path, build_finger(Finger(pad_size_mm=3.0, far_size_mm=6.0)))
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

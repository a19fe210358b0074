import faulthandler
import gc
import logging
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hidden import (  # noqa: F401
    pytest_collection,
    pytest_collection_modifyitems,
    pytest_fixture_setup,
    pytest_runtest_protocol,
    pytest_runtest_setup,
)

from tactile_fem.runtime import ranks
from tactile_fem.runtime.logs import PACKAGE
from tactile_fem.study import Finger, Neuron, Output, Protocol, Receptors, Solver, Study, Text

os.environ.update(ranks.SHARED_CORES)
# The compiler then takes less than half the time, and the forms half as much again.
os.environ.setdefault("TACTILE_FEM_O3", "-O1")


@pytest.fixture(scope="session")
def small_finger() -> Path:
    """The shipped finger of 3,000 tetrahedra."""
    path = Finger(pad_size_mm=3.0, far_size_mm=6.0).shipped_file()
    assert path is not None
    return path


@pytest.fixture(scope="session")
def study(small_finger) -> Study:
    """A short press and slide over letters, during which all receptors fire."""
    return Study(
        finger=Finger(mesh_file=small_finger),
        stimulus=Text(text="FG"),
        protocol=Protocol(depth_mm=0.5, distance_mm=0.4, output_mm=0.2),
        receptors=Receptors(spacing_mm=2.5),
        neuron=Neuron(model="hamasaki2020", static_gain_pA_per_kPa=3e4),
        # Scans are compared, and what Newton's method leaves magnifies rounding a millionfold.
        solver=Solver(first_slide_step_mm=0.05, petsc={"snes_atol": 1e-11}),
        output=Output(pictures=False, states_mm=0.2),
    )


@pytest.fixture(scope="session")
def finished(study, tmp_path_factory):
    """Its scan on one rank; what is in the folder is not to be changed."""
    from tactile_fem import scan

    return scan(study, tmp_path_factory.mktemp("scan") / "results")


@pytest.fixture(autouse=True)
def no_log_left() -> Iterator[None]:
    """Take away what a test's command set up: it would write to that test's closed stderr."""
    package = logging.getLogger(PACKAGE)
    handlers, level, propagate = package.handlers[:], package.level, package.propagate
    yield
    package.handlers[:] = handlers
    package.setLevel(level)
    package.propagate = propagate


# --- several ranks: see on_two_ranks.py -----------------------------------------------------------

RANK = ranks.launched_rank()
LONGEST_S = 300.0


if RANK is not None:
    from tactile_fem.runtime import backend  # noqa: F401

    from mpi4py import MPI  # isort: skip
    from petsc4py import PETSc

    from tactile_fem.runtime.ranks import abort_if_one_fails
    from tactile_fem.solvers import finger_problem

    # What ranks free together is collected between tests, not whenever one of them has garbage.
    gc.disable()

    @pytest.hookimpl(trylast=True)
    def pytest_configure(config):
        """Let rank 0 alone report."""
        if RANK != 0:
            config.pluginmanager.unregister(name="terminalreporter")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(item):
        """Let no rank wait for one that failed: it ends all, as does a test that hangs."""
        faulthandler.dump_traceback_later(LONGEST_S, exit=True)
        try:
            with abort_if_one_fails(MPI.COMM_WORLD):
                return (yield)
        finally:
            faulthandler.cancel_dump_traceback_later()

    @pytest.fixture
    def tmp_path(tmp_path):
        """Give all ranks the folder of rank 0."""
        return MPI.COMM_WORLD.bcast(tmp_path)

    @pytest.fixture(autouse=True)
    def communicators_given_back():
        """Close the test's solvers, which several ranks keep: MPI's communicators are few."""
        before = set(finger_problem._OPEN)
        yield
        for opened in [opened for opened in finger_problem._OPEN if opened not in before]:
            opened.close()
        gc.collect()
        PETSc.garbage_cleanup(MPI.COMM_WORLD)

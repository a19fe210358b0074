"""What a scan will need, said at its start."""

from __future__ import annotations

import logging

import pytest

from tactile_fem import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from tactile_fem.mechanics import estimate as module
from tactile_fem.mechanics.estimate import announce, available_memory_MB, estimate
from tactile_fem.study import Protocol, Solver, Study

COARSE, PAPER = 37_332, 331_596


def test_a_finer_mesh_needs_more_and_a_second_rank_saves_time():
    coarse, paper = estimate(Study(), COARSE, 1), estimate(Study(), PAPER, 1)
    assert 8 < paper.wall_s / coarse.wall_s < 16
    assert paper.memory_MB > 4 * coarse.memory_MB
    two = estimate(Study(), PAPER, 2)
    assert paper.wall_s / 2 < two.wall_s < paper.wall_s
    assert two.memory_MB > paper.memory_MB


def test_half_the_way_takes_half_the_time():
    half = Study(protocol=Protocol(depth_mm=1.97, distance_mm=5.0))
    ratio = estimate(half, COARSE, 1).wall_s / estimate(Study(), COARSE, 1).wall_s
    assert 0.5 < ratio < 0.65


def test_direct_factors_cost_memory_and_time():
    direct = estimate(Study(solver=Solver(linear="direct")), PAPER, 1)
    multigrid = estimate(Study(), PAPER, 1)
    assert direct.memory_MB > 2 * multigrid.memory_MB
    assert direct.wall_s > 10 * multigrid.wall_s


@pytest.mark.parametrize(("free", "warned"), [(100.0, True), (1e6, False), (None, False)])
def test_too_little_memory_is_said(caplog, monkeypatch, free, warned):
    monkeypatch.setattr(module, "available_memory_MB", lambda: free)
    package = logging.getLogger("tactile_fem")
    monkeypatch.setattr(package, "propagate", True)
    with caplog.at_level(logging.INFO, logger="tactile_fem"):
        announce(Study(), PAPER, MPI.COMM_SELF)
    assert "expect about" in caplog.text
    assert ("are free" in caplog.text) == warned


def test_free_memory_is_known_here():
    free = available_memory_MB()
    assert free is None or 100 < free < 1e8

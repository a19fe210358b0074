"""What a scan will need, said at its start."""

from __future__ import annotations

import logging
import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from tactile_fem.simulation import estimate as module
from tactile_fem.simulation.estimate import announce, available_memory_MB, estimate
from tactile_fem.study import Finger, Press, Protocol, Push, Solver, Study

COARSE, PAPER = 37_332, 331_596
STEPS = 125
# Whole scans on one and two ranks: unknowns, ranks, memory of all ranks (GB), wall time (s).
MEASURED = [
    (COARSE, 1, 0.50, 93),
    (COARSE, 2, 0.78, 57),
    (103_530, 1, 1.05, 251),
    (103_530, 2, 1.37, 151),
    (PAPER, 1, 2.79, 914),
    (PAPER, 2, 3.40, 532),
]


def of(study: Study, unknowns: float, ranks: float) -> module.Cost:
    """Return what a study on the default finger needs; a press to a force goes 4 mm deep."""
    return estimate(study, study.protocol.route(4.0), int(unknowns), int(ranks))


@pytest.mark.parametrize(("unknowns", "ranks", "GB", "wall_s"), MEASURED)
def test_measured_scans_are_foretold(unknowns, ranks, GB, wall_s):
    found = of(Study(), unknowns, ranks)
    assert found.memory_MB == pytest.approx(1000 * GB, rel=0.15)
    assert found.wall_s == pytest.approx(wall_s, rel=0.25)


def test_half_the_slide_spares_its_steps():
    """Fifty steps of 0.1 mm."""
    half = Study(protocol=Protocol(distance_mm=5.0))
    ratio = of(half, COARSE, 1).wall_s / of(Study(), COARSE, 1).wall_s
    assert ratio == pytest.approx(1 - 50 / STEPS, abs=0.02)


def test_a_held_force_takes_more_solves():
    to_force, held = (Study(protocol=Protocol(force_N=0.5, hold=h)) for h in ("depth", "force"))
    ratio = of(held, COARSE, 1).wall_s / of(to_force, COARSE, 1).wall_s
    assert 1.4 < ratio < 1.8


def test_loads_in_several_directions_take_more_solves():
    """On the small finger, 25.4 Newton iterations a step for X, Y and Z, and 16.5 for Z."""
    press = Press(depth_mm=1.0)
    one, three = (
        Study(protocol=Protocol(path=(press, Push(time_s=50.0, output_s=0.25, **loads))))
        for loads in ({"normal_N": 0.5}, {"normal_N": 0.5, "tangential_N": (0.1, 0.05)})
    )
    ratio = of(three, COARSE, 1).wall_s / of(one, COARSE, 1).wall_s
    assert ratio == pytest.approx(25.4 / 16.5, rel=0.1)


def test_direct_factors_cost_memory_and_time_as_measured():
    """An iteration of the coarse finger took 3.9 s, one with multigrid 0.20 s."""
    direct = of(Study(solver=Solver(linear="direct")), COARSE, 1)
    times = direct.wall_s / of(Study(), COARSE, 1).wall_s
    assert times == pytest.approx(3.9 / 0.20, rel=0.3)
    assert direct.memory_MB == pytest.approx(830, rel=0.2)


def test_a_section_costs_what_was_measured():
    section = Study(finger=Finger(kind="section"))
    assert of(section, 9_814, 1).wall_s == pytest.approx(17, rel=0.25)
    assert of(section, 60_988, 1).memory_MB == pytest.approx(420, rel=0.1)


@pytest.mark.parametrize(("free", "warned"), [(100.0, True), (1e6, False), (None, False)])
def test_too_little_memory_is_said(caplog, monkeypatch, free, warned):
    monkeypatch.setattr(module, "available_memory_MB", lambda: free)
    package = logging.getLogger("tactile_fem")
    monkeypatch.setattr(package, "propagate", True)
    path, problem = Protocol().route(4.0), SimpleNamespace(unknowns=PAPER)
    simulation = SimpleNamespace(study=Study(), path=path, problem=problem, comm=MPI.COMM_SELF)
    with caplog.at_level(logging.INFO, logger="tactile_fem"):
        announce(simulation)
    assert "expect about" in caplog.text
    assert ("are free" in caplog.text) == warned


MEMINFO = "MemTotal: 16000000 kB\nMemFree: 1000000 kB\nMemAvailable: 8000000 kB\n"  # 8192 MB


@pytest.mark.parametrize(
    ("meminfo", "limit", "free_MB"),
    [
        (MEMINFO, None, 8192.0),
        (MEMINFO, "max", 8192.0),
        (MEMINFO, "4000000000", 3000.0),  # of which 1 GB is used
        (MEMINFO, "64000000000", 8192.0),
        ("MemTotal: 16000000 kB\n", "4000000000", None),
        (None, None, None),
    ],
)
def test_free_memory_heeds_what_a_container_may_use(tmp_path, monkeypatch, meminfo, limit, free_MB):
    used = None if limit is None else "1000000000"
    files = {
        "proc/meminfo": meminfo,
        "sys/fs/cgroup/memory.max": limit,
        "sys/fs/cgroup/memory.current": used,
    }
    for name, text in files.items():
        if text is not None:
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(f"{text}\n")
    monkeypatch.setattr(module, "FilePath", lambda name: tmp_path / name.lstrip("/"))
    assert available_memory_MB() == free_MB


@pytest.mark.skipif(not Path("/proc/meminfo").exists(), reason="free memory is told by Linux only")
def test_free_memory_of_this_machine_is_part_of_its_whole():
    whole_MB = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e6
    free_MB = available_memory_MB()
    assert free_MB is not None and 0 < free_MB <= whole_MB

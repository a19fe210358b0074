"""What a scan will need, said at its start."""

from __future__ import annotations

import logging
import os
import re
from pathlib import Path

import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from tactile_fem.simulation import estimate as module
from tactile_fem.simulation.estimate import announce, available_memory_MB, estimate
from tactile_fem.study import Finger, Protocol, Solver, Study

BENCHMARKS = Path(__file__).resolve().parents[1] / "demos" / "benchmarks" / "README.md"
COARSE, PAPER = 37_332, 331_596
# The table of whole scans was measured on slow days, by this factor (stated below the table).
SLOW = 2.45
NOW = 0.41  # of the time that the table's solver took


def measured(row: str) -> list[float]:
    """Return the numbers in a row of the table of whole scans, coarse, medium, paper."""
    (found,) = re.findall(rf"^\| \**{row}\** \|(.+)$", BENCHMARKS.read_text(), re.MULTILINE)
    return [float(cell) for cell in re.findall(r"[\d.]+", found.replace(",", ""))]


def of(study: Study, unknowns: float, ranks: float) -> module.Estimate:
    """Return what a study on the default finger needs; a press to a force goes 4 mm deep."""
    return estimate(study, study.protocol.route(4.0), int(unknowns), int(ranks))


UNKNOWNS = [count for count in measured("unknowns") for _ in (1, 2)]
SCANS = list(zip(UNKNOWNS, measured("ranks"), strict=True))


def test_the_table_is_that_of_three_sizes_on_one_and_two_ranks():
    assert [(COARSE, 1), (PAPER, 2)] == [SCANS[0], SCANS[-1]] and len(SCANS) == 6
    assert f"factor of {SLOW}" in BENCHMARKS.read_text()


def test_memory_is_that_of_measured_scans():
    for (unknowns, ranks), GB in zip(SCANS, measured("memory of all ranks"), strict=True):
        expected = pytest.approx(1000 * GB, rel=0.05 if ranks == 2 else 0.15)
        assert of(Study(), unknowns, ranks).memory_MB == expected, (unknowns, ranks)


def test_time_is_that_of_measured_scans():
    assert f"factor of {NOW}" in BENCHMARKS.read_text()
    minutes = measured("wall time, on slow days")
    for (unknowns, ranks), slow in zip(SCANS, minutes, strict=True):
        expected = pytest.approx(60 * slow / SLOW * NOW, rel=0.25)
        assert of(Study(), unknowns, ranks).wall_s == expected, (unknowns, ranks)


def test_half_the_slide_spares_its_steps():
    # 125 steps as measured, of which 50, of 0.1 mm, belong to a half of the slide.
    (steps,) = set(measured("steps"))
    half = Study(protocol=Protocol(distance_mm=5.0))
    ratio = of(half, COARSE, 1).wall_s / of(Study(), COARSE, 1).wall_s
    assert ratio == pytest.approx(1 - 50 / steps, abs=0.02)


def test_a_held_force_takes_more_solves():
    to_force, held = (Study(protocol=Protocol(force_N=0.5, hold=h)) for h in ("depth", "force"))
    ratio = of(held, COARSE, 1).wall_s / of(to_force, COARSE, 1).wall_s
    assert 1.4 < ratio < 1.8


def test_direct_factors_cost_memory_and_time_as_measured():
    numbers = r"iteration took ([\d.]+) s and the scan ([\d.]+) GB; with multigrid\n([\d.]+) s"
    ((seconds, GB, multigrid_s),) = re.findall(numbers, BENCHMARKS.read_text())
    direct = of(Study(solver=Solver(linear="direct")), COARSE, 1)
    times = direct.wall_s / of(Study(), COARSE, 1).wall_s
    assert times == pytest.approx(float(seconds) / (NOW * float(multigrid_s)), rel=0.3)
    assert direct.memory_MB == pytest.approx(1000 * float(GB), rel=0.2)


def test_a_section_costs_what_was_measured():
    """The steps of the default one; a ridged one of 60,988 unknowns took 0.42 GB."""
    text = (BENCHMARKS.parents[1] / "pages" / "expect.md").read_text()
    seconds = re.search(r"2,568 triangles, 120 steps\) took .+\n(\d+) s of them the steps", text)
    section = Study(finger=Finger(kind="section"))
    assert of(section, 9_814, 1).wall_s == pytest.approx(float(seconds[1]), rel=0.25)
    assert of(section, 60_988, 1).memory_MB == pytest.approx(420, rel=0.1)


@pytest.mark.parametrize(("free", "warned"), [(100.0, True), (1e6, False), (None, False)])
def test_too_little_memory_is_said(caplog, monkeypatch, free, warned):
    monkeypatch.setattr(module, "available_memory_MB", lambda: free)
    package = logging.getLogger("tactile_fem")
    monkeypatch.setattr(package, "propagate", True)
    with caplog.at_level(logging.INFO, logger="tactile_fem"):
        announce(Study(), Protocol().route(4.0), PAPER, MPI.COMM_SELF)
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

"""Every demo runs at small size and prints its numbers."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tactile_fem import ranks

DEMOS = Path(__file__).resolve().parents[1] / "demos"


def run(name: str, *arguments: str) -> str:
    return run_command(sys.executable, str(DEMOS / name), *arguments)


def run_command(*command: str) -> str:
    finished = subprocess.run(command, check=True, capture_output=True, text=True)
    return finished.stdout


def number(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


@pytest.mark.slow
def test_letters(tmp_path):
    told = run("letters.py", str(tmp_path / "out"), "--depth", "0.3", "--distance", "0.2")
    assert number(r"normal force at 0.30 mm +([\d.]+) N", told) == pytest.approx(0.0125, rel=0.2)
    assert number(r"minus reaction +([\d.e+-]+) N", told) < 1e-5
    assert (tmp_path / "out" / "figures" / "raster.png").is_file()


@pytest.mark.slow
def test_flat_plate(tmp_path):
    told = run("flat_plate.py", str(tmp_path / "plate.png"), "--depth", "0.5")
    force = number(r"0\.5 +([\d.]+) +0\.037", told)
    # Within two standard deviations of the measured mean.
    assert force == pytest.approx(0.037, abs=0.020)
    assert (tmp_path / "plate.png").is_file()


@pytest.mark.slow
def test_cost(tmp_path):
    sizes = ["--sizes", "3.0,6.0", "--sizes", "2.2,5.0"]
    way = ["--ranks", "1", "--depth", "0.15", "--distance", "0"]
    told = run("benchmarks/cost.py", str(tmp_path), *sizes, *way)
    assert 0.2 < number(r"seconds grow with unknowns\^([\d.]+)", told) < 3
    rows = json.loads((tmp_path / "costs.json").read_text())
    assert [row["ranks"] for row in rows] == [1, 1]
    assert rows[1]["unknowns"] > rows[0]["unknowns"] > 3000
    for row in rows:
        assert row["linear"] >= row["newton"] > 0 and row["force_N"] > 0
        assert 0 < row["assembly_s"] + row["linear_s"] + row["set_up_s"] < row["seconds"]


@pytest.mark.slow
def test_hard_states(tmp_path):
    few = ["--moments", "first touch", "--steps", "1"]
    strategies = ["--strategies", "default", "--strategies", "secant (l2)"]
    told = run("benchmarks/hard_states.py", str(tmp_path), *few, *strategies)
    rows = [line.split() for line in told.splitlines() if "first touch" in line]
    assert len(rows) == 2
    assert all(row[-6] == "1" and row[-5] == "0" for row in rows)  # one step, no failure
    assert (tmp_path / "strategies.csv").is_file()


@pytest.mark.slow
def test_calculix(tmp_path):
    way = ["--pad-size", "3", "--far-size", "6", "--rows", "1", "--depth", "0.2"]
    way += ["--press-step", "0.1", "--distance", "0.05", "--slide-step", "0.05", "--cores", "1"]
    told = run("benchmarks/calculix.py", str(tmp_path), "--stimulus", "plate", *way)
    if not shutil.which("ccx"):
        assert "not installed" in told
        return
    ours, theirs = map(float, re.search(r"press normal N +(\S+) +(\S+)", told).groups())
    assert ours == pytest.approx(theirs, rel=0.02)
    assert (tmp_path / "comparison.csv").is_file()


@pytest.mark.slow
@pytest.mark.skipif(not find_spec("gmsh"), reason="gmsh is not installed")
def test_hertz(tmp_path):
    run("verification/hertz.py", str(tmp_path), "--per-radius", "4", "--body-radius", "20")
    with (tmp_path / "hertz.csv").open() as table:
        rows = {row["shape"]: row for row in csv.DictReader(table)}
    assert set(rows) == {"ball", "bar"}
    for row in rows.values():
        assert float(row["radius_error"]) == pytest.approx(0, abs=0.02)
        assert float(row["peak_error"]) == pytest.approx(0, abs=0.02)
    assert (tmp_path / "hertz.png").is_file()


@pytest.mark.slow
def test_sharp_block(tmp_path):
    way = ["--meshes", "2", "--gammas", "5", "--thetas", "0"]
    run("verification/sharp_block.py", str(tmp_path), *way)
    with (tmp_path / "sharp_block.csv").open() as table:
        (row,) = csv.DictReader(table)
    assert not row["failed"]
    assert float(row["tangential_N"]) / float(row["normal_N"]) == pytest.approx(0.3, rel=0.01)
    assert (tmp_path / "sharp_block.png").is_file()


@pytest.mark.mpi
def test_partition():
    script = str(DEMOS / "benchmarks/partition.py")
    told = run_command(ranks.launcher(), "-n", "3", sys.executable, script)
    cells = re.search(r"cells +(\d+) +([\d.]+) +(\d+)", told)
    assert cells and float(cells[2]) * 3 == pytest.approx(8576, abs=1)
    assert number(r"lines cut +(\d+)", told) >= 0


def test_every_demo_is_tested():
    tested = set(re.findall(r'"((?:\w+/)?\w+\.py)"', Path(__file__).read_text()))
    # What has no title is a module that demos share.
    demos = (path for path in DEMOS.glob("**/*.py") if path.read_text().startswith("# %%"))
    assert tested == {str(path.relative_to(DEMOS)) for path in demos}

"""Scripts that compare with exact solutions and other codes, at small size."""

from __future__ import annotations

import csv
import json
import re
import runpy
import shutil
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from needs import needs_gmsh
from scripts import DEMOS, SMALL, beside, imports, number, run, start


@pytest.mark.parametrize(
    "path",
    [*DEMOS.glob("verification/*.py"), *DEMOS.glob("benchmarks/*.py")],
    ids=lambda path: path.stem,
)
def test_what_a_script_imports_exists(path):
    imports(path)


@pytest.mark.slow
def test_locking(tmp_path):
    way = ["--presets", "coarse", "--depth", "0.3", *SMALL]
    run("verification/locking.py", str(tmp_path), *way)
    with (tmp_path / "locking.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert [float(row["locking_ratio"]) for row in rows] == [25.0, 1e9, 25.0]
    ratio, same, softer = (float(row["bulk_over_shear"]) for row in rows)
    assert ratio == same == pytest.approx(10 * softer, rel=0.02)
    unlocked, force, less = (float(row["force_N"]) for row in rows)
    assert force > unlocked > less > 0


@pytest.mark.slow
@needs_gmsh
def test_calculix(tmp_path):
    way = ["--pad-size", "2", "--depth", "0.6", "--press-step", "0.2"]
    way += ["--distance", "0.6", "--slide-step", "0.2"]
    output = run("verification/calculix.py", str(tmp_path), "pad", *way)
    if not shutil.which("ccx"):
        assert "not installed" in output
        return
    assert number(r"press: normal force at the end differs by ([\d.]+) %", output) < 1.0
    assert number(r"slide: friction at the end differs by ([\d.]+) %", output) < 3.0
    assert number(r"press: SED at Y \+1.0 mm .* differs by ([\d.]+)%", output) < 5.0
    for name in ("cost.csv", "forces.csv", "sed.csv"):
        assert (tmp_path / name).is_file()


def test_codes_that_differ_by_two_percent(tmp_path, capsys):
    from tactile_fem.study import Protocol

    path = DEMOS / "verification" / "calculix.py"
    with beside(path):
        calculix = runpy.run_path(str(path))
    way = np.array([0.5, 1.0, 1.2])
    force = np.column_stack([0 * way, -np.maximum(way - 1.0, 0.0), way])
    places, sed = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]), np.column_stack([way, 2 * way])
    ours, theirs = (calculix["Way"](way, k * force, k * sed) for k in (1.02, 1.0))
    protocol = Protocol(depth_mm=1.0, distance_mm=0.2)
    calculix["compare"](protocol, places, ours, theirs, tmp_path)
    printed = capsys.readouterr().out
    assert number(r"press: normal force at the end differs by ([\d.]+) %", printed) == 2.0
    assert number(r"slide: friction at the end differs by ([\d.]+) %", printed) == 2.0
    # Nearest to the wrist first.
    assert re.findall(r"SED at Y (\S+) mm", printed) == ["-1.0", "+1.0"] * 2
    assert number(r"slide: SED at Y -1.0 mm ([\d.]+) kPa", printed) == pytest.approx(2 * 1.2 * 1.02)


@pytest.mark.slow
def test_run_deck(tmp_path):
    deck = str(tmp_path / "plate.inp")
    small = ["finger.pad_size_mm=3.0", "finger.far_size_mm=6.0"]
    small += ["stimulus.kind=plate", "protocol.depth_mm=0.2", "protocol.distance_mm=0.0"]
    settings = [word for setting in small for word in ("--set", setting)]
    command = [sys.executable, "-m", "tactile_fem"]
    output = run("verification/run_deck.py", deck, "--grid-mm", "4", *settings)
    assert "tetrahedra" in output
    if not shutil.which("ccx"):
        assert "not installed" in output
        return
    assert "\nfinished" in output
    alike = ["--set", "solver.locking_ratio=1e9", "--set", "tissue.viscous_time_s=0"]
    results = tmp_path / "ours"
    scan = [*command, "scan", "--results", str(results), *settings, *alike]
    subprocess.run(scan, check=True, capture_output=True)
    with np.load(results / "trace.npz") as trace:
        ours = trace["force_N"][-1, 2]
    assert number(r"\n +1 +1\.000 +([\d.]+)", output) == pytest.approx(ours, rel=0.03)


@needs_gmsh
def test_pad():
    path = DEMOS / "verification" / "pad.py"
    with beside(path):
        pad = runpy.run_path(str(path))
    mesh = pad["half_ellipsoid"](3.0)
    corners = mesh.nodes[mesh.cells[:, :4]]
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6
    assert volume / (2 / 3 * np.pi * 8 * 10 * 6.5) == pytest.approx(0.952, abs=0.02)


@pytest.mark.slow
@needs_gmsh
def test_partial_slip(tmp_path):
    few = ["--per-radius", "3", "--steps", "3"]
    output = run("verification/partial_slip.py", str(tmp_path), *few)
    assert number(r"stick radius: largest error ([\d.]+)%", output) < 3
    assert number(r"friction profile .* error ([\d.]+)%", output) < 10
    assert number(r"closed loop: .* ([+-][\d.]+)%", output) == pytest.approx(0, abs=2)


@pytest.mark.slow
@needs_gmsh
def test_convergence(tmp_path):
    meshes = ["--meshes", "3.0,6.0", "--meshes", "2.2,5.0"]
    way = ["--depth", "0.2", "--distance", "0.1"]
    output = run("verification/convergence.py", str(tmp_path), *meshes, *way)
    assert number(r"half the step against .* histories ([\d.]+)%", output) < 10
    # A second start finds everything done.
    assert run("verification/convergence.py", str(tmp_path), *meshes, *way) == output


def test_three_meshes_give_the_order_of_a_power_law():
    path = DEMOS / "verification" / "convergence.py"
    with beside(path):
        order = runpy.run_path(str(path))["order"]
    unknowns = np.array([1e4, 8e4, 64e4])  # elements half as long each time
    said = order(unknowns, [0.16 - 0.01, 0.04 - 0.01])  # 0.01 h^2, beside the finest
    assert said == "order of the histories 2.00; error of the finest mesh itself 1.0%"


@pytest.mark.slow
@needs_gmsh
def test_hertz(tmp_path):
    sizes = ["--body-radius", "20", "--body-radius", "40"]
    output = run("verification/hertz.py", str(tmp_path), "--per-radius", "4", *sizes)
    with (tmp_path / "hertz.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert [row["shape"] for row in rows] == ["ball", "ball", "bar", "bar"]
    for row in rows:
        assert float(row["radius_error"]) == pytest.approx(0, abs=0.02)
        assert float(row["peak_error"]) == pytest.approx(0, abs=0.02)
    assert number(r"half space: force/Hertz ([\d.]+)", output) == pytest.approx(1, abs=0.01)


@pytest.mark.slow
def test_sharp_block(tmp_path):
    way = ["--meshes", "2", "--gammas", "1.2", "--thetas", "0"]
    run("verification/sharp_block.py", str(tmp_path), *way)
    with (tmp_path / "sharp_block.csv").open() as table:
        (row,) = csv.DictReader(table)
    assert not row["failed"]
    assert float(row["tangential_N"]) / float(row["normal_N"]) == pytest.approx(0.3, rel=0.01)
    assert 0 < float(row["penetration_mm"]) < 0.03 and 0 < float(row["oscillation"]) < 0.5


def test_brian(tmp_path):
    way = ["--afferents", "20", "--duration", "0.3", "--steps-ms", "0.1"]
    output = run("verification/brian.py", str(tmp_path), *way)
    if not find_spec("brian2"):
        assert "not installed" in output
        return
    assert number(r"first spikes differ by at most ([\d.]+) steps", output) < 1
    assert number(r"99% of all by at most ([\d.]+) ms", output) < 10


def test_cost(tmp_path):
    way = ["--sizes", "small", "--depth", "0.2", "--distance", "0.1"]
    output = run("benchmarks/cost.py", str(tmp_path), *way)
    with (tmp_path / "costs.csv").open() as table:
        (row,) = csv.DictReader(table)
    assert row["size"] == "small" and row["cells"] in output
    assert 0 < float(row["linear_s"]) < float(row["seconds"])
    assert float(row["force_N"]) > 0 < int(row["newton"])


def test_fast_finger_and_afferents():
    for script in ("fast.py --beside 0 --tries 1", "afferents.py --count 20 --tries 1"):
        name, *way = script.split()
        found = json.loads(run(f"benchmarks/{name}", *way).splitlines()[-1])
        assert all(value > 0 for value in found.values())


def test_revisions(tmp_path):
    """The clones are of this repository; a case is measured with both and added to the history."""
    if not (DEMOS.parent / ".git").exists():
        pytest.skip("the sources are no clone")
    way = ["--before", "HEAD", "--cases", "import", "--tries", "1"]
    for count in (2, 4):
        output = run("benchmarks/revisions.py", str(tmp_path), *way)
        lines = (tmp_path / "benchmarks.jsonl").read_text().splitlines()
        assert len(lines) == count and all(json.loads(line)["seconds"] > 0 for line in lines)
    assert "import" in output and (tmp_path / "benchmarks.png").is_file()
    code, _, said = start("benchmarks/revisions.py", str(tmp_path), "--cases", "scan")
    assert code == 2 and "there is no scan, only import" in said

"""Every demo runs at small size and prints its numbers."""

from __future__ import annotations

import csv
import io
import json
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from needs import needs_gmsh

from tactile_fem import Piece, Stimulus
from tactile_fem.neuron import DRIVES
from tactile_fem.runtime import ranks
from tactile_fem.study import Neuron

# The shipped finger of 3,000 tetrahedra.
COARSE = "--set", "finger.pad_size_mm=3.0", "finger.far_size_mm=6.0"
DEMOS = Path(__file__).resolve().parents[1] / "demos"


@contextmanager
def beside(path: Path) -> Iterator[None]:
    """Let a demo import the modules beside it: other folders may have some of the same names."""
    before = set(sys.modules)
    kinds = Stimulus.kinds, Piece.kinds, DRIVES  # which a demo's own join
    known = [dict(entries) for entries in kinds]
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(path.parent)
        yield
    for entries, saved in zip(kinds, known, strict=True):
        entries.clear()
        entries.update(saved)
    for name in sys.modules.keys() - before:
        if str(DEMOS) in (getattr(sys.modules[name], "__file__", None) or ""):
            del sys.modules[name]


def start(name: str, *arguments: str) -> tuple[int, str, str]:
    """Run a demo in this process, which has its forms; return exit code, output and errors."""
    path, printed, said = DEMOS / name, io.StringIO(), io.StringIO()
    with beside(path), redirect_stdout(printed), redirect_stderr(said):
        sys.argv, usual = [str(path), *arguments], sys.argv
        try:
            runpy.run_path(str(path), run_name="__main__")
        except SystemExit as end:
            return end.code, printed.getvalue(), said.getvalue()
        finally:
            sys.argv = usual
    raise AssertionError("it does not exit")


def run(name: str, *arguments: str) -> str:
    """Return what a demo prints."""
    code, printed, said = start(name, *arguments)
    assert code == 0, said
    return printed


def run_command(*command: str) -> str:
    finished = subprocess.run(command, check=True, capture_output=True, text=True)
    return finished.stdout


@pytest.mark.parametrize(
    ("demo", "options", "sentence"),
    [
        ("verification/run_deck.py", [], "{0} is no file: give one that tactile-fem export wrote."),
    ],
)
def test_bad_input_gets_one_sentence(demo, options, sentence, tmp_path):
    code, _, said = start(demo, str(tmp_path / "none"), *options)
    assert code == 2
    assert said == f"tactile-fem: {sentence}\n".format(tmp_path / "none")


def number(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


@pytest.mark.slow
def test_held_force():
    told = run("benchmarks/held_force.py", "--force", "0.03", "--distance", "0.1", *SMALL)
    assert number(r"depth .* (0\.\d+)-0\.\d+\s*$", told.splitlines()[1]) > 0.1
    held = re.search(r"^force .* (0\.\d+)-(0\.\d+)  0\.\d+-0\.\d+$", told, re.MULTILINE)
    assert held and all(abs(float(force) - 0.03) < 1e-4 for force in held.groups())


SMALL = ("--pad-size", "3", "--far-size", "6")


@pytest.mark.slow
def test_flat_plate(tmp_path):
    output = run("validation/flat_plate.py", str(tmp_path), "--depth", "0.5", "--step", "0.25")
    deviation = number(r"0\.5 +[\d.]+ +0\.037 \(0\.010\) +([+-][\d.]+)", output)
    assert abs(deviation) < 1
    assert 0 < number(r"volume lost at 0\.50 mm: ([\d.]+) %", output) < 1
    assert (tmp_path / "flat_plate.png").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(("stimulus", "least"), [("cylinder", 0.18), ("edge", 0.10)])
def test_skin_profile(tmp_path, stimulus, least):
    way = ["--stimulus", stimulus, "--depth", "0.2"]
    output = run("validation/skin_profile.py", str(tmp_path), *way)
    # Coarse facets cut the bar's corner: the skin never reaches its whole depth.
    assert least < number(r"deepest point of the skin ([\d.]+) mm", output) < 0.2
    assert ("not resolved" in output) == (stimulus == "edge")
    assert (tmp_path / f"{stimulus}.png").is_file()


@pytest.mark.slow
def test_letters_force(tmp_path):
    output = run("validation/letters_force.py", str(tmp_path), "--depth", "0.3")
    assert number(r"at 0\.300 mm: ([\d.]+) N", output) == pytest.approx(0.0120, rel=0.1)
    assert (tmp_path / "letters_force.png").is_file()


@pytest.mark.slow
def test_sensitivity(tmp_path):
    way = ["--plate-depth", "0.5", "--depth", "0.2", "--distance", "0.1", *SMALL]
    output = run("validation/sensitivity.py", str(tmp_path), *way)
    change = re.search(r"epidermis\.C10_MPa +([+-][\d.]+) +([+-][\d.]+)", output)
    assert change and 0 < float(change[1]) < 10 and 0 < float(change[2]) < 10
    assert -10 < number(r"subcutaneous\.D1_per_MPa +([+-][\d.]+)", output) < 0


@pytest.mark.slow
def test_sensitivities():
    told = run("benchmarks/sensitivities.py", "--depth", "0.5", *SMALL)
    rows = re.findall(r"^(?:skin|subcutaneous\.\w+) +([+-][\d.]+) +([+-][\d.]+)$", told, re.M)
    assert len(rows) == 4
    for tangent, difference in rows:
        assert float(tangent) == pytest.approx(float(difference), rel=0.05, abs=2e-5)


@pytest.mark.slow
def test_slip(tmp_path):
    way = ["--force", "0.05", "--friction", "0.3", "--distance", "1", *SMALL]
    output = run("validation/slip.py", str(tmp_path), *way, "--stiffness-forces", "0.05")
    steps = list(csv.DictReader((tmp_path / "slip.csv").read_text().splitlines()))
    assert float(steps[0]["stuck"]) > float(steps[-1]["stuck"])
    ratio = float(steps[-1]["tangential_N"]) / float(steps[-1]["normal_N"])
    assert ratio == pytest.approx(0.3, rel=0.02)  # Coulomb's law, once all of it slips
    assert number(r"all skin slips after the skin was dragged ([\d.]+) mm", output) < 1
    assert (tmp_path / "slip.png").is_file()


@pytest.mark.slow
def test_predictions(tmp_path):
    way = ["--depth", "0.3", "--forces", "0.02", "0.05", "--distance", "0.2", "--deepest", "0.5"]
    way += ["--drag", "0.05", "--stiffness-forces", "0.02", "--stiffness-forces", "0.05", *SMALL]
    output = run("validation/predictions.py", str(tmp_path), *way)
    table = (tmp_path / "predictions.csv").read_text().splitlines()
    assert len(output.splitlines()) == len(table) - 1 == 11
    assert 0 < number(r"compression of epidermis, 0\.05 N \| > 20 % \| ([\d.]+)%", output) < 20
    assert 0 < number(r"volume lost, plate at 0\.05 N \| at most 5% \| ([\d.]+)%", output) < 5


@pytest.mark.slow
@needs_gmsh
def test_relaxation(tmp_path):
    way = ["--press", "0.4", "--depth", "0.3", "--pad-size", "4", "--far-size", "8"]
    way += ["--outputs", "2"]
    output = run("validation/relaxation.py", str(tmp_path), *way)
    rows = output.splitlines()
    assert len((tmp_path / "relaxation.csv").read_text().splitlines()) - 1 == len(rows) == 8
    assert 0 < number(r"fall of 0\.05 N.*\| ([\d.]+)% \|", output) < 30
    fast, slow = (number(rf"tap of {ms} ms.*\| ([\d.]+)% \|", output) for ms in (110, 220))
    assert 30 < fast < 90 and 30 < slow < 90
    assert "| faster is stiffer | " in output and rows[4].endswith("| yes |")
    relaxes, creeps = re.search(r"([\d.]+) and ([\d.]+) s, [\d.]+ times", output).groups()
    assert float(creeps) > float(relaxes) > 0


@pytest.mark.slow
@needs_gmsh
def test_fit_relaxation(tmp_path):
    way = ["--start", "0.3", "0.3", "0.1", "--evaluations", "1"]
    way += ["--pad-size", "4", "--far-size", "8", "--outputs", "1"]
    output = run("validation/fit_relaxation.py", str(tmp_path), *way)
    tried = list(csv.DictReader((tmp_path / "fit.csv").read_text().splitlines()))
    assert len(tried) == 4  # the start, and one for the derivative by each share
    falls = [float(row["fall of 0.2 N"]) for row in tried]
    assert falls[3] > falls[0]  # a larger share of the longest time
    assert number(r"g of 1\.4 s: ([\d.]+) ±", output) == pytest.approx(0.1, abs=1e-3)


@pytest.mark.slow
@needs_gmsh
def test_cost_of_relaxing(tmp_path):
    way = ["--depth", "0.3", "--distance", "0.1", *SMALL]
    told = run("benchmarks/relaxing.py", str(tmp_path), *way)
    _heading, elastic, relaxing, ratio = told.splitlines()
    assert elastic.split()[:2] == ["none", relaxing.split()[1]]  # as many steps
    assert all(float(value) > 0 for value in ratio.split()[1:])


@pytest.mark.slow
def test_onset(tmp_path):
    output = run("validation/onset.py", str(tmp_path), "--deepest", "0.5", *SMALL)
    shift = number(r"chosen for plate indenter plate shift_mm (0\.0[1-9]\d*) deviations", output)
    assert 0 < shift <= 0.1  # the plate's force at 0.5 mm is too low, so contact begins earlier
    assert "probe's edge of 0.4 instead of 0.2 mm: " in output


@pytest.mark.slow
def test_locking(tmp_path):
    way = ["--presets", "coarse", "--depth", "0.3", *SMALL]
    output = run("verification/locking.py", str(tmp_path), *way)
    line = r"^coarse +\d+ +([\d.]+)  (none|above 25) +([\d.]+) +\+0\.00%$"
    rows = re.findall(line, output, re.M)
    assert [way for _, way, _ in rows] == ["above 25", "none", "none"]
    ratio, same, softer = (float(ratio) for ratio, _, _ in rows)
    assert ratio == same == pytest.approx(10 * softer, rel=0.02)
    unlocked, force, less = (float(force) for _, _, force in rows)
    assert force > unlocked > less > 0


@pytest.mark.slow
@needs_gmsh
def test_cost(tmp_path):
    sizes = ["--sizes", "3.0,6.0", "--sizes", "2.2,5.0"]
    way = ["--ranks", "1", "--depth", "0.15", "--distance", "0"]
    output = run("benchmarks/cost.py", str(tmp_path), *sizes, *way)
    assert "1 ranks: seconds grow with unknowns^" in output
    rows = json.loads((tmp_path / "costs.json").read_text())
    assert [row["ranks"] for row in rows] == [1, 1]
    assert rows[1]["unknowns"] > rows[0]["unknowns"] > 3000
    for row in rows:
        assert row["linear"] >= row["newton"] > 0 and row["force_N"] > 0
        assert 0 < row["assembly_s"] + row["linear_s"] + row["set_up_s"] < row["seconds"]


def test_exponents_of_made_up_costs(capsys):
    cost = runpy.run_path(str(DEMOS / "benchmarks/cost.py"))
    nothing = {field.name: 0 for field in fields(cost["Cost"])} | {"ranks": 2}
    costs = [
        cost["Cost"](**(nothing | {"unknowns": n, "seconds": n**1.25, "newton": n**0.5}))
        for n in (1e4, 1e5, 1e6)
    ]
    cost["print_exponent"](costs)
    assert capsys.readouterr().out == (
        "2 ranks: seconds grow with unknowns^1.25, those of a Newton iteration with unknowns^0.75\n"
    )
    cost["print_exponent"](costs[:1])  # one size has none
    assert not capsys.readouterr().out


@pytest.mark.slow
def test_compiler(tmp_path):
    few = ["--variants", "O2", "--variants", "reordered", "--rounds", "1"]
    small = ["--pad-size", "3", "--far-size", "6"]
    run("benchmarks/compiler.py", str(tmp_path), *few, *small)
    with (tmp_path / "compiler.csv").open() as table:
        plain, reordered = csv.DictReader(table)
    assert float(plain["residual_error"]) == 0
    assert 0 < float(reordered["residual_error"]) < 1e-9
    assert float(reordered["displacement_error"]) < 1e-9


@pytest.mark.slow
def test_hard_states(tmp_path):
    few = ["--moments", "first touch", "--steps", "1"]
    strategies = ["--strategies", "default", "--strategies", "secant (l2)"]
    output = run("benchmarks/hard_states.py", str(tmp_path), *few, *strategies)
    rows = [line.split() for line in output.splitlines() if "first touch" in line]
    assert len(rows) == 2
    assert all(row[-6] == "1" and row[-5] == "0" for row in rows)  # one step, no failure
    assert (tmp_path / "strategies.csv").is_file()


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
    for name in ("cost.csv", "forces.csv", "sed.csv", "comparison.png"):
        assert (tmp_path / name).is_file()


@pytest.mark.slow
def test_run_deck(tmp_path):
    deck = str(tmp_path / "plate.inp")
    small = ["finger.pad_size_mm=3.0", "finger.far_size_mm=6.0"]
    small += ["stimulus.kind=plate", "protocol.depth_mm=0.2", "protocol.distance_mm=0.0"]
    settings = [word for setting in small for word in ("--set", setting)]
    export = [sys.executable, "-m", "tactile_fem", "export", "--deck", deck, "--grid-mm", "4"]
    run_command(*export, *settings)
    output = run("verification/run_deck.py", deck)
    if not shutil.which("ccx"):
        assert "not installed" in output
        return
    assert "\nfinished" in output
    alike = ["--set", "solver.locking_ratio=1e9", "--set", "tissue.viscous_time_s=0"]
    results = tmp_path / "ours"
    scan = [sys.executable, "-m", "tactile_fem", "scan", "--results", str(results)]
    run_command(*scan, *settings, *alike)
    with np.load(results / "trace.npz") as trace:
        ours = trace["force_N"][-1, 2]
    assert number(r"\n +1 +1\.000 +([\d.]+)", output) == pytest.approx(ours, rel=0.03)


@needs_gmsh
def test_pad():
    output = run("verification/pad.py", "--size", "3")
    assert number(r"([\d.]+) of the half ellipsoid", output) == pytest.approx(0.952, abs=0.02)


@pytest.mark.slow
@needs_gmsh
def test_partial_slip(tmp_path):
    few = ["--per-radius", "3", "--steps", "3"]
    output = run("verification/partial_slip.py", str(tmp_path), *few)
    assert number(r"stick radius: largest error ([\d.]+)%", output) < 3
    assert number(r"closed loop: .* ([+-][\d.]+)%", output) == pytest.approx(0, abs=2)
    assert (tmp_path / "partial_slip.png").is_file()


@pytest.mark.slow
@needs_gmsh
def test_convergence(tmp_path):
    meshes = ["--meshes", "3.0,6.0", "--meshes", "2.2,5.0"]
    way = ["--depth", "0.2", "--distance", "0.1"]
    output = run("verification/convergence.py", str(tmp_path), *meshes, *way)
    halved = re.search(r"half the step .* ([\d.]+)%", output)
    assert halved and float(halved[1]) < 10
    assert 0 < number(r"spreads by ([\d.]+)%", output) < 50
    assert (tmp_path / "convergence.png").is_file()
    # A second start finds everything done.
    assert run("verification/convergence.py", str(tmp_path), *meshes, *way) == output


@pytest.mark.slow
@needs_gmsh
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
    way = ["--meshes", "2", "--gammas", "1.2", "--thetas", "0"]
    run("verification/sharp_block.py", str(tmp_path), *way)
    with (tmp_path / "sharp_block.csv").open() as table:
        (row,) = csv.DictReader(table)
    assert not row["failed"]
    assert float(row["tangential_N"]) / float(row["normal_N"]) == pytest.approx(0.3, rel=0.01)
    assert (tmp_path / "sharp_block.png").is_file()


@pytest.mark.slow
def test_histories(tmp_path):
    stimuli = ["--stimuli", "bar", "--stimuli", "grating_3.3", "--stimuli", "sphere_521"]
    way = ["--preset", "coarse", *stimuli, "--depth", "0.1", "--step", "0.05"]
    output = run("neurons/histories.py", str(tmp_path), *way)
    # The bar lies in the middle of one that is as wide, to 0.01 mm, and 0.1 mm deep alike.
    forces = [number(rf"{name}: ([\d.]+) N", output) for name in ("bar", r"grating_3\.3")]
    assert forces == pytest.approx([0.0032, 0.0032], rel=0.1)
    assert number(r"sphere_521: ([\d.]+) N", output) == pytest.approx(0.196, abs=1e-3)
    bar, ball = (np.load(tmp_path / f"{name}.npz") for name in ("bar", "sphere_521"))
    assert sorted(bar["y_mm"]) == pytest.approx([0.1 * k - 4 for k in range(81)])
    assert not bar["x_mm"].any()
    assert bar["time_s"][-1] == pytest.approx(0.055)
    assert bar["sed_kPa"][-1].max() == pytest.approx(0.0100, rel=0.1)
    assert ball["stresses_kPa"].shape == (len(ball["time_s"]), 5, 3)
    for force in (0.098, 0.147):
        assert np.abs(ball["force_N"] - force).min() < 1e-3


def test_calibrate(tmp_path):
    output = run("neurons/calibrate.py", str(tmp_path))
    n = Neuron()
    for name in ("static_gain_pA_per_kPa", "compression_kPa", "fast_adaptation"):
        assert getattr(n, name) == pytest.approx(number(rf"{name} +([\d.e+]+)", output), rel=0.01)
    assert number(r"spheres \(21\) \| .* \| R² ([\d.]+)", output) > 0.7
    assert "rates fall with the radius | yes | yes" in output
    quantities = list(csv.DictReader((tmp_path / "rates.csv").read_text().splitlines()))
    assert len(quantities) == output.count("\n| ") - 2  # but for the heading
    assert (tmp_path / "rates.png").is_file()


def test_the_linear_law_is_calibrated_on_the_bar(tmp_path):
    way = ["--law", "hamasaki2020", "--no-spheres"]
    output = run("neurons/calibrate.py", str(tmp_path), *way)
    n = Neuron(model="hamasaki2020")
    for name in ("static_gain_pA_per_kPa", "dynamic_gain_pA_s_per_kPa"):
        assert getattr(n, name) == pytest.approx(number(rf"{name} +([\d.]+)", output), rel=0.01)
    assert number(r"adaptation free: .* R2 of all ([\d.]+); [1-9]", output) > 0.8


@pytest.mark.slow
def test_compare_laws():
    output = run("neurons/compare_laws.py", "--stiffness", "1")
    rows = re.findall(r"^(\w+) +([A-Za-z ]+?) +1 +(.*)$", output, re.M)
    assert len(rows) == 8 and ("logarithmic", "SED") in [row[:2] for row in rows]
    explained = {row[:2]: float(row[2].split()[3]) for row in rows}
    assert explained["logarithmic", "SED"] > explained["hamasaki2020", "SED"]


def test_brian(tmp_path):
    way = ["--afferents", "20", "--duration", "0.3", "--steps-ms", "0.1"]
    output = run("verification/brian.py", str(tmp_path), *way)
    if not find_spec("brian2"):
        assert "not installed" in output
        return
    assert number(r"first spikes differ by at most ([\d.]+) steps", output) < 1
    assert number(r"99% of all by at most ([\d.]+) ms", output) < 10


@pytest.mark.slow
@needs_gmsh
def test_strains(tmp_path):
    options = "--forces", "0.005", "--edge-force", "0.005", "--pad-size", "0.1175"
    output = run("validation/strains.py", str(tmp_path), *options)
    assert 50 < number(r"plate, ridged, 0.*; (\d+) % of the ridges", output) < 100
    proximal, distal = re.search(r"corneum: shear (\S+) and (\S+),", output).groups()
    assert float(proximal) * float(distal) < 0


@pytest.mark.slow
def test_vibration(tmp_path):
    way = ["--depth", "0.3", "--hold", "0.05", *SMALL]
    output = run("validation/vibration.py", str(tmp_path), *way)
    assert 10 <= number(r"RA best frequency: (\d+) Hz", output) <= 100
    assert 100 <= number(r"PC best frequency: (\d+) Hz", output) <= 500
    assert number(r"RA 50 Hz, fitted: .*rms (\d+)", output) < 25


@pytest.mark.slow
def test_inertia(tmp_path):
    way = ["--depth", "0.3", "--hold", "0.05", "--periods", "3", *SMALL]
    output = run("verification/inertia.py", str(tmp_path), *way)
    for what, without in (("force", 15), ("compression", 10), ("motion", 3)):
        assert number(rf"{what}.* in time .* off by ([\d.]+) %; without", output) < 2
        assert number(rf"{what}.* without inertia .* off by (\d+) %", output) > without
    assert number(r"forces balance to (\S+) N", output) < 1e-6


@pytest.mark.mpi
def test_partition():
    script = str(DEMOS / "benchmarks/partition.py")
    output = run_command(ranks.launcher(), "-n", "3", sys.executable, script)
    cells = re.search(r"cells +(\d+) +([\d.]+) +(\d+)", output)
    assert cells and float(cells[2]) * 3 == pytest.approx(8580, abs=1)
    assert number(r"lines cut +(\d+)", output) >= 0


@pytest.mark.slow
def test_revisions_in_turns(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(
        "[protocol]\ndepth_mm = 0.05\ndistance_mm = 0.02\n[output]\npictures = false\n"
    )
    here = str(DEMOS.parent)
    options = "--study", str(study), "--turns", "1", "--ranks", "1"
    output = run("benchmarks/revisions.py", str(tmp_path / "turns"), here, here, *options)
    assert number(r"differ by at most ([\d.e+-]+)", output) == 0.0
    assert number(r"scan_s: .* ratio ([\d.]+)", output) > 0
    assert len((tmp_path / "turns" / "turns.csv").read_text().splitlines()) == 3


@pytest.mark.slow
def test_products():
    output = run("benchmarks/products.py", "--times", "1")
    errors = {line[:34].strip(): float(line.split()[-1]) for line in output.splitlines()}
    assert len(errors) == 7
    for name, error in errors.items():
        assert error < (1e-5 if "float32" in name else 1e-14), name


@pytest.mark.slow
def test_kept_tangent():
    output = run(
        "benchmarks/tangent.py", "--iterations", "1", "5", "--depth", "0.15", "--distance", "0.02"
    )
    rows = np.array([line.split() for line in output.splitlines()[-2:]], dtype=float)
    np.testing.assert_array_equal(rows[:, 0], [1, 5])
    assert rows[1, 5] < 1e-7  # N, difference of the force


@pytest.mark.parametrize(
    "path",
    sorted(DEMOS.glob("[bnosv]*/*.py")),  # not those of the gallery, which are no modules
    ids=lambda path: str(path.relative_to(DEMOS)),
)
def test_what_a_demo_imports_exists(path):
    """Without running it: what it computes is tested above, mostly by the slow tests."""
    with beside(path):
        names = runpy.run_path(str(path))
    assert path.read_text().startswith("# %%") == ("main" in names)

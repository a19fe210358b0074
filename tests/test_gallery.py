"""The gallery: each script has what a page needs, and runs at small size."""

from __future__ import annotations

import ast
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module

import numpy as np
import pytest
from needs import needs_gmsh, needs_graphics
from scripts import DEMOS, number

from tactile_fem import Piece, Population, Results, Stimulus
from tactile_fem.neuron import DRIVES
from tactile_fem.runtime import ranks

GALLERY = DEMOS / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))
PUBLIC = "tactile_fem", "tactile_fem.study", "tactile_fem.neuron", "tactile_fem.series"
SMALL = "finger.pad_size_mm=3.0", "finger.far_size_mm=6.0"  # the shipped finger
every_script = pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)


@every_script
def test_a_page_has_title_time_what_to_change_and_a_picture(path):
    text = path.read_text()
    title, underline, *_ = ast.get_docstring(ast.parse(text)).splitlines()
    assert underline == len(title) * "="
    assert "\nExpected time: " in text and "\nWhat to change: " in text
    thumbnail = re.search(r"^# sphinx_gallery_thumbnail_path = '(.*)'$", text, re.MULTILINE)
    shown = re.findall(r"^(?:# )?\.\. figure:: /(\S+)$", text, re.MULTILINE)
    assert thumbnail[1] in shown
    for name in shown:
        assert (DEMOS / "pages" / name).stat().st_size < 150_000, name
    assert f'else "results/{path.stem}")' in text or path.stem == "deformed_finger"


@every_script
def test_a_script_uses_public_names_only(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            assert not [name for name in node.names if name.name.startswith("tactile_fem")]
        if isinstance(node, ast.ImportFrom) and node.module.startswith("tactile_fem"):
            assert node.module in PUBLIC
            names = {name.name for name in node.names}
            assert names <= set(import_module(node.module).__all__)


def test_the_gallery_is_short():
    assert 10 <= len(SCRIPTS) <= 15
    for path in SCRIPTS:
        assert len(path.read_text().splitlines()) < 200, path


@pytest.fixture
def run(tmp_path, monkeypatch, capsys) -> Iterator:
    """Return a function that runs a script in a folder and returns what it prints."""
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("agg")
    kinds = Stimulus.kinds, Piece.kinds, DRIVES  # which a script's own join
    before = [dict(entries) for entries in kinds]

    def run_script(name: str, *changes: str) -> str:
        path = GALLERY / f"{name}.py"
        monkeypatch.setattr(sys, "argv", [str(path), str(tmp_path / "out"), *changes])
        runpy.run_path(str(path), run_name="__main__")
        return capsys.readouterr().out

    yield run_script
    plt.close("all")
    for entries, saved in zip(kinds, before, strict=True):
        entries.clear()
        entries.update(saved)


def definitions(name: str) -> dict:
    """Return what a script imports and defines, without running it."""
    tree = ast.parse((GALLERY / f"{name}.py").read_text())
    kept = ast.Import, ast.ImportFrom, ast.ClassDef, ast.FunctionDef
    tree.body = [node for node in tree.body if isinstance(node, kept)]
    found: dict = {}
    exec(compile(tree, name, "exec"), found)
    return found


def test_the_own_law_has_the_stiffness_and_energy_it_states():
    ufl = pytest.importorskip("ufl")
    from tactile_fem.tissue.energies import stiffness

    law = definitions("own_mechanics")["Fung"](shear=0.02, b=2.0, bulk=1.0)

    def at(expression, F):
        X = ufl.as_vector([0.0, 0.0, 0.0])
        return ufl.as_ufl(expression(ufl.as_matrix(F.tolist()), X))(())

    rest, stretched = np.eye(3), np.diag([1.2, 1.0, 1 / 1.2])
    assert at(lambda F, X: stiffness(law, F, X), rest) == pytest.approx(1.0 + 4 / 3 * 0.02)
    a = 1.2**2 + 1 + 1.2**-2 - 3
    assert at(law.energy, stretched) == pytest.approx(0.02 / 4 * np.expm1(2 * a))
    sheared = np.eye(3) + 0.7 * np.eye(3, k=2)
    in_shear = at(lambda F, X: law.in_shear(F[0, 2] ** 2, X), sheared)
    assert in_shear == pytest.approx(at(law.energy, sheared))


def test_the_own_transduction_responds_to_changes_only(run):
    population = Population(transduction=definitions("own_stimulus")["Changes"](gain=30.0))
    # 20 kPa/s for 50 ms, then none.
    time_s, sed_kPa = np.array([0.0, 0.05, 1.0]), np.array([[0.0], [1.0], [1.0]])
    (spikes,) = population.fire({"time_s": time_s, "sed_kPa": sed_kPa}).spikes
    assert len(spikes) > 5 and spikes[-1] <= 0.05


def test_passes_are_read_from_the_archive(run, tmp_path):
    output = run("passes")
    population = number(r"51 receptors, one pass: .* r = ([\d.]+)", output)
    fibre = number(r"one receptor, 25 passes: .* r = ([\d.]+)", output)
    assert population == pytest.approx(0.607, abs=0.01)  # firing follows the shape of the letter
    assert fibre == pytest.approx(0.718, abs=0.01)
    assert (tmp_path / "out" / "passes.png").is_file()


def test_without_the_archive_a_notebook_scans(run, tmp_path, monkeypatch):
    def scans(study, folder):
        raise InterruptedError(study.stimulus.text)

    monkeypatch.setattr("tactile_fem.completed", scans)
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path / "out")])
    monkeypatch.chdir(tmp_path)
    cells = compile((GALLERY / "passes.py").read_text(), "passes", "exec")
    with pytest.raises(InterruptedError, match="G"):
        exec(cells, {"__name__": "__main__"})  # without `__file__`


@pytest.mark.slow
def test_alphabet(run):
    output = run("alphabet")
    assert number(r"(\d+) % of 1300 recognized", output) == pytest.approx(50, abs=3)
    assert "hardest Q" in output and "easiest W" in output and "confused IJ" in output


@pytest.mark.slow
def test_letters_are_the_same_on_two_ranks(run, tmp_path):
    changes = ["protocol.depth_mm=0.5", "protocol.distance_mm=0.4", *SMALL]
    one = run("letters", *changes)
    command = [sys.executable, str(GALLERY / "letters.py"), str(tmp_path / "two"), *changes]
    launched = [ranks.launcher(), "-n", "2", *command]
    two = subprocess.run(launched, check=True, capture_output=True, text=True).stdout
    assert "ranks, wall time            2," in two
    physics = slice(0, 5)
    assert one.splitlines()[physics] == two.splitlines()[physics]
    assert (tmp_path / "out" / "letters.png").is_file()


@pytest.mark.slow
@needs_graphics
def test_deformed_finger(run, tmp_path):
    output = run("deformed_finger", "protocol.depth_mm=0.5", "protocol.distance_mm=0.4", *SMALL)
    pressure, scan = re.search(r"pressure ([\d.]+) N, from the scan ([\d.]+) N", output).groups()
    assert float(pressure) == pytest.approx(float(scan), rel=0.2)
    assert (tmp_path / "out" / "deformed_finger.png").is_file()
    assert (tmp_path / "out" / "film.gif").is_file()


@pytest.mark.slow
def test_afferents(run):
    output = run("afferents", "protocol.depth_mm=1.0", "protocol.distance_mm=0.4", *SMALL)
    spikes = {kind: number(rf"{kind}: (\d+) spikes", output) for kind in ("SA1", "RA", "PC")}
    assert spikes["SA1"] > 0 and len(set(spikes.values())) == 3


@pytest.mark.slow
def test_friction(run):
    output = run("friction", "protocol.depth_mm=0.5", "protocol.distance_mm=0.4", *SMALL)
    pulled = [float(found) for found in re.findall(r"([\d.]+) N tangential", output)]
    assert len(pulled) == 3 and pulled == sorted(pulled)
    normal = number(r"friction 0: ([\d.]+) N", output)
    assert pulled[0] < 0.2 * normal  # without friction the flanks of the letter alone push


@pytest.mark.slow
def test_textures(run):
    output = run("textures", "protocol.force_N=0.02", "protocol.distance_mm=0.4", *SMALL)
    for name in ("sandpaper", "cloth"):
        assert number(rf"{name}: tangential force ([\d.]+) N", output) > 0


@pytest.mark.slow
@needs_gmsh
def test_button(run):
    pytest.importorskip("igl")
    output = run("button", "protocol.depth_mm=0.2", "protocol.distance_mm=0.2")
    assert number(r"normal force ([\d.]+) to", output) == pytest.approx(0.008, rel=0.3)


@pytest.mark.slow
@needs_gmsh
def test_scanned_finger(run):
    pytest.importorskip("igl")
    sizes = "finger.pad_size_mm=2.0", "finger.far_size_mm=5.0"
    output = run("scanned_finger", "protocol.depth_mm=0.6", *sizes)
    force_N = {
        name: number(rf"{name}: .* ([\d.]+) N at", output)
        for name in ("analytic", "its scan", "child")
    }
    assert force_N["its scan"] == pytest.approx(force_N["analytic"], rel=0.1)
    assert force_N["child"] != force_N["its scan"]


@pytest.mark.slow
@needs_gmsh
def test_fingerprints(run):
    small = "protocol.distance_mm=0.2", "protocol.force_N=0.005", "finger.pad_size_mm=0.1175"
    output = run("fingerprints", *small)
    smooth, ridged = (number(rf"{skin}: SED ([\d.]+)", output) for skin in ("smooth", "ridged"))
    assert ridged == pytest.approx(smooth, rel=0.5) and ridged != smooth


@pytest.mark.slow
@needs_gmsh
def test_section(run):
    output = run("section", "protocol.force_N=0.02", "protocol.distance_mm=0.4")
    assert re.search(r"section: [\d.]+ mm deep, SED at most [\d.]+ kPa", output)
    assert -1 <= number(r"correlation of the histories (-?[\d.]+)", output) <= 1


@pytest.mark.slow
def test_decay(run):
    output = run("decay", *SMALL)
    late = {name: float(rate) for name, rate in re.findall(r"^(.*): (\d+) spikes/s", output, re.M)}
    # Relaxing skin lets firing fall slowly, a receptor that adapts at once.
    assert late["both"] < late["receptor adapts"] < late["tissue relaxes"] < late["neither"]
    assert late["receptor adapts"] < 0.4 * late["tissue relaxes"]


@pytest.mark.slow
def test_vibration(run):
    output = run("vibration", *SMALL)
    best = {}
    for kind in ("RA", "PC"):
        told = re.search(rf"{kind}: .* thresholds \(µm\) (.*)", output)[1]
        pairs = [pair.split(" Hz ") for pair in told.split(", ")]
        best[kind] = float(min(pairs, key=lambda pair: float(pair[1]))[0])
    assert best["RA"] <= 100 <= best["PC"]


@pytest.mark.slow
def test_own_stimulus(run, tmp_path):
    output = run("own_stimulus")
    assert number(r"circle of ([\d.]+) mm", output) == pytest.approx(2 * np.pi * 1.5, abs=0.01)
    assert number(r"(\d+) spikes", output) > 20
    trace = Results.open(tmp_path / "out").trace
    assert list(dict.fromkeys(trace["phase"])) == ["rest", "press", "circle", "lift"]


@pytest.mark.slow
def test_own_mechanics(run):
    output = run("own_mechanics", "protocol.depth_mm=0.6")
    default, own, weighs = re.findall(r": ([\d.]+) N at", output)
    assert float(default) != float(own) < float(weighs)  # the weight presses the pad down
    assert number(r"differ by at most (\S+) mm", output) < 1e-6

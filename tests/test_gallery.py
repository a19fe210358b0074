"""The gallery: each script has what a page needs, and runs at small size."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from types import MappingProxyType, ModuleType

import numpy as np
import pytest
from needs import needs_gmsh, needs_graphics
from scripts import DEMOS, number

from tactile_fem import Piece, Population, Results, Stimulus
from tactile_fem.finger.simplex import volumes
from tactile_fem.neuron import DRIVES
from tactile_fem.runtime import ranks

GALLERY = DEMOS / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))
PUBLIC = "tactile_fem", "tactile_fem.study", "tactile_fem.neuron", "tactile_fem.series"
AS_IT_IS: Mapping[str, str] = MappingProxyType({})
SMALL = "finger.pad_size_mm=3.0", "finger.far_size_mm=6.0"  # the shipped finger
QUICK = (
    *SMALL,
    "solver.max_press_step_mm=0.3",
    "solver.first_slide_step_mm=0.1",
    "solver.max_slide_step_mm=1",
)
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
    """Return a function that runs a script in a folder and returns what it prints.

    It is given changes of the study, and texts of the script with shorter ones instead.
    """
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("agg")
    kinds = Stimulus.kinds, Piece.kinds, DRIVES  # which a script's own join
    before = [dict(entries) for entries in kinds]

    def run_script(name: str, *changes: str, short: Mapping[str, str] = AS_IT_IS) -> str:
        path, script = GALLERY / f"{name}.py", ModuleType("__main__")
        code = path.read_text()
        for long in short:
            assert long in code
            code = code.replace(long, short[long])
        monkeypatch.setattr(sys, "argv", [str(path), str(tmp_path / "out"), *changes])
        monkeypatch.setitem(sys.modules, "__main__", script)
        vars(script)["__file__"] = str(path)
        exec(compile(code, str(path), "exec"), vars(script))
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
    from tactile_fem.tissue.energies import ORIGIN, stiffness

    law = definitions("own_mechanics")["Fung"](shear=0.02, b=2.0, bulk=1.0)

    def at(expression, F):
        return ufl.as_ufl(expression(ufl.as_matrix(F.tolist()), ORIGIN))(())

    rest, stretched = np.eye(3), np.diag([1.2, 1.0, 1 / 1.2])
    assert at(lambda F, at: stiffness(law, F, at), rest) == pytest.approx(1.0 + 4 / 3 * 0.02)
    a = 1.2**2 + 1 + 1.2**-2 - 3
    assert at(law.energy, stretched) == pytest.approx(0.02 / 4 * np.expm1(2 * a))
    sheared = np.eye(3) + 0.7 * np.eye(3, k=2)
    in_shear = at(lambda F, at: law.in_shear(F[0, 2] ** 2, at), sheared)
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
    assert fibre == pytest.approx(0.755, abs=0.01)
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


# --- at small size; forms that check more are slow -----------------------------------------------


def test_alphabet(run, tmp_path):
    """Without noise the reader knows every letter, also those that people confuse."""
    short = {
        "from string import ascii_uppercase as letters": "letters = 'CFGIJOQ'",
        "NOISE_HZ = 10, 5, 370.0": "NOISE_HZ = 2, 1, 0.0",
    }
    assert "100 % of 14 recognized" in run("alphabet", short=short)
    assert (tmp_path / "out" / "alphabet.png").is_file()


@pytest.mark.slow
def test_the_whole_alphabet_in_noise(run):
    output = run("alphabet")
    assert number(r"(\d+) % of 1300 recognized", output) == pytest.approx(50, abs=3)
    assert "hardest Q" in output and "easiest W" in output and "confused IJ" in output


def test_letters(run, tmp_path):
    output = run("letters", "protocol.depth_mm=0.5", "protocol.distance_mm=0.2", *QUICK)
    force = re.search(r"normal force in the slide   ([\d.]+) to ([\d.]+) N", output).groups()
    assert [float(end) for end in force] == pytest.approx([0.0159, 0.0171], rel=0.02)
    assert "tetrahedra, unknowns        2899, 11871" in output
    assert (tmp_path / "out" / "letters.png").is_file()


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


@needs_graphics
def test_deformed_finger(run, tmp_path):
    output = run("deformed_finger", "protocol.depth_mm=0.5", "protocol.distance_mm=0.2", *QUICK)
    pressure, scan = re.search(r"pressure ([\d.]+) N, from the scan ([\d.]+) N", output).groups()
    assert float(pressure) == pytest.approx(float(scan), rel=0.2)
    assert (tmp_path / "out" / "deformed_finger.png").is_file()
    assert (tmp_path / "out" / "film.gif").is_file()


def test_afferents(run):
    output = run("afferents", "protocol.depth_mm=0.8", "protocol.distance_mm=0.2", *QUICK)
    spikes = {kind: number(rf"{kind}: (\d+) spikes", output) for kind in ("SA1", "RA", "PC")}
    assert spikes["SA1"] > 0 and len(set(spikes.values())) == 3


def test_friction(run):
    output = run("friction", "protocol.depth_mm=0.3", "protocol.distance_mm=0.4", *QUICK)
    pulled = [float(found) for found in re.findall(r"([\d.]+) N tangential", output)]
    assert len(pulled) == 3 and pulled == sorted(pulled)
    normal = number(r"friction 0: ([\d.]+) N", output)
    assert pulled[0] < 0.2 * normal  # without friction the flanks of the letter alone push


def test_textures(run):
    output = run("textures", "protocol.force_N=0.02", "protocol.distance_mm=0.1", *QUICK)
    for name in ("sandpaper", "cloth"):
        assert number(rf"{name}: tangential force ([\d.]+) N", output) > 0


@needs_gmsh
def test_button(run):
    """The force falls over the arrow, whose ground the skin does not reach."""
    pytest.importorskip("igl")
    way = "protocol.depth_mm=0.3", "protocol.distance_mm=2", "protocol.output_mm=1"
    part = "stimulus.shift_mm=[0, 2]", "stimulus.edge_radius_mm=0.4"
    output = run("button", *way, *part, *QUICK)
    force = re.search(r"normal force ([\d.]+) to ([\d.]+) N", output).groups()
    assert [float(end) for end in force] == pytest.approx([0.0083, 0.0124], rel=0.1)


@pytest.mark.slow
@needs_gmsh
def test_button_on_the_default_finger(run):
    pytest.importorskip("igl")
    output = run("button", "protocol.depth_mm=0.2", "protocol.distance_mm=0.2")
    assert number(r"normal force ([\d.]+) to", output) == pytest.approx(0.008, rel=0.3)


FINE = ("finger.pad_size_mm=2.0", "finger.far_size_mm=5.0"), {}, "0.6", 0.1
COARSE = QUICK, {"pad_size_mm=0.5": "pad_size_mm=1.5", "size_mm=1.0": "size_mm=3.0"}, "0.3", 0.15


@needs_gmsh
@pytest.mark.parametrize(
    ("sizes", "short", "depth_mm", "error"), [COARSE, pytest.param(*FINE, marks=pytest.mark.slow)]
)
def test_scanned_finger(run, sizes, short, depth_mm, error):
    pytest.importorskip("igl")
    output = run("scanned_finger", f"protocol.depth_mm={depth_mm}", *sizes, short=short)
    force_N = {
        name: number(rf"{name}: .* ([\d.]+) N at", output)
        for name in ("analytic", "its scan", "child")
    }
    assert force_N["its scan"] == pytest.approx(force_N["analytic"], rel=error)
    assert force_N["child"] > force_N["analytic"]  # its tissue is thinner


COARSE_RIDGES = {"PITCH_MM = 0.47": "PITCH_MM = 1.0", "PITCH_MM / 8": "PITCH_MM / 4"}


@needs_gmsh
@pytest.mark.parametrize(
    ("sizes", "short"),
    [
        (["finger.far_size_mm=3", "finger.ridged_half_length_mm=2"], COARSE_RIDGES),
        pytest.param(["finger.pad_size_mm=0.1175"], {}, marks=pytest.mark.slow),
    ],
)
def test_fingerprints(run, sizes, short):
    few = "protocol.distance_mm=0.1", "protocol.force_N=0.003"
    output = run("fingerprints", *few, *sizes, short=short)
    smooth, ridged = (number(rf"{skin}: SED ([\d.]+)", output) for skin in ("smooth", "ridged"))
    assert ridged == pytest.approx(smooth, rel=0.5) and ridged != smooth


@needs_gmsh
def test_section(run):
    output = run("section", "protocol.force_N=0.02", "protocol.distance_mm=0.2", *QUICK)
    assert re.search(r"section: [\d.]+ mm deep, SED at most [\d.]+ kPa", output)
    assert -1 <= number(r"correlation of the histories (-?[\d.]+)", output) <= 1


FEW_HOLDS = {
    "(0.01, 6), (0.04, 6), (0.15, 6), (0.6, 6), (4.2, 6)": "(0.01, 2), (0.04, 2), (0.15, 3)",
    "Window(2.0, 5.0, 0.0)": "Window(0.1, 0.2, 0.0)",
    "step_mm=0.05": "step_mm=0.3",
    "pA_per_kPa=1250.0": "pA_per_kPa=4e3",  # few elements feel little
    # Half a minute of compilation less than with four tissues that relax.
    "tissue.relaxation=none,fingerpad": "tissue.subcutaneous.g=[1e-9],[0.5]",
    "*sys.argv": '"tissue.subcutaneous.tau_s=[0.05]", *sys.argv',
}


@pytest.mark.parametrize("short", [FEW_HOLDS, pytest.param({}, marks=pytest.mark.slow)])
def test_decay(run, short):
    output = run("decay", *SMALL, short=short)
    late = {name: float(rate) for name, rate in re.findall(r"^(.*): (\d+) spikes/s", output, re.M)}
    # Relaxing skin lets firing fall slowly, a receptor that adapts at once.
    assert late["both"] < late["receptor adapts"] < late["tissue relaxes"] < late["neither"]
    assert late["receptor adapts"] < 0.4 * late["tissue relaxes"]


FREQUENCIES_HZ = "5.0, 10.0, 20.0, 33.0, 50.0, 70.0, 100.0, 150.0, 200.0, 250.0, 300.0, 400.0"
FEW_FREQUENCIES = {FREQUENCIES_HZ: "10.0, 33.0, 100.0, 300.0"}
TWO_FREQUENCIES = {
    FREQUENCIES_HZ: "25.0, 150.0",
    "relaxation=fingerpad": "relaxation=none",  # of which other tests need the forms
    "depth_mm=1.0": "depth_mm=0.5",
    "time_s=2.0": "time_s=0.1",
    "1000, 48": "1000, 12",
    "rates_Hz(k, 1.0": "rates_Hz(k, 0.4",
}


@pytest.mark.parametrize(
    "short", [TWO_FREQUENCIES, pytest.param(FEW_FREQUENCIES, marks=pytest.mark.slow)]
)
def test_vibration(run, short):
    output = run("vibration", *SMALL, short=short)
    best = {}
    for kind in ("RA", "PC"):
        told = re.search(rf"{kind}: .* thresholds \(µm\) (.*)", output)[1]
        pairs = [pair.split(" Hz ") for pair in told.split(", ")]
        best[kind] = float(min(pairs, key=lambda pair: float(pair[1]))[0])
    assert best["RA"] <= 100 <= best["PC"]


def test_own_stimulus(run, tmp_path):
    path = "{kind='press', depth_mm=0.5}, {kind='circle', circle_mm=0.1}, {kind='lift'}"
    output = run("own_stimulus", f"protocol.path=[{path}]", *QUICK, short={"33)[1:]": "5)[1:]"})
    assert number(r"circle of ([\d.]+) mm", output) == pytest.approx(2 * np.pi * 0.1, abs=0.01)
    assert number(r"(\d+) spikes", output) > 20
    trace = Results.open(tmp_path / "out").trace
    assert list(dict.fromkeys(trace["phase"])) == ["rest", "press", "circle", "lift"]


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param(["finger.kind=section", "protocol.depth_mm=0.3"], marks=needs_gmsh),
        pytest.param(["protocol.depth_mm=0.6"], marks=pytest.mark.slow),
    ],
)
def test_own_mechanics(run, tmp_path, changes):
    output = run("own_mechanics", *changes)
    scans = [
        Results.open(tmp_path / "out" / name) for name in ("default", "Fung", "Fung_with_weight")
    ]
    default, own, weighs = (scan.trace["force_N"][-1, 2] for scan in scans)
    # The weight presses the pad down; nine tenths of it hang from the bone.
    mesh = scans[0].study.finger.mesh()
    weight_N = 9.81e-6 * volumes(mesh.plane.within(mesh.nodes), mesh.cells).sum()
    assert own < 0.97 * default
    assert 0.05 * weight_N < weighs - own < 0.15 * weight_N
    assert number(r"differ by at most (\S+) mm", output) < 1e-6

"""The tutorials: notebooks with outputs of the present API, which run."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest
from needs import needs_graphics

nbformat = pytest.importorskip("nbformat", reason="`make docs` installs it")

FOLDER = Path(__file__).parents[1] / "demos" / "pages" / "tutorials"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
PUBLIC = {"tactile_fem", "tactile_fem.study", "tactile_fem.neuron", "tactile_fem.series"}
MOST_BYTES, MOST_WORDS, MOST_WORDS_OF_ALL = 600_000, 650, 2500
# What makes a notebook short enough for a test.
SHORT = {
    "letters": {
        "import Protocol, Receptors": "import Finger, Protocol, Receptors",
        "study = Study(": "study = Study(finger=Finger(pad_size_mm=3.0, far_size_mm=6.0),",
        "distance_mm=7.5": "distance_mm=0.4",
        "force_N=0.5": "force_N=0.05",
        "at_mm=4.0": "at_mm=0.4",
        "deformation_*": "raster*",  # the others are drawn in a process of their own
    },
    "surface": {
        "import Drawing, Protocol": "import Drawing, Finger, Protocol",
        "study = Study(": "study = Study(finger=Finger(pad_size_mm=3.0, far_size_mm=6.0),",
        "preview(study)\n": "preview(study)\ndrawn = study.stimulus\n",
        "distance_mm=6.0": "distance_mm=0.1",
        "force_N=0.3": "force_N=0.02",
        "spacing_mm = 0.05": "spacing_mm = 0.1",
    },
    "stroke": {
        "depth_mm = 1.4": "depth_mm = 0.15",
        "0.15 * np.maximum": "12 * np.maximum",
        "[0, 8.0]": "[0, 0.2]",
        "smooth_s=0.05": "smooth_s=0.05, output_s=0.75",
    },
    "fit": {
        "np.linspace(0.02, 1.5, 75)": "np.linspace(0.1, 0.3, 3)",
        "1.0, 0.03, 75": "1.0, 0.03, 3",
        "(0, 1, 75)": "(0, 0, 3)",
        '"results/tutorials/fit")': '"results/tutorials/fit", evaluations=2)',
        "depth_mm=[0.5, 1.0]": "depth_mm=0.1",
        "force_N=0.2": "force_N=0.02",
    },
    "vibration": {
        "np.geomspace(4, 1000, 9)": "np.geomspace(25, 100, 2)",
        "(1e-4, 0.5, 60)": "(1e-4, 0.5, 8)",
        'relaxation="fingerpad"': 'relaxation="none"',  # of which other tests need the forms
        "depth_mm=1.0": "depth_mm=0.2",
        "Hold(time_s=2.0)": "Hold(time_s=0.1)",
    },
}


def cells_of(path: Path, kind: str) -> list[Any]:
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == kind]


def run(path: Path) -> dict[str, Any]:
    """Run the code of a notebook, shortened, in the present folder; return its names."""
    code = "\n".join(cell.source for cell in cells_of(path, "code"))
    for long, short in SHORT.get(path.stem, {}).items():
        assert long in code
        code = code.replace(long, short)
    names: dict[str, Any] = {"__name__": path.stem}
    exec(compile(code, path.name, "exec"), names)
    plt.close("all")
    return names


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_outputs_are_stored_without_errors_and_machines(path):
    nbformat.validate(nbformat.read(path, as_version=4))
    assert path.stat().st_size < MOST_BYTES
    for cell in cells_of(path, "code"):
        assert cell.execution_count and "execution" not in cell.metadata
        assert all(output.output_type != "error" for output in cell.outputs)
        texts = [str(output.get("text", output.get("data"))) for output in cell.outputs]
        assert not re.search(r"/tmp/|/home/|/root/|/work/|INFO", " ".join(texts))
    assert any("image/png" in str(cell.outputs) for cell in cells_of(path, "code"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_only_public_names_are_used(path):
    for cell in cells_of(path, "code"):
        for node in ast.walk(ast.parse(cell.source)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tactile_fem"):
                assert node.module in PUBLIC
                public = importlib.import_module(node.module).__all__
                assert {alias.name for alias in node.names} <= set(public)


def test_they_are_short():
    words = {
        path.stem: sum(len(cell.source.split()) for cell in cells_of(path, "markdown"))
        for path in NOTEBOOKS
    }
    assert max(words.values()) <= MOST_WORDS and sum(words.values()) <= MOST_WORDS_OF_ALL


def test_the_index_names_each():
    index = (FOLDER / "index.md").read_text()
    assert set(re.findall(r"\((\w+\.ipynb)\)", index)) == {path.name for path in NOTEBOOKS}


def test_neurons_fire_on_their_own(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = run(FOLDER / "neurons.ipynb")
    counts = names["response"].counts().sum()
    assert Path("spikes.csv").read_text().count("\n") == counts + 1
    assert list(names["fired"]) == ["SA1", "RA", "PC"]
    assert all(one.counts().min() > 0 for one in names["fired"].values())
    assert names["found"].r2[-1] > 0.9


@pytest.fixture
def short(request, tmp_path, monkeypatch, capsys) -> dict[str, Any]:
    """Return the names of a notebook that ran at small size."""
    pytest.importorskip("tactile_fem.runtime.backend")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tactile_fem.output.figures.draw_pictures", lambda results, **_: [])
    return run(FOLDER / f"{request.param}.ipynb")


def runs(name: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("short", [name], indirect=True)


@needs_graphics
@runs("letters")
def test_letters_are_pressed_to_their_force(short):
    trace, slide = short["trace"], short["slide"]
    assert trace.force_N[slide][0, 2] == pytest.approx(0.05, rel=0.01)
    assert trace.displacement_mm[-1] == pytest.approx(0.4)
    assert short["rates_Hz"].shape == (400, 51)


@needs_graphics
@runs("surface")
def test_a_surface_slides_at_its_force(short):
    pytest.importorskip("svgelements")
    sliding = short["trace"].force_N[short["slide"], 2]
    assert len(sliding) > 1 and sliding == pytest.approx(0.02, rel=0.01)
    # The file has the shapes that were drawn in Python.
    areas = [sum(shape.area for shape in short[name].outlines()) for name in ("drawn", "from_file")]
    assert areas[0] == pytest.approx(areas[1], rel=0.01)


@runs("stroke")
def test_a_stroke_is_repeated_and_compared(short):
    depth, force = short["result"].trace.depth_mm, short["result"].trace.force_N
    deepest = depth.argmax()
    assert depth[deepest] == pytest.approx(0.15, abs=0.05)
    assert 0 < force[deepest, 2] < 0.05 and force[:, 1].min() < 0
    header = (short["result"].folder / "measured.csv").read_text().partition("\n")[0]
    assert header == "time_s,fy_N,model_fy_N,fx_N,model_fx_N,fz_N,model_fz_N"


@runs("fit")
def test_a_fitted_finger_is_softer(short):
    default, own = (short[name].trace for name in ("default", "own"))
    for trace in (default, own):
        assert trace.force_N[-1, 2] == pytest.approx(0.02, rel=0.01)
    assert own.depth_mm[-1] > 1.1 * default.depth_mm[-1]


@needs_graphics
@runs("vibration")
def test_a_vibration_is_felt_by_each_kind(short):
    assert short["rates_Hz"].shape == (2, short["spectrum"].population.size)
    low, high = short["threshold_um"]  # of PC
    assert 100 > low > 10 * high > 0

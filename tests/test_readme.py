"""README and pages: their code runs, their commands exist, their links lead somewhere."""

import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest
from synthetic import SLIDE, make_results

from tactile_fem.cli import app as cli
from tactile_fem.simulation.checks import check_study
from tactile_fem.study import Finger, Protocol, Receptors, Study, Text
from tactile_fem.study.file import load_study
from tactile_fem.vibration import few_of, frequencies_of

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = ROOT / "demos" / "pages"
RECIPES = PAGES / "recipes.md"
TEXTS = [README, ROOT / "docker" / "README.md", *sorted(ROOT.glob("demos/**/*.md"))]


def blocks(page, language):
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), flags=re.DOTALL)


def run(code, page):
    names = {"__name__": page.stem}
    exec(compile(code, page.name, "exec"), names)
    return names


def shortened(code, old, new):
    assert old in code
    return code.replace(old, new)


def test_the_ten_lines_run_at_small_size(tmp_path, monkeypatch, capsys):
    pytest.importorskip("tactile_fem.runtime.backend")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tactile_fem.output.figures.draw_pictures", lambda results, **_: [])
    (script,) = blocks(README, "python")
    assert len([line for line in script.splitlines() if line.strip()]) <= 13
    run(
        shortened(script, "depth_mm=1.97, distance_mm=10.0", "depth_mm=0.2, distance_mm=0.2"),
        README,
    )
    assert Path("results/letters/figures/raster.png").is_file()
    assert "[" in capsys.readouterr().out
    page = PAGES / "results.md"
    reading = shortened("".join(blocks(page, "python")), "results/scan", "results/letters")
    names = run(shortened(reading, "at_mm=5.0", "at_mm=0.2"), page)
    assert names["force_N"] > 0 and Path("interface.csv").is_file()
    described = {
        name
        for row in re.findall(r"^\| (`.*?) \| (?:steps|receptors)", page.read_text(), re.MULTILINE)
        for name in re.findall(r"`(\w+)`", row)
    }
    assert described == set(names["results"].trace)


def at(expression, F):
    """Return a UFL expression of deformation gradient and position as a number."""
    import ufl

    origin = ufl.as_vector([0.0, 0.0, 0.0])
    return ufl.as_ufl(expression(ufl.as_matrix(F.tolist()), origin))(())


def test_neurons_run_on_their_own(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = PAGES / "neurons.md"
    names = run("\n".join(blocks(page, "python")), page)
    counts = names["response"].counts()
    assert counts[15] > counts[0] + 20 and counts.sum() == len(names["spike_s"])
    (toml,) = blocks(page, "toml")
    Path("study.toml").write_text(toml)
    study = load_study("study.toml")
    assert [afferents.population().name for afferents in study.populations] == ["SA1", "RA"]
    assert study.populations[1].receptors.placement == "afferents"
    assert Path("spikes.npz").is_file() and Path("spikes.png").is_file()


def test_the_recipes_commands_are_studies_that_can_be_scanned():
    pytest.importorskip("igl")
    studies = {}
    for line in "".join(blocks(RECIPES, "sh")).splitlines():
        program, *arguments = shlex.split(line)
        assert program == "tactile-fem"
        command, bound, _ = cli.app.parse_args(arguments, exit_on_error=False)
        if command.__name__ == "vibrate":  # of a scan that has to be there
            assert len(frequencies_of(bound.arguments["frequencies"])) == 25
            continue
        if command.__name__ == "view":  # of the same
            if "vibration" not in bound.arguments:
                continue
            assert few_of(np.geomspace(1, 1000, 25)).min() < bound.arguments["vibration"]
            continue
        assert command.__name__ in ("scan", "mesh")
        if "changes" not in bound.arguments:
            continue  # of a study file, the next test's
        study = load_study(None, bound.arguments["changes"])
        check_study(study)
        studies[str(bound.arguments.get("results", command.__name__))] = study
    assert studies["results/thick"] == studies["mesh"]
    thick = studies["results/thick"].finger
    assert thick.epidermis_mm == 2 * Finger().epidermis_mm
    assert thick.pad_thickness_mm == pytest.approx(Finger().pad_thickness_mm)
    dots = [dot.centroid.y for dot in studies["results/dots"].stimulus.outlines()]
    assert min(dots) == pytest.approx(3.0) and max(dots) < 10.0
    # Under the contact point there is a stroke, and with the default text a gap.
    pressed = [studies["results/press"].stimulus, Text(start_mm=20.0), Text()]
    gaps = [float(one.body().distance(np.zeros((1, 3))).gap[0]) for one in pressed]
    assert gaps == pytest.approx([0.0, 0.0, 0.6], abs=0.03)
    plus, soft, *_ = blocks(RECIPES, "python")
    assert studies["results/soft"] == run(soft, RECIPES)["study"] != Study()
    (shape,) = run(plus, RECIPES)["study"].stimulus.outlines()
    assert shape.centroid.y == pytest.approx(3.0)


def test_the_recipes_vibration_is_a_study(tmp_path):
    first, second = (
        text for text in blocks(RECIPES, "toml") if "afferents" in text or "vib" in text
    )
    (tmp_path / "study.toml").write_text(first + second)
    study = load_study(tmp_path / "study.toml")
    assert [afferents.population().name for afferents in study.populations] == ["SA1", "RA", "PC"]
    ra, pc = study.populations[1:]
    assert (ra.feels, pc.receptors.side) == ("compression", "subcutaneous")
    assert study.protocol.pieces[1].vibration.frequency_Hz == 100.0 and study.solver.inertia


@pytest.mark.parametrize("relaxation", ["none", "fingerpad"])
def test_half_as_stiff_is_half_the_energy(relaxation):
    pytest.importorskip("ufl")
    from tactile_fem.tissue.energies import law_of

    before = Study.model_validate(
        {"tissue": {"relaxation": relaxation}, "protocol": {"depth_mm": 1.0}}
    )
    (_, code, *_) = blocks(RECIPES, "python")
    code = shortened(code, "study = Study()", "study = before")
    names = {"before": before}
    exec(compile(code, RECIPES.name, "exec"), names)
    study = names["study"]
    laws = [law_of(one.tissue.epidermis) for one in (before, study)]
    stretched = np.diag([1.2, 1.0, 0.9])
    usual, soft = (at(law.energy, stretched) for law in laws)
    assert soft == pytest.approx(usual / 2)
    assert study.tissue.epidermis.g == before.tissue.epidermis.g
    assert study.tissue.epidermis.tau_s == before.tissue.epidermis.tau_s
    others = {"tissue": {"epidermis"}}
    assert study.model_dump(exclude=others) == before.model_dump(exclude=others)


def test_the_recipes_plot_and_spikes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    make_results("results/scan")
    *_, vibration, plot, spikes, neo, _ = blocks(RECIPES, "python")
    compile(vibration, RECIPES.name, "exec")
    names = run(plot, RECIPES)
    # The end of the press, at displacement 0, and the slide.
    assert names["slide"].sum() == SLIDE + 1 and names["middle"] == 10
    assert Path("sed.png").is_file()
    names = run(spikes, RECIPES)
    assert names["counts"].shape == (20, 3)
    assert np.array_equal(names["counts"].sum(axis=0), names["response"].counts())
    pytest.importorskip("neo")
    exec(compile(neo, RECIPES.name, "exec"), names)


@pytest.mark.slow
def test_the_recipes_scan_is_watched(small_finger, tmp_path, monkeypatch, capsys):
    pytest.importorskip("tactile_fem.runtime.backend")
    monkeypatch.chdir(tmp_path)
    code = blocks(RECIPES, "python")[-1]
    brief = Study(
        finger=Finger(mesh_file=small_finger),
        protocol=Protocol(depth_mm=0.2, distance_mm=0.0),
        receptors=Receptors(spacing_mm=2.5),
    )
    monkeypatch.setattr("tactile_fem.study.Study", lambda: brief)
    names = run(code, RECIPES)
    lines = capsys.readouterr().out.strip().splitlines()
    assert len(lines) == len(names["result"].trace.time_s) - 1


def test_the_page_of_commands_names_each():
    page = "\n".join(blocks(PAGES / "commands.md", "sh"))
    commands = set(re.findall(r"^tactile-fem (\w+)", page, flags=re.MULTILINE))
    there = {name for name in cli.app if not name.startswith("-")}
    assert commands == there


def test_the_files_of_the_results_folder_are_all_named():
    text = (PAGES / "results.md").read_text()
    for name in ("study.toml", "run.json", "trace.npz", "spikes.csv", "checkpoint.npz", "log.txt"):
        assert f"`{name}`" in text


def test_shell_scripts_are_well_formed():
    scripts = blocks(PAGES / "parallel.md", "bash")
    assert len(scripts) == 2
    for script in scripts:
        subprocess.run(["bash", "-n"], input=script, text=True, check=True)


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(text):
    for target in re.findall(r"\]\(([^)\s]+)\)", text.read_text()):
        if target.startswith(("http:", "https:", "mailto:")):
            continue
        path, _, anchor = target.partition("#")
        page = text.parent / path if path else text
        assert page.exists(), target
        if anchor:
            titles = re.findall(r"^#+ (.*)$", page.read_text(), flags=re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", title).lower().replace(" ", "-") for title in titles}
            assert anchor in slugs, target


def test_every_page_is_in_the_index():
    index = (PAGES / "README.md").read_text()
    for page in PAGES.glob("*.md"):
        assert page.name == "README.md" or f"]({page.name})" in index, page.name


def test_citation_and_package_have_the_same_version():
    cited, packaged = (
        re.findall(pattern, (ROOT / name).read_text(), flags=re.MULTILINE)
        for name, pattern in (
            ("CITATION.cff", r"^version: (\S+)$"),
            ("pyproject.toml", r'^version = "(\S+)"$'),
        )
    )
    assert cited == packaged and len(cited) == 1


def test_pictures_are_small():
    for picture in PAGES.glob("*.png"):
        assert picture.stat().st_size < 150_000, picture.name

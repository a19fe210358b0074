"""Own code that a study names as ``module:name``: heights, laws, terms and drives."""

from __future__ import annotations

import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tactile_fem.cli.app import main
from tactile_fem.errors import StudyError
from tactile_fem.results.results import Results
from tactile_fem.series import sweep
from tactile_fem.simulation.checks import check
from tactile_fem.study import Heights, Study
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.template import commented_template

BAD_PARTS = """
def one(*args):
    return 1.0


def lost(trace):
    return trace["nothing"]


def same(F, at):
    return F
"""

MODULE = """
from dataclasses import dataclass

import numpy as np
import ufl

from tactile_fem import Term
from tactile_fem.neuron import Drive

print("it runs")


def wavy(x, y):
    return 0.2 * np.cos(np.pi * x) * np.cos(np.pi * y / 2)


def step(x, y):
    return np.where(x > 0.123, 0.3, 0.0)


def broken(x, y):
    return unknown * x


def fung(F, at, shear_MPa, bulk_MPa, b=2.0):
    J = ufl.det(F)
    distortion = J ** (-2 / 3) * ufl.tr(F.T * F) - 3
    return shear_MPa / (2 * b) * (ufl.exp(b * distortion) - 1) + bulk_MPa / 2 * (J - 1) ** 2


@dataclass(frozen=True)
class Fung:
    shear_MPa: float
    bulk_MPa: float
    b: float = 2.0

    def energy(self, F, at):
        return fung(F, at, self.shear_MPa, self.bulk_MPa, self.b)

    def in_shear(self, a, at):
        return self.shear_MPa / (2 * self.b) * (ufl.exp(self.b * a) - 1)


class Gravity(Term):
    is_symmetric = True

    def residual(self, v):
        return 9.81e-6 * v[len(v) - 1] * self.tissues.dx


def deep(trace):
    return 2 * trace["moved_mm"][..., 2]


Deep = Drive("Twice as deep", "mm", deep)
g = 9.81
"""
STUDY = """
[finger]
mesh_file = "{finger}"

[stimulus]
kind = "heights"
z = "mine:wavy"
cell_mm = 0.1
period_mm = [2.0, 4.0]

[tissue.subcutaneous]
law = "mine:{law}"
shear_MPa = 0.8e-3
bulk_MPa = 0.02

[protocol]
path = [{{ kind = "press", depth_mm = 0.3 }}]

[[afferents]]
name = "deep"
feels = "mine:{drive}"
receptors = {{ spacing_mm = 5.0 }}

[solver]
terms = ["mine:Gravity"]
max_press_step_mm = 0.3

[output]
pictures = false
"""


@pytest.fixture
def here(tmp_path, small_finger) -> Path:
    """A folder with a module and a study."""
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "mine.py").write_text(MODULE)
    text = STUDY.format(finger=small_finger, law="Fung", drive="Deep")
    (folder / "s.toml").write_text(text)
    return folder


def test_a_study_is_read_and_written_without_running_its_code(here, capsys):
    study = load_study(here / "s.toml")
    file = here / "mine.py"
    assert study.stimulus.z == f"{file}:wavy"
    assert {key: value for key, value in study.files().items() if value == file} == dict.fromkeys(
        ["stimulus.z", "tissue.subcutaneous.law", "solver.terms (entry 1)", "afferents.deep.feels"],
        file,
    )
    (here / "t.toml").write_text(dump_study(study))
    assert load_study(here / "t.toml") == study == Study.model_validate(study.model_dump())
    assert Study.model_validate_json(study.model_dump_json()) == study
    assert pickle.loads(pickle.dumps(study)) == study  # to other ranks
    assert study.tissue.subcutaneous.scaled(2.0).shear_MPa == 1.6e-3
    assert capsys.readouterr().out == ""
    check(study)
    assert capsys.readouterr().out == "it runs\n"


def test_heights_are_those_of_the_function(here):
    from tactile_fem.stimulus.sampled import height_map

    x, y = np.linspace(-3.1, 3.3, 40), np.linspace(-2.0, 9.7, 30)
    expected = 0.2 * np.cos(np.pi * x)[:, None] * np.cos(np.pi * y / 2)
    body = load_study(here / "s.toml").stimulus.body()
    np.testing.assert_allclose(height_map(body, x, y), expected - 0.2, atol=2e-4)
    along_x = Heights(z=lambda x, y: 0.2 * np.cos(np.pi * x) + 0 * y, period_mm=(2.0, 0.0))
    body = along_x.model_copy(update={"size_mm": (9.0, 8.0)}).body()
    np.testing.assert_allclose(
        height_map(body, x, y)[:, ::9], np.tile(0.2 * np.cos(np.pi * x) - 0.2, (4, 1)).T, atol=2e-4
    )
    slope = Heights(z=lambda x, y: 0.1 * y, cell_mm=0.5, size_mm=(10.0, 20.0))
    body = slope.body()
    found = height_map(body, np.array([0.0]), np.array([-3.0, 5.0]))
    assert np.diff(found)[0, 0] == pytest.approx(0.8, abs=1e-3)


def test_a_function_of_a_script_is_known_while_that_runs(tmp_path):
    study = Study(stimulus=Heights(z=np.hypot, cell_mm=0.5, size_mm=(9.0, 9.0)))
    same = Study(stimulus=Heights(z=np.hypot, cell_mm=0.5, size_mm=(9.0, 9.0)))
    assert study == same and study.stimulus.z.startswith("hypot ")
    (tmp_path / "s.toml").write_text(dump_study(study))
    assert load_study(tmp_path / "s.toml") == study
    from tactile_fem.runtime import own_code

    own_code._given.clear()
    with pytest.raises(StudyError, match="it is known where its script runs"):
        load_study(tmp_path / "s.toml").stimulus.body()


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("stimulus.z=wavy", 'stimulus.z is "wavy" but must be "module:name", what a Python file'),
        ("stimulus.z=other:wavy", "stimulus.z = {here}/other.py:wavy: there is no such file"),
        ("stimulus.z=mine:nothing", "has no attribute 'nothing'"),
        ("stimulus.z=mine:g", "stimulus.z = {here}/mine.py:g is a float, no function or class"),
        ("stimulus.z=mine:broken", "NameError: name 'unknown' is not defined (line 22)"),
        ("stimulus.z=mine:step", "mm that is too sharp for cell_mm = 0.1 ("),
        ("stimulus.period_mm=[1.5, 4.0]", "check that it repeats after period_mm"),
        ("stimulus.cell_mm=0.0001", "stimulus.cell_mm = 0.0001 makes 800,000,000 heights, but"),
        ("stimulus.z=bad:f", "stimulus.z = {here}/bad.py:f: ZeroDivisionError: division by zero"),
        ("stimulus.z=two:f", "ImportError: mine lies beside it, but results keep a copy of one"),
        ("tissue.subcutaneous.law=mine:fun", "tissue: law = {here}/mine.py:fun: AttributeError"),
        ("tissue.subcutaneous.c=1", "got an unexpected keyword argument 'c'"),
        ("tissue.subcutaneous.b=stiff", 'tissue.subcutaneous.b is "stiff" but must be a number.'),
        ("solver.terms=[5]", 'solver.terms (entry 1) is 5 but must be "module:name", what'),
        ("solver.terms=['mine:G']", "solver.terms: {here}/mine.py:G: AttributeError"),
        ("afferents.deep.feels=mine:g", "afferents.deep.feels: {here}/mine.py:g is a float"),
        ("afferents.deep.feels=bad_parts:one", "afferents.deep.feels: One has shape (); it needs"),
        ("afferents.deep.feels=bad_parts:lost", "{here}/bad_parts.py:lost: KeyError: 'nothing'"),
        ("tissue.epidermis={law='bad_parts:one'}", "the energy of epidermis is not larger at a"),
        ("tissue.epidermis={law='bad_parts:same'}", "epidermis is not a finite number at a small"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(here, setting, sentence, capsys):
    (here / "bad.py").write_text("1 / 0\n")
    (here / "two.py").write_text("from mine import wavy as f\n")
    (here / "bad_parts.py").write_text(BAD_PARTS)
    assert main(["scan", str(here / "s.toml"), "--set", setting]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert sentence.format(here=here) in line


def test_a_function_is_a_law_too(here):
    from tactile_fem.tissue.energies import bulk_modulus, shear_modulus

    for law in "mine:fung", "mine:Fung":
        study = load_study(here / "s.toml", [f"tissue.subcutaneous.law={law}"])
        own = study.tissue.subcutaneous
        assert float(shear_modulus(own)) == pytest.approx(0.8e-3)
        assert float(bulk_modulus(own)) == pytest.approx(0.02)
        assert hasattr(own, "in_shear") == (law == "mine:Fung")


def test_members_of_a_sweep_name_the_module_where_it_is(here, tmp_path):
    members = sweep(["stimulus.z=mine:wavy,mine:step"], here / "s.toml")
    assert [one.study.stimulus.z.rpartition("/")[2] for one in members] == [
        "mine.py:wavy",
        "mine.py:step",
    ]
    (tmp_path / "m.toml").write_text(dump_study(members[0].study))
    assert load_study(tmp_path / "m.toml") == members[0].study


def run(*words, folder=None):
    words = [sys.executable, "-m", "tactile_fem", *map(str, words)]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_scan_goes_on_elsewhere_without_the_module(here, tmp_path):
    """Without its law and its term, which would be compiled."""
    from tactile_fem import resume, scan

    text = (here / "s.toml").read_text()
    own = text[text.index("[tissue") : text.index("[protocol")], 'terms = ["mine:Gravity"]\n'
    for part in own:
        text = text.replace(part, "")
    (here / "s.toml").write_text(text)
    study = load_study(here / "s.toml")
    scan(study, here / "r")
    before = Results.open(here / "r")
    assert before.complete and before.is_of(study)
    assert before.run["files"]["stimulus.z"] == before.run["files"]["afferents.deep.feels"] != ""
    (here / "mine.py").write_text(MODULE.replace("0.2", "0.3"))
    changed = Results.open(here / "r")
    assert not changed.is_of(study) and changed.is_of(study, though_changed=True)
    elsewhere = tmp_path / "elsewhere"
    shutil.move(here / "r", elsewhere)
    shutil.rmtree(here)
    there = Results.open(elsewhere)
    assert there.study.stimulus.z.startswith(f"{elsewhere}/inputs/mine-")
    np.testing.assert_allclose(
        there.study.populations[0].population().felt(there.trace)[1],
        2 * there.trace["moved_mm"][..., 2],
    )
    assert len(resume(elsewhere).trace) == len(there.trace["time_s"])


@pytest.mark.slow
def test_a_law_and_a_term_are_those_of_parts_on_two_ranks(here, tmp_path):
    from tactile_fem import Parts, scan
    from tactile_fem.runtime.own_code import Code

    run("sweep", "s.toml", "--over", "stimulus.friction=0.2,0.3", "--ranks", "2", folder=here)
    (found,) = (Results(each) for each in here.glob("results/**/friction-0.3"))
    law, term = (Code(f"{here}/mine.py:{name}").load() for name in ("Fung", "Gravity"))
    study = load_study(here / "s.toml", ["solver.terms=[]", "tissue.subcutaneous={}"])
    parts = Parts(laws={"subcutaneous": law(0.8e-3, 0.02)}, terms=(term,))
    expected = scan(study, parts=parts).trace
    np.testing.assert_allclose(found.trace["force_N"][-1], expected.force_N[-1], rtol=1e-5)


def test_the_template_has_their_keys():
    words = " ".join(commented_template().replace("\n# ", " ").split())
    assert 'or kind = "heights": a surface whose heights are a function' in words
    assert "z must be given:" in words and "terms = []" in words

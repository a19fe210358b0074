"""A script's own kinds of stimulus and of piece join the study without a change to the package."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path as FilePath
from typing import Literal

import numpy as np
import pytest
import shapely
from needs import needs_graphics
from pydantic import Field

from tactile_fem.errors import StudyError
from tactile_fem.finger import read_mesh
from tactile_fem.path import Motion, Piece
from tactile_fem.runtime.settings import File, Positive
from tactile_fem.simulation.checks import check
from tactile_fem.simulation.parts import Parts
from tactile_fem.stimulus import Distance, Stimulus
from tactile_fem.study import Plate, Press, Protocol, Study
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.template import commented_template


class Wave(Stimulus):
    """A wavy plate, its crests across the finger."""

    kind: Literal["wave"] = "wave"
    height_mm: Positive = Field(0.2, description="from trough to crest")
    length_mm: Positive = Field(4.0, description="of a wave")
    scale_file: File | None = Field(None, description="a text file with a factor for height_mm")

    def shape(self):
        return Waves(self.height_mm * self._factor(), 2 * np.pi / self.length_mm)

    def raised(self):
        return [shapely.box(-10, -self.length_mm / 4, 10, self.length_mm / 4)]

    def _factor(self):
        return float(self.scale_file.read_text()) if self.scale_file else 1.0


class Waves:
    def __init__(self, height, k):
        self.half, self.k = height / 2, k
        self.cosine = 1 / np.hypot(1, self.half * k)

    def distance(self, points):
        s, c = (f(self.k * points[:, 1]) for f in (np.sin, np.cos))
        gap = points[:, 2] + self.half * (1 - c)
        normal = np.column_stack([0 * s, self.half * self.k * s, 1 + 0 * s])
        hessian = np.zeros((len(s), 3, 3))
        hessian[:, 1, 1] = self.half * self.k**2 * c
        return Distance(self.cosine * gap, self.cosine * normal, self.cosine * hessian)


class Zigzag(Piece):
    """A zigzag towards the palm."""

    kind: Literal["zigzag"] = "zigzag"
    width_mm: Positive = Field(0.5, description="from side to side")

    def motion(self, start_mm):
        def place(t):
            return start_mm + np.array([self.width_mm * (1 - abs(2 * t - 1)), -2.0 * t, 0.0])

        return Motion("zigzag", 1.0, place, knots_s=np.array([0.0, 0.5, 1.0]))


# Other tests see the package's kinds only.
del Stimulus.kinds["wave"], Piece.kinds["zigzag"]


@pytest.fixture(autouse=True)
def known(monkeypatch):
    monkeypatch.setitem(Stimulus.kinds, "wave", Wave)
    monkeypatch.setitem(Piece.kinds, "zigzag", Zigzag)


def study_of(**keys) -> Study:
    path = Press(depth_mm=1.0), Zigzag(width_mm=0.7)
    return Study(stimulus=Wave(**keys), protocol=Protocol(path=path))


def test_they_are_written_and_read_back(tmp_path):
    study = study_of(length_mm=3.0, shift_mm=(0.0, 1.0))
    (tmp_path / "s.toml").write_text(dump_study(study))
    assert load_study(tmp_path / "s.toml") == study
    assert Study.model_validate_json(study.model_dump_json()) == study
    changed = load_study(tmp_path / "s.toml", ["stimulus.height_mm=0.3"])
    assert changed.stimulus == study.stimulus.model_copy(update={"height_mm": 0.3})
    check(study)


def test_paths_of_their_files_start_from_the_studys_folder(tmp_path, monkeypatch):
    (tmp_path / "s.toml").write_text("stimulus = {kind='wave', scale_file='factor.txt'}")
    study = load_study(tmp_path / "s.toml")
    assert study.stimulus == Wave(scale_file=tmp_path / "factor.txt")


def test_they_have_their_body_and_their_motion():
    study = study_of(shift_mm=(0.0, 1.0))
    body = study.stimulus.body()
    assert body is study.stimulus.body()
    at = body.distance(np.array([[0.0, 1.0, 0.0], [0.0, 3.0, -0.2]]))  # crest and trough
    np.testing.assert_allclose(at.gap, 0.0, atol=1e-12)
    assert study.stimulus.outlines()[0].centroid.y == pytest.approx(1.0)
    np.testing.assert_allclose(study.protocol.route(4.0).places_mm()[-2], [0.7, -1.0, 1.0])


def test_the_files_that_they_name_are_known_by_their_content(tmp_path):
    file = tmp_path / "factor.txt"
    file.write_text("1.0")
    stimulus = study_of(scale_file=file).stimulus
    trough = np.array([[0.0, 2.0, 0.0]])
    low = stimulus.body().distance(trough).gap[0]
    assert Study(stimulus=stimulus).files() == {"stimulus.scale_file": file}
    file.write_text("2.0")
    assert stimulus.body().distance(trough).gap[0] > 1.5 * low


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        (
            "stimulus={kind='wave', length=1}",
            'stimulus.length is not a key of a stimulus of kind "wave"; did you mean length_mm?',
        ),
        (
            "stimulus={kind='wave', height_mm=0}",
            "stimulus.height_mm is 0 but must be greater than 0.",
        ),
        ("stimulus={kind='wav'}", "no kind of stimulus; did you mean wave?"),
        ("stimulus={length_mm=2}", 'of kind "text"; it goes with kind = "wave".'),
        (
            "protocol.path=[{kind='zigzag', width=1}]",
            'width is not a key of a piece of kind "zigzag"; did you mean width_mm?',
        ),
        ("protocol.path=[{kind='zigzak'}]", "no kind of piece; did you mean zigzag?"),
    ],
)
def test_what_is_wrong_with_them_is_explained(tmp_path, setting, sentence):
    (tmp_path / "s.toml").write_text(setting)
    with pytest.raises(StudyError, match=re.escape(sentence)):
        load_study(tmp_path / "s.toml")


def test_results_are_read_where_they_are_not_known(tmp_path, monkeypatch):
    study, file = study_of(length_mm=3.0), tmp_path / "study.toml"
    file.write_text(dump_study(study))
    monkeypatch.delitem(Stimulus.kinds, "wave")
    monkeypatch.delitem(Piece.kinds, "zigzag")
    there = load_study(file, saved=True)
    assert dump_study(there) == dump_study(study) and there.stimulus.length_mm == 3.0
    for use in (there.stimulus.body, lambda: there.protocol.route(4.0)):
        with pytest.raises(StudyError, match=r"is known where its module is imported"):
            use()
    with pytest.raises(StudyError, match=r"no kind of stimulus"):
        load_study(file)
    assert study.stimulus.is_kept_sampled and not Plate().is_kept_sampled


def test_the_template_describes_them():
    words = " ".join(commented_template().replace("\n# ", " ").split())
    assert 'or kind = "wave": a wavy plate, its crests across the finger' in words
    assert "width_mm = 0.5: from side to side [> 0]" in words


def test_a_name_is_given_once():
    with pytest.raises(TypeError, match=r'"wave" is taken by test_own_kinds\.Wave'):

        class Other(Stimulus):
            kind: Literal["wave"] = "wave"

    assert Stimulus.kinds["wave"] is Wave


@needs_graphics
def test_they_are_drawn(small_finger):
    from tactile_fem.output.preview import preview_figure

    study = study_of()
    route = study.protocol.route(4.0)
    figure = preview_figure(read_mesh(small_finger), study.stimulus.body(), route)
    _, way, _ = figure.axes[1].lines
    np.testing.assert_allclose(way.get_xydata()[-2], [-0.7, 1.0], atol=1e-12)


def test_a_kind_moves_its_shape_not_its_body():
    """Or `shift_mm` would have no effect."""
    with pytest.raises(TypeError, match="Other must define shape: body moves it by shift_mm"):

        class Other(Stimulus):
            kind: Literal["other"] = "other"

            def body(self):
                return None


def test_the_rooms_import_all_kinds():
    """One whose module nobody imports would be no kind, for a study."""
    code = """
import pkgutil, importlib, tactile_fem
from tactile_fem.study.file import _FAMILIES
known = [set(family.kinds) for family in _FAMILIES]
for room in ("stimulus", "path", "tissue", "shapes"):
    for module in pkgutil.iter_modules([f"{tactile_fem.__path__[0]}/{room}"]):
        importlib.import_module(f"tactile_fem.{room}.{module.name}")
assert known == [set(family.kinds) for family in _FAMILIES]
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_kinds_load_nothing_heavy():
    heavy = "scipy", "shapely", "matplotlib", "igl", "trimesh", "PIL", "dolfinx"
    code = (
        "import sys, tactile_fem.stimulus, tactile_fem.path\n"
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.stdout.strip() == "[]", found.stderr


def test_rooms_know_nothing_of_those_above_them():
    package = FilePath(sys.modules["tactile_fem"].__file__).parent
    above = "study|simulation|mechanics|output|calibration|series|vibration|neuron|receptors|cli"
    for file in [*package.glob("stimulus/*.py"), *package.glob("path/*.py")]:
        found = re.findall(rf"^\s*from tactile_fem\.(?:{above})\b.*", file.read_text(), re.M)
        assert not found, file


def test_all_that_is_wrong_is_said_at_once():
    study = load_study(None, ['stimulus.text="\u4e2d"', "protocol.depth_mm=6"])
    with pytest.raises(StudyError) as found:
        check(study, Parts(laws={"hair": None}, path=None))
    lines = str(found.value).splitlines()
    assert [line.partition(" ")[0] for line in lines] == [
        "parts.laws:",
        "protocol.depth_mm",
        "stimulus.text:",
    ]

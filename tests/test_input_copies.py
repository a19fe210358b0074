"""Results folders that are moved to where no file that their study named is left."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib import font_manager
from needs import needs_graphics
from synthetic import make_fields, make_results

from tactile_fem.cli.app import main
from tactile_fem.errors import StudyError
from tactile_fem.results.previous import earlier_scan
from tactile_fem.results.results import Results
from tactile_fem.study import Finger, Follow, Mesh, Plate, Press, Protocol, Study, Surface, Text
from tactile_fem.study.file import load_study
from tactile_fem.study.input_copies import named_files

DEJAVU = Path(font_manager.findfont("DejaVu Sans"))
POINTS = np.array([[x, y, 0.1] for x in (-3.0, 0.4, 2.0) for y in (-2.0, 0.3, 5.1)])


@pytest.fixture
def away(tmp_path) -> Path:
    """A folder for the files that will be gone."""
    (tmp_path / "away" / "deep").mkdir(parents=True)
    return tmp_path / "away"


def heights(away: Path, scale: float = 0.1) -> Path:
    file = away / "map.csv"
    np.savetxt(file, scale * np.sin(np.arange(400.0).reshape(20, 20)), delimiter=",")
    return file


def studies(away: Path) -> dict[str, Study]:
    """Return studies that name files of every kind; files of one name lie in two folders."""
    places = []
    for number, folder in enumerate((away, away / "deep")):
        places.append(folder / "way.csv")
        places[-1].write_text(f"time_s,x_mm,y_mm,z_mm\n0,0,0,0\n1,0,0,{number + 1}\n")
    font = Path(shutil.copy(DEJAVU, away / "mine.TTF"))
    for name in ("f.msh", "skin", "bone.stl", "nail.ply", "part.obj"):
        (away / name).write_text(name)
    path = Protocol(path=(Press(depth_mm=0.1), *(Follow(file=file) for file in places)))
    scans = Finger(
        skin_file=away / "skin", bone_file=away / "bone.stl", nail_file=away / "nail.ply"
    )
    surface = Surface(file=heights(away), spacing_mm=0.5, unit_mm=1.0)
    return {
        "surface": Study(stimulus=surface, protocol=path),
        "font file": Study(stimulus=Text(text="O", font=str(font))),
        "font family": Study(stimulus=Text(text="O")),
        "part": Study(stimulus=Mesh(file=away / "part.obj"), finger=scans),
        "mesh": Study(stimulus=Plate(), finger=Finger(mesh_file=away / "f.msh")),
    }


def moved(results: Results, away: Path, monkeypatch) -> Results:
    """Return the results elsewhere; what the study named is gone, its font not installed."""
    shutil.rmtree(away)
    elsewhere = results.folder.parent / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    shutil.move(results.folder, "here")

    real = font_manager.findfont

    def findfont(font, **kwargs):
        if font.get_file() is None:
            raise ValueError("no such font")
        return real(font, **kwargs)

    monkeypatch.setattr(font_manager, "findfont", findfont)
    return Results.open("here")


@pytest.mark.parametrize("kind", ["surface", "font file", "font family", "part", "mesh"])
def test_every_file_is_kept_with_the_results(kind, away, monkeypatch):
    study = studies(away)[kind]
    contents = [
        (Path(name) if Path(name).is_absolute() else DEJAVU).read_bytes()
        for name in named_files(study)
    ]
    results = make_results(away.parent / "r", study)
    assert results.study == study and Results.open(results.folder).study == study
    assert not results.is_of(Study(stimulus=Plate()))
    there = moved(results, away, monkeypatch)
    kept = [Path(name) for name in named_files(there.study)]
    assert [file.read_bytes() for file in kept] == contents
    assert {file.parent for file in kept} == {Path("here/inputs").absolute()}
    assert there.is_of(study) and there.is_of(there.study)
    assert load_study("here/study.toml") == there.study


@pytest.mark.parametrize("kind", ["surface", "font file", "font family"])
def test_moved_results_are_drawn_and_have_their_body(kind, away, monkeypatch, capsys):
    study = studies(away)[kind]
    before = study.stimulus.body().distance(POINTS).gap
    there = moved(make_results(away.parent / "r", study), away, monkeypatch)
    np.testing.assert_array_equal(there.study.stimulus.body().distance(POINTS).gap, before)
    assert main(["plot", "here"]) == 0
    assert "sed.png" in capsys.readouterr().out


@needs_graphics
def test_moved_results_are_viewed(away, monkeypatch, capsys):
    results = make_results(away.parent / "r", studies(away)["surface"])
    make_fields(results, (0.0, 2.5))
    moved(results, away, monkeypatch)
    assert main(["view", "here", "--save", "film.gif"]) == 0
    assert main(["plot", "here"]) == 0
    assert "deformation" in capsys.readouterr().out


def test_a_file_that_changed_is_not_the_scans(away):
    study = studies(away)["surface"]
    results = Results.create(away.parent / "r")
    results.save_study(study)
    before = study.stimulus.body().distance(POINTS).gap
    heights(away, 0.2)
    (again := Results.open(results.folder)).save_run({"status": "stopped"})
    np.testing.assert_array_equal(again.study.stimulus.body().distance(POINTS).gap, before)
    assert not again.is_of(study)
    with pytest.raises(StudyError, match=r"has changed since the scan in .* began: bring it"):
        earlier_scan(results.folder, study)
    heights(away)
    assert earlier_scan(results.folder, study) == "unfinished"


def test_another_file_in_an_edited_study_is_no_copy(away):
    results = Results.create(away.parent / "r")
    results.save_study(studies(away)["surface"])
    text = (results.folder / "study.toml").read_text()
    shutil.copy(away / "map.csv", away / "other.csv")
    (results.folder / "study.toml").write_text(text.replace("map.csv", "other.csv"))
    assert load_study(results.folder / "study.toml").stimulus.file == away / "other.csv"
    over = load_study(results.folder / "study.toml", [f"stimulus.file={away / 'map.csv'}"])
    assert over.stimulus.file == away / "map.csv"


def test_a_scan_is_overwritten_by_its_own_study(away):
    """Its files are gone but for the copies, which are copied before they are removed."""
    results = Results.create(away.parent / "r")
    results.save_study(studies(away)["surface"])
    (results.folder / "inputs" / "mine.txt").write_text("a user's own")
    shutil.rmtree(away)
    before = results.study
    Results.create(results.folder, overwrite=True).save_study(before)
    results = Results.open(results.folder)
    assert len(list((results.folder / "inputs").iterdir())) == 3 + 1
    assert results.is_of(before) and results.study.stimulus.file.is_file()
    Results.create(results.folder, overwrite=True).save_study(Study(stimulus=Plate()))
    assert [file.name for file in (results.folder / "inputs").iterdir()] == ["mine.txt"]

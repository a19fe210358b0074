"""What is read from a file is read again when the file has changed, and recorded as it was read."""

import os
import shutil
from pathlib import Path

from mpi4py import MPI

import matplotlib as mpl
import numpy as np
import pytest
from synthetic import make_results

from tactile_fem.errors import StudyError
from tactile_fem.finger import MESH_FOLDERS
from tactile_fem.runtime.files import cached_by_content, check_unchanged, hashes
from tactile_fem.series.members import Member
from tactile_fem.series.run import run_series
from tactile_fem.simulation.parts import Parts
from tactile_fem.simulation.run import completed
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.study import Finger, Mesh, Protocol, Receptors, Study, Surface, Text

FONTS = Path(mpl.get_data_path()) / "fonts" / "ttf"


def replace(file, write):
    """Write a file anew with the same size and times, as a quick rewrite may leave them."""
    before = file.stat()
    write(file)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


def bump(height):
    heights = np.zeros((20, 20))
    heights[10, 10] = height
    return lambda file: np.save(file, heights)


def test_a_surface_is_read_again(tmp_path):
    file = tmp_path / "map.npy"
    stimulus = Surface(file=file, spacing_mm=0.1, unit_mm=1.0)
    bump(0.2)(file)
    low = stimulus.body().distance(np.zeros((1, 3))).gap
    assert stimulus.body() is stimulus.body()
    replace(file, bump(0.4))
    high = stimulus.body().distance(np.zeros((1, 3))).gap
    assert high != pytest.approx(low, abs=1e-3)
    replace(file, bump(0.2))
    assert stimulus.body().distance(np.zeros((1, 3))).gap == pytest.approx(low)


def test_a_font_is_read_again(tmp_path):
    file = tmp_path / "f.ttf"
    stimulus = Text(text="I", font=str(file))
    areas = []
    for name in ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf"):
        shutil.copyfile(FONTS / name, file)
        areas.append(sum(shape.area for shape in stimulus.outlines()))
        body = stimulus.body()
        shutil.copyfile(FONTS / name, tmp_path / "other.ttf")
        other = Text(text="I", font=str(tmp_path / "other.ttf")).body()
        points = np.random.default_rng(0).uniform(-2, 0, (50, 3))
        assert body.distance(points).gap == pytest.approx(other.distance(points).gap)
    assert areas[1] > 1.2 * areas[0]


def test_a_part_is_read_again(tmp_path):
    pytest.importorskip("igl", reason='pip install "tactile-fem[cad]"')
    import trimesh

    file = tmp_path / "part.stl"
    stimulus = Mesh(file=file, grid_mm=0.15, edge_radius_mm=0.4)
    at = np.array([[1.5, 0.0, -1.0]])
    trimesh.creation.box([2.0, 2.0, 2.0]).export(file)
    assert stimulus.body().distance(at).gap == pytest.approx(0.5, abs=1e-2)
    replace(file, lambda f: trimesh.creation.box([4.0, 2.0, 2.0]).export(f))
    assert stimulus.body().distance(at).gap == pytest.approx(-0.5, abs=1e-2)


def test_a_mesh_is_read_again(tmp_path):
    small = next(folder for folder in MESH_FOLDERS if (folder / "small.npz").is_file())
    file = tmp_path / "mine.npz"
    shutil.copyfile(small / "small.npz", file)
    first = Finger(mesh_file=file).check()
    assert Finger(mesh_file=file).check() is first
    shutil.copyfile(small / "coarse.npz", file)
    assert Finger(mesh_file=file).check().hash != first.hash


def test_a_file_that_changes_while_it_is_read_is_not_kept(tmp_path):
    file = tmp_path / "map.npy"
    bump(0.2)(file)

    @cached_by_content(maxsize=4)
    def read(surface):
        content = np.load(surface.file)
        bump(0.4)(file)
        return content

    with pytest.raises(StudyError, match=r"map\.npy was changed while it was read"):
        read(Surface(file=file))
    assert read(Surface(file=file)).max() == 0.4


def test_the_hashes_name_every_file_of_a_study(tmp_path):
    font, way = tmp_path / "f.ttf", tmp_path / "way.csv"
    font.write_text("a")
    study = Study(
        finger=Finger(skin_file=tmp_path / "skin.stl"),
        stimulus=Text(font=str(font)),
        protocol=Protocol(path=[{"kind": "press", "depth_mm": 1}, {"kind": "follow", "file": way}]),
    )
    found = hashes(study.files())
    assert list(found) == ["finger.skin_file", "stimulus.font", "protocol.path (entry 2).file"]
    assert [len(text) for text in found.values()] == [0, 64, 0]
    way.write_text("new")
    with pytest.raises(StudyError, match=r"way\.csv was changed"):
        check_unchanged(study.files(), found)
    assert Text().files()["font"].name == "DejaVuSans.ttf"  # of the family


def test_a_scan_records_what_it_has_read(tmp_path, monkeypatch):
    file = tmp_path / "map.npy"
    bump(0.2)(file)
    stimulus = Surface(file=file, spacing_mm=0.1, unit_mm=1.0)
    small = Finger(pad_size_mm=3, far_size_mm=6)
    study = Study(finger=small, stimulus=stimulus, receptors=Receptors(half_width_mm=0.0))
    made = Simulation(study, Parts(), MPI.COMM_SELF)
    assert made.files == hashes({"stimulus.file": file})

    def body_and_change(stimulus):
        body = body_of(stimulus)
        bump(0.4)(file)
        return body

    body_of = Surface.body
    monkeypatch.setattr(Surface, "body", body_and_change)
    with pytest.raises(StudyError, match=r"map\.npy was changed while it was read"):
        Simulation(study, Parts(), MPI.COMM_SELF)


def test_finished_results_belong_to_the_files_they_were_made_from(tmp_path):
    file = tmp_path / "map.npy"
    bump(0.2)(file)
    study = Study(stimulus=Surface(file=file, spacing_mm=0.1, unit_mm=1.0))
    make_results(tmp_path / "r", study)
    series = [Member("r", study, {})]
    assert completed(study, tmp_path / "r").complete
    assert not run_series(series, tmp_path)[0].problem
    bump(0.4)(file)
    with pytest.raises(StudyError, match="A file that the study names has changed since the scan"):
        completed(study, tmp_path / "r")
    with pytest.raises(StudyError, match="or a file that it names has changed"):
        run_series(series, tmp_path)
    file.unlink()
    assert completed(study, tmp_path / "r").complete

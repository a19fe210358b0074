import pickle
import re
from pathlib import Path
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from synthetic import make_fields, make_results

import tactile_fem
from tactile_fem.errors import StudyError
from tactile_fem.output.figures import draw_plots
from tactile_fem.results.fields import FieldWriter, read_series
from tactile_fem.results.results import Results
from tactile_fem.runtime.files import atomic_write
from tactile_fem.study import Plate, Protocol, Study

STEPS, RECEPTORS = 5, 3


def trace():
    time = np.linspace(-0.1, 0.3, STEPS)
    return {
        "time_s": time,
        "displacement_mm": 20 * np.maximum(time, 0),
        "depth_mm": np.full(STEPS, 1.97),
        "stimulator_mm": np.zeros((STEPS, 3)),
        "force_N": np.ones((STEPS, 3)),
        "moment_Nmm": np.ones((STEPS, 3)),
        "receptors_mm": np.zeros((RECEPTORS, 3)),
        "sed_kPa": np.arange(STEPS * RECEPTORS, dtype=float).reshape(STEPS, RECEPTORS),
        "stretches": np.ones((STEPS, RECEPTORS, 3)),
    }


def test_what_is_saved_is_read_back(tmp_path):
    results = Results.create(tmp_path / "a" / "b")
    study = Study(protocol=Protocol(depth_mm=1.5))
    results.save_study(study)
    results.save_run({"ranks": np.int64(2), "folder": tmp_path, "forces": np.zeros(3)})
    results.save_trace(**trace())
    results.save_spikes([[0.1, 0.25], [], [-0.05]], SimpleNamespace(**results.trace))
    results.save_checkpoint(u=np.ones((4, 3)), reason="none")

    again = Results.open(tmp_path / "a" / "b")
    assert again.study == study
    assert again.run["ranks"] == 2 and again.run["forces"] == [0, 0, 0]
    for name, array in trace().items():
        assert np.array_equal(again.trace[name], array), name
    assert again.spikes.receptor.tolist() == [0, 0, 2]
    assert again.spikes.time_s.tolist() == [0.1, 0.25, -0.05]
    assert again.spikes.displacement_mm == pytest.approx([2.0, 5.0, 0.0], abs=1e-12)
    assert again.load_checkpoint()["u"].shape == (4, 3)
    lines = (results.folder / "spikes.csv").read_text().splitlines()
    assert lines[:2] == ["receptor,time_s,displacement_mm,population", "0,0.1,2,SA1"]


def test_saving_again_is_seen(tmp_path):
    results = Results.create(tmp_path / "r")
    results.save_run({"status": "running"})
    assert results.run["status"] == "running"
    results.save_run({"status": "complete"})
    assert results.run["status"] == "complete"


def test_without_spikes_and_run_there_are_none(tmp_path):
    results = Results.create(tmp_path / "r")
    assert len(results.spikes.time_s) == 0
    assert results.run == {}
    times, paths = read_series(results.fields)
    assert len(times) == 0 and paths == []
    results.save_trace(**trace())
    results.save_spikes([[], [], []], SimpleNamespace(**results.trace))
    assert len(results.spikes.time_s) == 0


def test_a_trace_of_unequal_lengths_is_refused(tmp_path):
    results = Results.create(tmp_path / "r")
    with pytest.raises(ValueError, match="force_N"):
        results.save_trace(**{**trace(), "force_N": np.ones((STEPS + 1, 3))})
    with pytest.raises(ValueError, match="sed_kPa"):
        results.save_trace(**{**trace(), "sed_kPa": np.ones((STEPS, RECEPTORS - 1))})


def test_nothing_that_needs_pickle_is_written_or_read(tmp_path):
    results = Results.create(tmp_path / "r")
    with pytest.raises(ValueError):
        results.save_checkpoint(u=np.array([object()]))
    np.savez(results.folder / "trace.npz", time_s=np.array([{}], dtype=object))
    with pytest.raises(StudyError, match="cannot be read"):
        _ = results.trace


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04broken", pickle.dumps([1])])
def test_a_broken_trace_is_a_study_error(tmp_path, content):
    results = Results.create(tmp_path / "r")
    (results.folder / "trace.npz").write_bytes(content)
    with pytest.raises(StudyError, match=r"trace\.npz cannot be read"):
        _ = results.trace


def test_a_damaged_trace_is_read_rightly_or_a_study_error(tmp_path):
    """Bytes of an archive are changed here and there."""
    results = Results.create(tmp_path / "r")
    results.save_trace(**trace())
    path = results.folder / "trace.npz"
    whole = path.read_bytes()
    random = np.random.default_rng(0)
    refused = 0
    for _ in range(200):
        damaged = bytearray(whole)
        for place in random.integers(0, len(whole), 3):
            damaged[place] = random.integers(0, 256)
        path.write_bytes(damaged)
        try:
            read = Results(results.folder).trace
        except StudyError:
            refused += 1
        else:
            for name, array in trace().items():
                np.testing.assert_array_equal(read[name], array)
    assert refused > 50


@pytest.mark.parametrize("name", ["run.json", "spikes.csv", "fields/deformation.pvd"])
@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"[1]", b"<a", b"x,y\n1,2\n"])
def test_other_broken_files_are_study_errors_or_empty(tmp_path, name, content):
    results = Results.create(tmp_path / "r")
    results.fields.mkdir()
    (results.folder / name).write_bytes(content)
    try:
        assert not results.run
        assert not results.spikes.time_s.size
        assert not read_series(results.fields)[1]
    except StudyError as error:
        assert name in str(error)
        assert "\n" not in str(error)
    else:
        assert name == "spikes.csv" and content in (b"", b"[1]", b"<a")


def test_no_module_of_the_package_unpickles():
    """Meshes and results of others are data: loading them runs no code."""
    for path in Path(tactile_fem.__file__).parent.rglob("*.py"):
        found = re.search(r"import (pickle|shelve|joblib)|allow_pickle=True", path.read_text())
        assert not found, path


def test_a_folder_with_something_in_it_needs_overwrite(tmp_path):
    (tmp_path / "notes.md").write_text("mine")
    with pytest.raises(StudyError, match=r"not empty: choose another one, or overwrite the scan"):
        Results.create(tmp_path)


def test_overwrite_removes_own_files_and_keeps_others(tmp_path):
    results = Results.create(tmp_path / "r")
    results.save_run({"status": "old"})
    results.save_trace(**trace())
    own = ["fields/deformation_0001.vtu", "figures/deformation_3.2.png", ".trace.npz.part"]
    foreign = ["notes.md", "figures/mine.png", "fields/mine.vtu"]
    for name in own + foreign:
        (results.folder / name).parent.mkdir(exist_ok=True)
        (results.folder / name).write_text("x")
    Results.create(tmp_path / "r", overwrite=True)
    left = {
        str(path.relative_to(results.folder))
        for path in results.folder.rglob("*")
        if path.is_file()
    }
    assert left == set(foreign)


def test_folders_are_made_with_what_is_in_them(tmp_path):
    def folders():
        return sorted(path.name for path in (tmp_path / "r").iterdir() if path.is_dir())

    results = make_results(tmp_path / "r", Study(stimulus=Plate()))  # which names no file
    assert folders() == []
    make_fields(results)
    assert folders() == ["fields"]
    draw_plots(results)
    assert folders() == ["fields", "figures"]
    Results.create(tmp_path / "r", overwrite=True)
    assert folders() == []


def test_a_file_in_the_way_is_no_folder(tmp_path):
    (tmp_path / "r").write_text("x")
    for folder in (tmp_path / "r", tmp_path / "r" / "below"):
        with pytest.raises(StudyError, match="is a file"):
            Results.create(folder, overwrite=True)


def test_an_unwritable_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda *args, **kwargs: False)
    with pytest.raises(StudyError, match="not writable"):
        Results.create(tmp_path / "r")
    monkeypatch.undo()

    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(StudyError, match="not writable: Permission denied"):
        Results.create(tmp_path / "r")


def test_open_wants_a_scan(tmp_path):
    with pytest.raises(StudyError, match="holds no results"):
        Results.open(tmp_path)


def test_a_write_that_fails_leaves_the_old_file(tmp_path):
    path = tmp_path / "run.json"
    path.write_text("old")
    with pytest.raises(RuntimeError), atomic_write(path) as part:
        part.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["run.json"]


def one_tet():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    edges = np.array([[0, 1], [1, 2], [2, 0], [3, 0], [2, 3], [1, 3]])  # gmsh's order
    nodes = np.vstack([corners, corners[edges].mean(axis=1)])
    return nodes, np.arange(10)[None, :]


def test_fields_have_vtk_node_order_and_the_series_lists_them(tmp_path):
    nodes, tets = one_tet()
    writer = FieldWriter(tmp_path, nodes, tets, [4])
    for k in range(3):
        moved = np.full((10, 3), float(k))
        writer.write(0.1 * k - 0.1, {"displacement_mm": moved}, {"sed_kPa": [10.0 + k]})
    times, paths = read_series(tmp_path)
    assert times == pytest.approx([-0.1, 0.0, 0.1])
    assert [path.name for path in paths] == [f"deformation_000{k}.vtu" for k in range(3)]

    mesh = meshio.read(paths[2])
    cell = mesh.cells_dict["tetra10"][0]
    vtk_edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    for node, (a, b) in zip(cell[4:], vtk_edges, strict=True):
        middle = (mesh.points[cell[a]] + mesh.points[cell[b]]) / 2
        assert np.allclose(mesh.points[node], middle)
    assert np.all(mesh.point_data["displacement_mm"] == 2)
    assert mesh.cell_data["sed_kPa"][0][0] == 12
    assert mesh.cell_data["tissue"][0][0] == 4

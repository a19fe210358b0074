import logging
import subprocess

import numpy as np
import pytest
import shapely
from needs import needs_graphics
from PIL import Image
from synthetic import make_fields, make_results, make_section, make_trace

from tactile_fem.finger import read_mesh
from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.output import figures, pictures
from tactile_fem.results.histories import central_receptor
from tactile_fem.runtime import doctor
from tactile_fem.study import Dots, Grating, Plate, Sphere, Study, Text


def test_states_are_those_next_to_the_extrema():
    times = np.arange(0, 10.1, 0.4) / 20
    chosen = pictures.choose_states(make_trace(), times)
    assert times[chosen] * 20 == pytest.approx([2.4, 5.2, 7.6], abs=0.41)


@pytest.mark.parametrize("row", [3, 7, 20])
def test_one_state_is_that_of_the_largest_sed_also_in_the_press(row):
    trace = {**make_trace(), "sed_kPa": np.ones((58, 21))}
    trace["sed_kPa"][row] = 2.0
    times = trace["time_s"][1::2]
    (chosen,) = pictures.choose_states(trace, times)
    assert abs(times[chosen] - trace["time_s"][row]) == np.abs(times - trace["time_s"][row]).min()


def test_the_largest_sed_is_not_left_out_where_there_are_many_extrema():
    wave = 1.0 + np.sin(np.arange(58) * np.pi / 2 + 0.1)
    wave[55] = 3.0
    trace = {**make_trace(), "sed_kPa": np.tile(wave[:, None], 21)}
    chosen = pictures.choose_states(trace, trace["time_s"])
    assert len(chosen) == 8 and 55 in chosen


def test_the_central_receptor_is_of_the_first_population():
    places = np.array([[0.2, 0.0, 1.0], [3.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
    assert central_receptor(places) == 2
    assert central_receptor(places, ["SA1", "SA1", "PC"]) == 0
    times = np.arange(0, 10.1, 0.4) / 20
    flat = np.ones((58, 1))
    both = {**make_trace(), "receptors_mm": np.vstack([make_trace()["receptors_mm"], [0, 0, 2]])}
    both["receptors_mm"][10, 0] = 0.1
    both["sed_kPa"] = np.hstack([make_trace()["sed_kPa"], flat])
    both["population"] = np.array(["SA1"] * 21 + ["PC"])
    assert pictures.choose_states(both, times) == pictures.choose_states(make_trace(), times)


def test_without_a_graphics_library_pictures_are_skipped_in_one_sentence(
    tmp_path, monkeypatch, caplog
):
    monkeypatch.setattr(doctor, "has_library", lambda name: False)
    reason = pictures.can_draw()
    assert reason is not None and "libegl1" in reason and reason.count("skipped") == 1
    results = make_results(tmp_path / "r")
    make_fields(results)
    with caplog.at_level(logging.WARNING, logger="tactile_fem"):
        paths = figures.draw(results)
    assert len(paths) == 4
    assert [r.getMessage() for r in caplog.records] == [reason]


def test_without_pyvista_pictures_are_skipped(monkeypatch):
    monkeypatch.setattr(pictures, "find_spec", lambda name: None)
    reason = pictures.can_draw()
    assert reason is not None and "tactile-fem[pictures]" in reason


def test_a_section_is_drawn_without_a_graphics_library_into_any_folder(tmp_path, monkeypatch):
    """Its process takes names that are not UTF-8."""
    monkeypatch.setattr(doctor, "has_library", lambda name: False)
    monkeypatch.setenv("PYTHONIOENCODING", "utf-8:strict")
    results = make_section(tmp_path / "f\udcfcr")
    results.figures.mkdir()
    (results.figures / "deformation_09.99.png").write_text("of an earlier scan")
    paths = pictures.draw_pictures(results)
    assert sorted(results.figures.glob("*.png")) == paths
    assert [path.name for path in paths] == ["deformation_02.50.png", "deformation_05.00.png"]
    for path in paths:
        with Image.open(path) as image:
            assert image.size == (1500, 955)
            assert len(image.getcolors(1 << 24)) > 100


def test_a_crash_while_drawing_does_not_end_the_scan(tmp_path, monkeypatch, caplog):
    results = make_results(tmp_path / "r")
    make_fields(results)
    monkeypatch.setattr(pictures, "can_draw", lambda plane: None)
    crashed = subprocess.CompletedProcess([], -11, stdout="", stderr="Segmentation fault\n")
    monkeypatch.setattr(pictures.subprocess, "run", lambda *args, **kwargs: crashed)
    with caplog.at_level(logging.WARNING, logger="tactile_fem"):
        assert pictures.draw_pictures(results) == []
    assert "ended with code -11 (Segmentation fault)" in caplog.text


def test_the_drawing_process_knows_nothing_of_mpi(monkeypatch):
    for name in ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "DISPLAY"):
        monkeypatch.setenv(name, "0")
    environment = pictures._environment()
    assert not {"PMI_RANK", "OMPI_COMM_WORLD_RANK", "DISPLAY"} & set(environment)
    assert "PATH" in environment


@pytest.mark.slow
@needs_graphics
@pytest.mark.parametrize("study", [Study(), Study(stimulus=Sphere())])
def test_pictures_are_drawn(tmp_path, study):
    results = make_results(tmp_path / "r", study)
    make_fields(results)
    paths = pictures.draw_pictures(results)
    names = [path.name for path in paths]
    assert names == ["finger.png", "deformation_02.50.png", "deformation_05.00.png"]
    for path in paths:
        with Image.open(path) as image:
            assert image.size == (1500, 600 if path.stem == "finger" else 955)
            assert len(image.getcolors(1 << 24)) > 100


@needs_graphics
def test_the_layers_of_the_finger_are_named_in_two_cuts(small_finger):
    from tactile_fem.output.anatomy import cut, finger_figure

    mesh = read_mesh(small_finger)
    parts = cut(mesh, 1)
    assert {*parts} == {*TISSUES}
    whole = shapely.union_all(list(parts.values()))
    assert whole.area == pytest.approx(sum(part.area for part in parts.values()), rel=1e-3)
    assert whole.bounds == pytest.approx((-8.0, 0.0, 8.0, 12.7), abs=0.2)
    assert parts["bone"].area == pytest.approx(np.pi * 4.0 * 2.3, rel=0.2)  # facets
    along, across = finger_figure(mesh).axes
    names = {name.replace("_", " ") for name in TISSUES}
    assert {text.get_text() for text in across.texts} == names | {"Across it, at Y = 0"}
    (bar,) = along.lines
    assert np.ptp(bar.get_xdata()) == 5.0 and along.texts[-1].get_text() == "5 mm"
    along.figure.draw_without_rendering()
    per_mm = [
        abs(np.diff(axes.transData.transform([[0, 0], [1, 1]]), axis=0)) for axes in (along, across)
    ]
    assert np.ptp(per_mm) < 1e-6


@needs_graphics
@pytest.mark.parametrize(
    "stimulus", [Text(), Plate(), Sphere(), Grating(), Dots()], ids=lambda s: s.kind
)
def test_the_drawn_surface_is_the_one_that_the_finger_feels(stimulus):
    from tactile_fem.output.scene import body_surface

    body = stimulus.body()
    surface = body_surface(body, np.array([[0.0, 0.0, 0.0], [0.0, -2.0, 1.97]]))
    points = surface.points.astype(float)
    felt = body.distance(points)
    # Edges of 0.3 mm radius between samples every 0.1 mm: a chord's height.
    assert np.abs(felt.gap).max() < 0.01
    assert points[:, 2].max() == pytest.approx(0, abs=0.01)
    assert points[:, 0].min() < -5 or isinstance(stimulus, Sphere)
    # Light falls on the outside.
    assert surface.point_data.active_normals == pytest.approx(felt.normal, abs=1e-6)
    corners = points[surface.regular_faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("ij,ij->i", across, felt.normal[surface.regular_faces[:, 0]]).min() > -1e-6

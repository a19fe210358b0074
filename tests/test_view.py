from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from matplotlib.colors import Normalize
from needs import needs_graphics
from PIL import Image
from synthetic import make_fields, make_results, make_trace

from tactile_fem.cli import app as cli
from tactile_fem.cli import view as cli_view
from tactile_fem.errors import StudyError
from tactile_fem.output import pictures
from tactile_fem.output.annotations import COLOURS
from tactile_fem.output.film import Film
from tactile_fem.results.fields import read_series
from tactile_fem.runtime import doctor
from tactile_fem.study import Study


def scan(folder, states=(0.0, 2.5, 5.0)):
    results = make_results(folder)
    make_fields(results, states)
    return results


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return scan(tmp_path_factory.mktemp("film") / "r")


@pytest.fixture(scope="module")
def film(results):
    return Film.of_scan(results)


def test_between_written_states_fields_are_linear_in_time(film):
    assert len(film) == 9
    assert film.along == pytest.approx(np.arange(9) * 0.03125)
    assert film.slid_mm == pytest.approx(np.arange(9) * 0.625)
    for k in (0, 1, 4, 7, 8):
        moved = np.tensordot(film.weights[k], film.moved_mm, 1)
        assert moved[:, 1] == pytest.approx(-0.0625 * k, abs=1e-6)
    assert film.nearest(0.15) == film.nearest_mm(3.0) == 5
    assert film.titles[4] == "Slide, 0.125 s: displacement 2.50 mm, depth 1.97 mm"


def test_at_displacement_0_is_the_end_of_the_press(film):
    times, slid = np.array([-0.2, -0.1, 0.0, 0.1]), np.array([0.0, 0.0, 0.0, 2.0])
    frames = replace(film, along=times, slid_mm=slid)
    assert [frames.nearest_mm(at_mm) for at_mm in (-1.0, 0.0, 0.9, 1.1)] == [2, 2, 2, 3]
    assert [frames.nearest(at_s) for at_s in (-1.0, -0.11, 0.09)] == [0, 1, 3]


def test_a_film_has_states_of_the_press(tmp_path):
    film = Film.of_scan(scan(tmp_path / "r", (-0.985, 0.0)))
    assert film.along[0] == pytest.approx(-0.04925)
    assert film.titles[0] == "Press, -0.049 s: displacement 0.00 mm, depth 0.98 mm"
    assert film.nearest_mm(0.0) == 4


def test_receptors_light_up_in_the_frame_after_their_spike(film):
    # They all fire at 1, 3 and 5 mm; frames are 0.625 mm apart.
    assert np.flatnonzero(film.fired.any(axis=1)).tolist() == [2, 5, 8]
    assert film.fired[2].all()


def test_a_film_of_one_state_shows_its_spikes(tmp_path):
    only = Film.of_scan(scan(tmp_path / "r", (5.0,)))
    assert len(only) == 1 and only.fired.all()


@needs_graphics
@pytest.mark.parametrize(
    ("look", "name"), [("deformation", "epidermis face"), ("receptors", "interface")]
)
def test_one_kept_state_is_drawn_as_the_first_of_several(tmp_path, look, name):
    drawn = []
    for states in ((0.0,), (0.0, 2.5)):
        results = scan(tmp_path / f"of_{len(states)}", states)
        scene = pictures.frames_of(results, Film.of_scan(results), look, off_screen=True)
        scene.bar = scene.bar._replace(scale=Normalize(0.0, 9.0))
        scene.show(0)
        mesh = scene.plotter.actors[name].mapper.dataset
        drawn.append((mesh["values"].copy(), mesh.points.copy()))
        scene.plotter.close()
    for one, first in zip(*drawn, strict=True):
        np.testing.assert_array_equal(one, first)
    assert drawn[0][0].min() > 0.3 and np.ptp(drawn[0][0]) > 0.1


def centres(scene):
    """Return the middles of the balls that show receptors, (r, 3)."""
    points = scene.plotter.actors["receptors"].mapper.dataset.points
    count = scene.film.fired.shape[1]
    balls = points.reshape(count, -1, 3)
    return (balls.min(axis=1) + balls.max(axis=1)) / 2


@needs_graphics
def test_receptors_go_along_with_the_interface(results, film):
    from tactile_fem.output.scene import receptor_scene

    scene = receptor_scene(results, film)
    scene.show(2)
    # The block at the receptors is lifted by 1.5 mm less half their height.
    places = results.trace["receptors_mm"]
    inside = np.abs(places[:, 0]) < 4
    lift = np.column_stack([0 * places[:, 2], 0 * places[:, 2] - 0.125, 1.5 - places[:, 2] / 2])
    assert (centres(scene) - places)[inside] == pytest.approx(lift[inside], abs=1e-3)
    scene.plotter.close()


@needs_graphics
def test_the_interface_has_the_energy_of_the_receptors_side(results, film):
    from tactile_fem.output.scene import interface

    surface = interface(film, "epidermis")
    assert surface.area == pytest.approx(64.0, rel=1e-6)
    assert np.ptp(surface.points[:, 2]) == 0
    # The epidermis has the first six of 18 tetrahedra; two of them have a facet on top.
    tets = np.linspace(0.01, 5, 18)
    first = surface["values"][:, 0]
    expected = [tets[3], tets[4], tets[[3, 4]].mean(), tets[[3, 4]].mean()]
    assert np.sort(first) == pytest.approx(np.sort(expected), rel=1e-5)
    # The dermis has the next six.
    other = interface(film, "dermis")["values"][:, 0]
    assert (other.min(), other.max()) == pytest.approx(tets[[6, 7]], rel=1e-5)


@needs_graphics
def test_a_picture_has_as_many_dots_as_are_wanted_and_a_scale_bar(results, film, monkeypatch):
    from tactile_fem.output.scene import deformation_scene

    scene = deformation_scene(results, film)
    figure = scene.figure(0, 100)
    assert figure.get_size_inches() * figure.dpi == pytest.approx((750, 477.5))
    (bar,) = [one for one in figure.artists if hasattr(one, "get_xdata")]
    places = np.array([[0.0, y, 2.0] for y in (-1.0, 1.0)])  # 2 mm on the cut
    camera = scene.plotter.camera
    towards = np.array(camera.position) - camera.focal_point
    side = np.cross(camera.up, towards)
    above = np.cross(towards, side)
    shown = np.diff(places, axis=0)[0]
    flat = [shown @ axis / np.linalg.norm(axis) for axis in (side, above)]
    height_mm = 2 * camera.parallel_scale
    in_inches = np.linalg.norm(flat) / height_mm * figure.get_figheight()
    assert np.ptp(bar.get_xdata()) * figure.get_figwidth() == pytest.approx(in_inches, rel=1e-6)
    scene.plotter.close()


@needs_graphics
@pytest.mark.parametrize("kinds", [("PC", "SA1"), ("PC", "RA"), ("PC",)])
def test_a_population_below_the_interface_leaves_the_interface_its_energy(tmp_path, kinds):
    """PC feel the subcutaneous tissue, which has no facet there."""
    from tactile_fem.output.scene import interface, receptor_scene

    names = np.array(kinds)[np.arange(21) % len(kinds)]
    trace = {**make_trace(), "population": names}
    trace["receptors_mm"] = np.tile([0.3, 0.2, 0.5], (21, 1))
    trace["receptors_mm"][names == "PC", 2] = 2.0
    study = Study.model_validate({"afferents": [{"name": kind, "kind": kind} for kind in kinds]})
    results = make_results(tmp_path / "r", study, trace)
    make_fields(results)
    film = Film.of_scan(results)
    scene = receptor_scene(results, film)
    side = "dermis" if "RA" in kinds else "epidermis"
    front = interface(film, side).clip("y", origin=(0.0, 0.05, 0.0), invert=False)
    shown = scene.plotter.actors["interface"].mapper.dataset["values"]
    assert shown == pytest.approx(front["values"][:, 0], rel=1e-6)
    colours = scene.plotter.actors["receptors"].mapper.dataset["colour"].reshape(21, -1)[:, 0]
    assert set(colours // 2) == set(range(len(kinds)))
    assert {*kinds} <= {*scene.legend} or len(kinds) == 1
    # What is 2 mm high is lifted by 0.5 mm, what is half a millimetre high by 1.25 mm.
    lifted = (centres(scene) - trace["receptors_mm"])[:, 2]
    assert lifted == pytest.approx(np.where(names == "PC", 0.5, 1.25), abs=1e-3)
    scene.plotter.close()


def test_what_cannot_be_shown_is_told(tmp_path):
    with pytest.raises(StudyError, match="no field files"):
        Film.of_scan(make_results(tmp_path / "none"))
    for damage in ("<VTKFile", '<?xml version="1.0"?><VTKFile/>', ""):
        results = scan(tmp_path / "broken" / str(len(damage)))
        (results.fields / "deformation_0001.vtu").write_text(damage)
        with pytest.raises(StudyError, match=r"deformation_0001.vtu cannot be read"):
            Film.of_scan(results)


@needs_graphics
def test_the_slider_moves_the_finger(results, film):
    from tactile_fem.output.scene import receptor_scene
    from tactile_fem.output.view import window

    plotter = window(receptor_scene(results, film))
    (slider,) = getattr(plotter, "widgets", plotter).slider_widgets
    at_first = slider.GetRepresentation().GetValue()
    assert at_first == pytest.approx(film.along[film.strongest])
    for value, moved in ((0.25, -0.5), (0.125, -0.25)):
        slider.GetRepresentation().SetValue(value)
        slider.InvokeEvent("EndInteractionEvent")
        far = plotter.actors["epidermis shell"].mapper.dataset.bounds.y_min
        assert far == pytest.approx(-4 + moved, abs=1e-5)
    plotter.close()


@needs_graphics
def test_an_animation_is_written_without_a_display(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    scan(tmp_path / "r", (0.0, 2.5))
    path = tmp_path / "scan.gif"
    assert cli.main(["view", str(tmp_path / "r"), "--save", str(path)]) == 0
    captured = capsys.readouterr()
    assert captured.out == f"Written to {path}\n"
    assert "2 saved states to read" in captured.err and "5 frames to draw" in captured.err
    with Image.open(path) as gif:
        assert (gif.n_frames, gif.size, gif.info["duration"]) == (5, (840, 534), 50)
        first = np.asarray(gif.convert("RGB"))
        gif.seek(4)
        last = np.asarray(gif.convert("RGB"))
    assert (first != last).any(axis=2).mean() > 0.01
    # Whatever else the palette must hold: white, the upper end of the colours and the legend's.
    assert tuple(first[0, -1]) == (255, 255, 255)
    for colour in ((253, 231, 37), *(tuple(bytes.fromhex(c[1:])) for c in COLOURS.values())):
        assert (first == colour).all(axis=2).any()


@needs_graphics
def test_a_frame_is_written_at_a_time_and_a_resolution(tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    scan(tmp_path / "r", (-0.985, 0.0))
    shown = []
    monkeypatch.setattr("tactile_fem.output.scene.Scene.show", lambda self, k: shown.append(k))
    path = tmp_path / "scan.png"
    command = ["view", str(tmp_path / "r"), "--save", str(path), "--dpi", "100"]
    for at in (["--at-s", "-0.049"], ["--at-mm", "0"]):
        assert cli.main([*command, *at]) == 0
    assert shown == [0, 4]
    with Image.open(path) as image:
        assert image.size == (750, 477)


@needs_graphics
@pytest.mark.skipif(find_spec("imageio_ffmpeg") is None, reason="imageio-ffmpeg is not installed")
def test_a_film_is_written(tmp_path, monkeypatch):
    import imageio_ffmpeg

    monkeypatch.delenv("DISPLAY", raising=False)
    scan(tmp_path / "r", (0.0, 2.5))
    path = tmp_path / "scan.mp4"
    assert cli.main(["view", str(tmp_path / "r"), "--save", str(path)]) == 0
    assert imageio_ffmpeg.count_frames_and_secs(str(path)) == (5, pytest.approx(0.25))


@needs_graphics
def test_all_states_are_written_as_one_film(tmp_path, monkeypatch, capsys):
    pv = pytest.importorskip("pyvista")
    results = scan(tmp_path / "r")
    monkeypatch.chdir(tmp_path)
    assert cli.main(["view", "r", "--save", "film.vtkhdf"]) == 0
    assert capsys.readouterr().out == "3 states written to film.vtkhdf\n"
    reader = pv.get_reader("film.vtkhdf")
    times_s, files = read_series(results.fields)
    steps = reader.reader
    steps.UpdateInformation()
    assert steps.GetNumberOfSteps() == 3
    for k, file in enumerate(files):
        steps.SetStep(k)
        found, kept = reader.read(), pv.read(file)
        assert steps.GetTimeValue() == times_s[k]
        assert (found.points == kept.points).all() and (found.celltypes == kept.celltypes).all()
        assert (found.cell_connectivity == kept.cell_connectivity).all()
        for arrays, own in ((found.point_data, kept.point_data), (found.cell_data, kept.cell_data)):
            assert set(own.keys()) == set(arrays.keys())
            assert all((arrays[name] == own[name]).all() for name in own.keys())


@needs_graphics
@pytest.mark.skipif(find_spec("trame_pyvista") is None, reason="trame-pyvista is not installed")
def test_a_page_is_written(tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    scan(tmp_path / "r")
    path = tmp_path / "scan.html"
    command = ["view", str(tmp_path / "r"), "--save", str(path), "--at-mm", "2.4"]
    assert cli.main(command) == 0
    text = path.read_text()
    assert "Slide, 0.125 s: displacement 2.50 mm" in text and "OfflineLocalView.load" in text


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (
            ["--save", "scan.avi"],
            2,
            '--save is "scan.avi" but must end in .gif, .mp4, .png, .vtkhdf, .html.',
        ),
        (["--save", "no/scan.gif"], 2, '--save is "no/scan.gif" but there is no folder no.'),
        (["--at-mm", "2"], 2, "--at-mm goes with --save to a .png or .html file."),
        (["--at-s", "0", "--save", "a.gif"], 2, "--at-s goes with --save to a .png or .html"),
        (["--at-s", "0", "--at-mm", "0", "--save", "a.png"], 2, "--at-mm and --at-s are both"),
        (["--show", "sed", "--save", "a.vtkhdf"], 2, "A .vtkhdf file contains all fields"),
        ([], 1, "There is no display for a window"),
        (["--save", "scan.html"], 1, 'pip install "tactile-fem[html]"'),
        (["--save", "scan.mp4"], 1, "pip install imageio-ffmpeg"),
    ],
)
def test_what_is_missing_or_wrong_is_told_in_one_line(
    tmp_path, monkeypatch, capsys, options, code, message
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pictures, "can_draw", lambda plane: None)
    monkeypatch.setattr(cli_view, "has_display", lambda: False)
    monkeypatch.setattr(cli_view, "find_spec", lambda name: None)
    make_results(tmp_path / "r")
    assert cli.main(["view", "r", *options]) == code
    stderr = capsys.readouterr().err
    assert message in stderr and stderr.count("\n") == 1


def test_without_a_graphics_library_there_is_one_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(doctor, "has_library", lambda name: False)
    make_results(tmp_path / "r")
    assert cli.main(["view", str(tmp_path / "r")]) == 1
    stderr = capsys.readouterr().err
    assert "libegl1" in stderr and stderr.count("\n") == 1

"""The picture of finger and stimulator before a scan."""

import numpy as np
import pytest
import trimesh
from needs import needs_gmsh, needs_graphics
from PIL import Image

from tactile_fem.cli import app as cli
from tactile_fem.finger import read_mesh
from tactile_fem.study import Protocol, Stimulus, Text

SMALL = ["--set", "finger.pad_size_mm=3", "--set", "finger.far_size_mm=6"]


@pytest.mark.slow
@needs_graphics
@pytest.mark.parametrize("kind", Stimulus.kinds)
def test_every_kind_of_stimulus_is_drawn(kind, tmp_path, capsys):
    settings = [*SMALL, "--set", f"stimulus.kind={kind}"]
    if kind == "mesh":
        pytest.importorskip("igl")
        trimesh.creation.box([6, 6, 3]).export(tmp_path / "box.ply")
        settings += ["--set", f"stimulus.file={tmp_path / 'box.ply'}"]
    if kind == "surface":
        np.save(tmp_path / "heights.npy", np.random.default_rng(0).normal(size=(50, 50)))
        keys = {"file": tmp_path / "heights.npy", "spacing_mm": 0.1, "unit_mm": 0.1}
        settings += [w for key, value in keys.items() for w in ("--set", f"stimulus.{key}={value}")]
    if kind == "drawing":
        settings += ["--set", "stimulus.polygons=[[[-2, -1], [2, -1], [0, 2]]]"]
    if kind == "heights":
        (tmp_path / "own.py").write_text("def bowl(x, y):\n    return 0.002 * (x**2 + y**2)\n")
        settings += ["--set", f"stimulus.z={tmp_path / 'own.py'}:bowl"]
    file = tmp_path / "preview.png"
    assert cli.main(["preview", *settings, "--output", str(file)]) == 0
    assert capsys.readouterr().out == f"Written to {file}\n"
    with Image.open(file) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    # The finger's fat and the way of the contact point are there, and the stimulator's top.
    for colour in ((242, 223, 167), (200, 85, 61)):
        assert np.any(np.all(pixels == colour, axis=1))
    assert len(np.unique(pixels, axis=0)) > 1000


@needs_graphics
def test_the_way_of_the_contact_point_leads_over_the_letters(small_finger):
    from tactile_fem.output.preview import preview_figure

    path = Protocol(distance_mm=4.0).route(3.0)
    figure = preview_figure(read_mesh(small_finger), Text().body(), path)
    finger, way, start = figure.axes[1].lines
    np.testing.assert_allclose(way.get_xydata()[[0, -1]], [[0, 0], [0, 4.0]], atol=1e-12)
    np.testing.assert_allclose(start.get_xydata(), [[0, 0]])
    assert np.ptp(finger.get_xydata()[:, 0]) == pytest.approx(16.0, abs=0.5)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--output", "a.gif"], '--output is "a.gif" but must end in .png.'),
        (["-o", "none/a.png"], '--output is "none/a.png" but there is no folder none.'),
        (["-o", "a.png", "--set", "stimulus.kind=mesh"], "stimulus.file is missing"),
    ],
)
def test_what_cannot_be_drawn_is_told(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["preview", *options]) == 2
    message = capsys.readouterr().err
    assert sentence in message and message.count("\n") == 1


@needs_graphics
@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("protocol.depth_mm=1970", "protocol.depth_mm is 1970 but must be less than 5.3"),
        ("receptors.half_width_mm=30", "receptors: the receptor at X -30, Y 0 mm lies outside"),
    ],
)
def test_what_a_scan_would_refuse_is_not_drawn(setting, sentence, tmp_path, capsys):
    assert cli.main(["preview", "-o", str(tmp_path / "a.png"), "--set", setting]) == 2
    message = capsys.readouterr().err
    assert sentence in message and message.count("tactile-fem: ") == 1
    assert not list(tmp_path.iterdir())


@needs_gmsh
def test_a_path_that_leaves_the_section_is_not_drawn(tmp_path, capsys):
    command = ["preview", "-o", str(tmp_path / "a.png"), "--set", "finger.kind=section"]
    assert cli.main([*command, "--set", "finger.plane=transverse"]) == 2
    assert "its path leaves the section's plane, Y = 0, by 10 mm" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())

"""Fingers from scans: the analytic finger's own surfaces, and an anatomical bone."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from needs import needs_gmsh, needs_graphics
from PIL import Image
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from tactile_fem.cli import app as cli
from tactile_fem.errors import MeshError, PlaceError, StudyError
from tactile_fem.finger import SURFACES, TISSUES, build_finger
from tactile_fem.finger.anatomy import Anatomy, SurfaceFiles
from tactile_fem.finger.build import triangulate
from tactile_fem.finger.shape import bone_shape, skin_shape
from tactile_fem.finger.simplex import facets_of, volumes
from tactile_fem.shapes.scans import Scans
from tactile_fem.study import Finger
from tactile_fem.study.file import load_study

pytest.importorskip("igl")
pytestmark = [needs_gmsh]

PHALANX = Path(__file__).parents[1] / "meshes" / "distal_phalanx.stl"
NOISE_MM = 0.01
SHIFT_MM = np.array([40.0, -25.0, 80.0])
TURN = Rotation.from_euler("xyz", [0.5, 1.1, 2.0])
UP, TIP = (tuple(TURN.apply(axis).tolist()) for axis in ([0, 0, 1], [0, 1, 0]))
ANALYTIC = Finger()
COARSE = {"pad_size_mm": 3.0, "far_size_mm": 6.0}


def surface(name: str, finger: Finger) -> tuple[np.ndarray, np.ndarray]:
    """Return points and triangles of the analytic skin or bone, with noise, in its own axes."""
    skin = skin_shape(finger)
    shape = skin if name == "skin" else bone_shape(finger, skin)
    found, normals, _ = triangulate(shape, lambda x, y, z: 0.8)
    noise = np.random.default_rng(0).normal(size=(len(found.points), 1))
    return found.points + NOISE_MM * noise * normals, found.triangles


def write(file: Path, points: np.ndarray, triangles: np.ndarray) -> Path:
    placed = TURN.apply(points) + SHIFT_MM
    trimesh.Trimesh(placed, triangles, process=False).export(file)
    return file


@pytest.fixture(scope="module")
def scans(tmp_path_factory) -> dict[str, Path]:
    """Skin and bone of the analytic finger, scanned to 2 mm beyond its cut."""
    folder = tmp_path_factory.mktemp("scans")
    longer = Finger(straight_length_mm=ANALYTIC.straight_length_mm + 2)
    return {
        f"{name}_file": write(folder / f"{name}.stl", *surface(name, longer))
        for name in ("skin", "bone")
    }


@pytest.fixture(scope="module")
def skin_only(scans) -> dict[str, Path]:
    return {"skin_file": scans["skin_file"]}


@pytest.fixture(scope="module")
def nail_file(tmp_path_factory) -> Path:
    """A plate of 9 by 9 mm above the bone."""
    nail = trimesh.creation.box([9.0, 9.0, 2.0])
    file = tmp_path_factory.mktemp("nail") / "nail.stl"
    return write(file, nail.vertices + np.array([0, 4.0, 12.0]), nail.faces)


@pytest.fixture(scope="module")
def skin_with_hole(tmp_path_factory) -> dict[str, object]:
    """The keys of a skin that lacks what lies within 2 mm of X 8, Y 0, Z 7.2 mm."""
    points, triangles = surface("skin", Finger(straight_length_mm=18.0))
    aside = np.linalg.norm(points[triangles].mean(axis=1) - [8.0, 0.0, 7.2], axis=1)
    file = write(tmp_path_factory.mktemp("hole") / "skin.ply", points, triangles[aside > 2.0])
    return {"skin_file": file, "nail_direction": UP, "tip_direction": TIP}


def test_axes_and_contact_point_are_found(scans):
    frame = Scans.of(Finger(**scans)).frame
    turned = Rotation.from_matrix(frame.axes @ TURN.as_matrix()).magnitude()
    assert np.degrees(turned) < 0.3
    origin = TURN.inv().apply(frame.origin - SHIFT_MM)
    np.testing.assert_allclose(origin, 0.0, atol=0.05)


def test_given_directions_are_kept_and_the_apex_is_the_contact_point(skin_only):
    tilt = Rotation.from_rotvec([0.1, 0, 0])
    up = tuple(TURN.apply(tilt.apply([0, 0, 1])).tolist())
    frame = Scans.of(Finger(**skin_only, tip_direction=TIP, nail_direction=up)).frame
    np.testing.assert_allclose(frame.axes[2], up, atol=0.1)
    np.testing.assert_allclose(frame.axes[1], TIP, atol=1e-12)
    given = Scans.of(
        Finger(
            **skin_only,
            tip_direction=TIP,
            nail_direction=UP,
            contact_mm=tuple((TURN.apply([0, 3, 1]) + SHIFT_MM).tolist()),
        )
    ).frame
    np.testing.assert_allclose(TURN.inv().apply(given.origin - SHIFT_MM), [0, 3, 1], atol=1e-6)


def test_the_scanned_finger_is_the_analytic_one(scans):
    skin = Anatomy.of(Finger(**scans)).skin
    for name in ("half_width", "below", "above", "tip_length"):
        found, true = getattr(skin.capsule, name), getattr(skin_shape(ANALYTIC), name)
        assert found == pytest.approx(true, abs=0.1), name
    assert skin.capsule.pad_radius == pytest.approx(ANALYTIC.pad_radius_mm, rel=0.05)
    points, normals = skin.sample(0.7)
    true = skin_shape(ANALYTIC)
    clear = points[:, 1] > -14
    inside = true.level(points - 0.08 * normals)[clear]
    outside = true.level(points + 0.08 * normals)[clear]
    assert inside.max() < 0 < outside.min()  # within 0.08 mm of the true skin
    assert points[:, 2].min() == pytest.approx(0.0, abs=0.01)


def test_layers_grow_inwards_and_all_parts_are_there(scans):
    finger = Finger(**scans, **COARSE)
    mesh, analytic = build_finger(finger), build_finger(Finger(**COARSE))
    assert not mesh.missing and np.any(mesh.tissue == TISSUES["nail"])
    for name, found in mesh.layer_thickness_mm.items():
        assert found.mean() == pytest.approx(getattr(finger, f"{name}_mm"), rel=0.05), name
    for tissue in ("stratum_corneum", "epidermis", "dermis"):
        whole, true = (
            volumes(m.nodes, m.cells)[m.tissue == TISSUES[tissue]].sum() for m in (mesh, analytic)
        )
        assert whole == pytest.approx(true, rel=0.02), tissue
    cut = mesh.nodes[mesh.facets[mesh.surface == SURFACES["cut"]]]
    assert np.ptp(cut[..., 1]) == 0.0


def test_a_bone_inside_an_analytic_skin_is_closed():
    finger = Finger(
        bone_file=PHALANX, file_unit_mm=1100.0, nail_direction=(0.0, 0.0, 1.0), **COARSE
    )
    mesh = build_finger(finger)
    bone = mesh.cells[mesh.tissue == TISSUES["bone"]]
    true = trimesh.load_mesh(PHALANX).volume * 1100**3
    assert 0.85 * true < volumes(mesh.nodes, bone).sum() < true
    facets, _, second = facets_of(bone)
    assert np.all(np.isin(np.sort(facets[second < 0], axis=1).ravel(), np.unique(bone)))
    surface = mesh.facets[mesh.surface == SURFACES["bone_surface"]]
    assert len(surface) == np.sum(second < 0)  # nothing of it lies in the cut
    tip = mesh.nodes[np.unique(bone)][:, 1].max()
    assert tip == pytest.approx(12.0 - finger.bone_tip_gap_mm, abs=0.3)


def test_a_nail_file_tells_where_the_nail_lies(skin_only, nail_file):
    finger = Finger(**skin_only, nail_file=nail_file, **COARSE)  # the nail is above
    anatomy = Anatomy.of(finger)
    assert anatomy.nail.half_width == pytest.approx(4.5, abs=0.15)
    assert (anatomy.nail.start_y, anatomy.nail.end_y) == pytest.approx((-0.5, 8.5), abs=0.2)
    mesh = build_finger(finger)
    tets = mesh.cells[mesh.tissue == TISSUES["nail"], :4]
    across, along = (np.ptp(mesh.nodes[tets][..., axis]) for axis in (0, 1))
    assert (across, along) == pytest.approx((9.0, 9.0), abs=0.6)


def test_a_direction_away_from_the_nail_is_refused_and_from_the_bone_doubted(
    scans, nail_file, caplog
):
    down = tuple(-np.array(UP))
    with pytest.raises(MeshError, match="nail_direction points away from the nail in"):
        Scans.of(Finger(**scans, nail_file=nail_file, nail_direction=down))
    Scans.of(Finger(**scans, nail_file=nail_file, nail_direction=UP))
    assert not caplog.records
    Scans.of(Finger(**scans, nail_direction=down))
    assert "nail_direction points away from the bone in finger.bone_file" in caplog.text


def test_the_unit_makes_the_finger_of_a_child(scans):
    scale = 0.75
    lengths = ("tip_length_mm", "contact_from_tip_mm", "nail_width_mm", "nail_length_mm")
    finger = Finger(
        **scans,
        **{name: scale * getattr(ANALYTIC, name) for name in lengths},
        straight_length_mm=scale * ANALYTIC.straight_length_mm,
        file_unit_mm=scale,
        **COARSE,
    )
    mesh = build_finger(finger)
    width = np.ptp(mesh.nodes[:, 0])
    assert width == pytest.approx(2 * scale * ANALYTIC.half_width_mm, rel=0.03)
    assert mesh.layer_thickness_mm["dermis"].mean() == pytest.approx(ANALYTIC.dermis_mm, rel=0.08)


def test_a_hole_is_told_with_its_place(skin_with_hole):
    with pytest.raises(PlaceError, match="skin_file has a hole at X ") as error:
        Anatomy.of(Finger(**skin_with_hole))
    np.testing.assert_allclose(error.value.place_mm, [8, 0, 7.2], atol=3.0)


def test_a_scan_that_overlaps_itself_is_told(tmp_path):
    points, triangles = surface("skin", Finger(straight_length_mm=18.0))
    doubled = np.vstack([points, points * [0.9, 1, 0.9] + [0, 0, 0.6]])
    file = write(tmp_path / "skin.ply", doubled, np.vstack([triangles, triangles + len(points)]))
    finger = Finger(skin_file=file, nail_direction=UP, tip_direction=TIP)
    with pytest.raises(MeshError, match=r"finger.skin_file: the surface overlaps itself at X "):
        Anatomy.of(finger)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "nail_direction must be given"),
        ({"nail_direction": TIP, "tip_direction": TIP}, "must not be parallel"),
        ({"nail_direction": UP, "straight_length_mm": 30.0}, "is 30.8 mm long, but .* ask for"),
        ({"nail_direction": UP, "file_unit_mm": 0.01}, "makes the surface in .* 0.306 mm long"),
        ({"nail_direction": UP, "file_unit_mm": 1000.0}, "3.06e.04 mm long, but it must"),
        (
            {"nail_direction": UP, "dermis_mm": 3.0, **COARSE},
            "bone comes to lie|too thick|too thin",
        ),
    ],
)
def test_what_does_not_make_a_finger_is_told(changes, message, skin_only):
    with pytest.raises(MeshError, match=message):
        build_finger(Finger(**skin_only, **changes))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"skin_file": "a.stl", "half_width_mm": 9.0}, "half_width_mm = 9.0 would have no effect"),
        ({"skin_file": "a.stl", "bone_file": "b.stl", "subcutaneous_mm": 4.0}, "no effect beside"),
        ({"nail_file": "a.stl"}, "nail_file needs a skin_file"),
        ({"bone_file": "a.stl"}, "needs nail_direction"),
        ({"nail_direction": (0, 0, 1)}, "need a skin_file or a bone_file"),
        ({"skin_file": "a.stl", "nail_direction": (0, 0, 0)}, "must not be the zero vector"),
    ],
)
def test_keys_that_do_not_go_together_are_refused(keys, message):
    with pytest.raises(ValidationError, match=message):
        Finger(**keys)


def test_without_what_reads_them_scans_are_refused(scans, monkeypatch):
    monkeypatch.setattr(SurfaceFiles, "reader", SurfaceFiles)
    Anatomy.of(Finger(half_width_mm=8.1))
    with pytest.raises(StudyError, match="cannot be read: nothing reads them"):
        Anatomy.of(Finger(**scans, pad_size_mm=2.9))


def test_a_scanned_finger_survives_its_study_file(scans, tmp_path):
    finger = Finger(**scans)
    assert Finger.model_validate(finger.model_dump(exclude_none=True)) == finger


def test_paths_in_a_study_file_start_from_its_folder(scans, tmp_path):
    study = scans["skin_file"].parent / "study.toml"
    study.write_text('[finger]\nskin_file = "skin.stl"\nbone_file = "bone.stl"\n')
    finger = load_study(study).finger
    assert {"skin_file": finger.skin_file, "bone_file": finger.bone_file} == scans


def test_a_damaged_file_is_one_sentence(tmp_path, capsys):
    (tmp_path / "skin.stl").write_bytes(b"solid nothing")
    settings = ["--set", f"finger.skin_file={tmp_path / 'skin.stl'}"]
    assert cli.main(["mesh", *settings]) == 2
    assert capsys.readouterr().err.startswith(f"tactile-fem: finger.skin_file = {tmp_path}")


@needs_graphics
def test_preview_draws_where_a_scan_does_not_fit(skin_with_hole, tmp_path, capsys):
    picture = tmp_path / "preview.png"
    settings = []
    for key, value in skin_with_hole.items():
        text = list(value) if isinstance(value, tuple) else value
        settings += ["--set", f"finger.{key}={text}"]
    assert cli.main(["preview", *settings, "-o", str(picture)]) == 2
    told = capsys.readouterr()
    assert told.out == f"The scans and the place are drawn in {picture}\n"
    assert "has a hole at X " in told.err
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    assert np.sum(np.all(pixels == (255, 0, 0), axis=1)) > 100

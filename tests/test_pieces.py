"""Which part of a scan is the finger: bent fingers, whole hands, dirt, tables, coarse triangles."""

import logging
import time

import numpy as np
import pytest
import trimesh

from tactile_fem.errors import MeshError, PlaceError
from tactile_fem.shapes.scanned import ScannedSkin
from tactile_fem.shapes.scans import Scans
from tactile_fem.shapes.surface_files import in_chunks
from tactile_fem.study import Finger

pytest.importorskip("igl")

UP, TIP = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
RADIUS, TIP_Y = 7.0, 12.0


def capsule(length, rings=1):
    """Return a finger along Y: its tip at Y 12, its lowest line at z = 0."""
    angle = np.linspace(0, np.pi / 2, 13)
    line = np.column_stack([RADIUS * np.cos(angle), length + RADIUS * np.sin(angle)])
    start = np.column_stack([np.full(rings, RADIUS), np.linspace(0, length, rings + 1)[:-1]])
    outline = np.vstack([[0, 0], start, line])
    outline[-1, 0] = 0
    mesh = trimesh.creation.revolve(outline, sections=48)
    turned = mesh.vertices[:, [0, 2, 1]] * [1, 1, -1]
    turned += [0, TIP_Y - turned[:, 1].max(), RADIUS]
    mesh = trimesh.Trimesh(turned, mesh.faces)
    mesh.fix_normals()
    return mesh


def hand():
    """Return three fingers that are joined behind; 190 x 90 x 30 mm with the hand's back."""
    fingers = [capsule(70, rings=60) for _ in range(3)]
    for finger, x in zip(fingers, (-20, 0, 20), strict=True):
        finger.apply_translation([x, 0, 0])
    # One finger goes on as a wide palm, to which the others do not need to be sewn.
    points = fingers[1].vertices.copy()
    behind = np.clip((-30 - points[:, 1]) / 10, 0, 1)
    points[:, 0] *= 1 + 5 * behind
    points[:, 1] -= 80 * np.clip((-40 - points[:, 1]) / 25, 0, 1)
    points[:, 2] -= 12 * behind  # the palm is lower than the fingers
    fingers[1] = trimesh.Trimesh(points, fingers[1].faces, process=False)
    return trimesh.util.concatenate(fingers)


def study(mesh, folder, **keys):
    file = folder / "skin.ply"
    mesh.export(file)
    keys = {"nail_direction": UP, "tip_direction": TIP, "smooth_mm": 0.0} | keys
    return Finger(skin_file=file, **{key: value for key, value in keys.items() if value})


def skin_of(finger):
    scans = Scans.of(finger)
    return ScannedSkin.of(scans.skin, finger, scans.frame)


def bent():
    mesh = capsule(40, rings=40)
    points = mesh.vertices.copy()
    points[:, 2] += 0.003 * np.clip(points[:, 1] + 35, 0, None) ** 2
    return trimesh.Trimesh(points, mesh.faces, process=False)


@pytest.mark.parametrize(
    ("mesh", "keys", "words"),
    [
        (
            bent(),
            {},
            r"the lowest point of finger.skin_file along nail_direction, at .* mm in the "
            r"file, lies 4\d.\d mm behind the tip, but it must lie 1 to 24 mm behind it, .*: give ",
        ),
        (hand(), {}, "the lowest point .* behind the tip, but it must lie 1 to 24"),
        (capsule(40), {"contact_mm": (0, -13.5, 0)}, "lies 25.5 mm behind the tip, but it must"),
        (
            capsule(40),
            {"contact_mm": (0, 11.5, 2)},
            "lies 0.5 mm behind the tip, but it must lie 1",
        ),
        (capsule(40), {"contact_mm": (0, 0, 14)}, "14.0 mm above the pad, on the side of"),
        (capsule(40), {"contact_mm": (30, 0, 0)}, "from the scanned skin: correct it"),
        (capsule(40), {"tip_direction": (1, 0, 0)}, "is 14.0 mm long, .* or correct tip_direction"),
        (capsule(40), {"nail_direction": (0, 1, 0.1)}, r"parallel to .* \[0.0, 1.0, 0.0\] \(given"),
        (
            capsule(40).apply_scale([5, 1, 1]),
            {"contact_mm": (0, 0, 0)},
            "finger.skin_file is 70 mm wide and 14 mm high within the finger's length of 27 mm",
        ),
    ],
)
def test_what_is_no_fingertip_is_told_at_once(mesh, keys, words, tmp_path):
    start = time.monotonic()
    with pytest.raises(MeshError, match=words):
        skin_of(study(mesh, tmp_path, **keys))
    assert time.monotonic() - start < 5


def test_the_finger_at_the_contact_point_is_taken_from_a_hand(tmp_path):
    alone = skin_of(study(capsule(40, rings=40), tmp_path, contact_mm=(0, 0, 0)))
    found = skin_of(study(hand(), tmp_path, contact_mm=(0, 0, 0)))
    for name in ("half_width", "below", "above", "tip_y", "cut_y", "tip_length"):
        assert getattr(found.capsule, name) == pytest.approx(getattr(alone.capsule, name), abs=0.02)
    assert found.capsule.half_width == pytest.approx(RADIUS, abs=0.1)
    # Nothing of the rest is sampled: 20 x 34 x 20 mm in steps of 0.3 mm.
    assert found.surface.spline.coefficients.size < 600_000
    points = np.array([[RADIUS, -5.0, RADIUS], [13.0, -5.0, RADIUS]])  # the next finger: X 13
    assert found.level(points) == pytest.approx([0.0, 3.0], abs=0.1)


def test_islands_and_a_table_are_left_out_with_a_warning(tmp_path, caplog):
    dirt, table = trimesh.creation.icosphere(1, 1.0), trimesh.creation.box([100, 100, 1])
    dirt.apply_translation([20, 30, -15])
    table.apply_translation([0, 0, -20])
    for more, keys in ((dirt, {}), (table, {"contact_mm": (0, 0, 0)})):
        finger = study(trimesh.util.concatenate([capsule(40), more]), tmp_path, **keys)
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            skin = Scans.of(finger).skin
        assert np.ptp(skin.points[:, 1]) == pytest.approx(47.0)
        assert "has 2 separate pieces: 1 of them" in caplog.text


def test_triangles_longer_than_the_finger_will_do(tmp_path):
    """The shaft has vertices at its ends only, 40 mm apart."""
    skin = skin_of(study(capsule(40), tmp_path, contact_mm=(0, 0, 0)))
    assert skin.capsule.half_width == pytest.approx(RADIUS, abs=0.1)
    frame = Scans.of(study(capsule(4), tmp_path)).frame  # the lowest point lies on long triangles
    assert frame.origin[2] == pytest.approx(0.0, abs=0.05)


def test_long_evaluations_are_divided_so_that_signals_are_answered():
    points, sizes = np.arange(240_000.0).reshape(-1, 2), []

    def evaluate(part):
        sizes.append(len(part))
        return part[:, 0], 2 * part

    first, second = in_chunks(evaluate, points)
    np.testing.assert_array_equal(first, points[:, 0])
    np.testing.assert_array_equal(second, 2 * points)
    assert max(sizes) <= 50_000 and sum(sizes) == len(points)
    nothing, _ = in_chunks(evaluate, points[:0])
    assert len(nothing) == 0


def test_a_contact_point_that_is_none_has_a_place(tmp_path):
    with pytest.raises(PlaceError) as error:
        skin_of(study(capsule(40), tmp_path, contact_mm=(30, 0, 0)))
    assert error.value.place_mm == (0, 0, 0)

"""Parts from files of triangles beside bodies whose distance is known."""

import logging
from itertools import product

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial.transform import Rotation

from tactile_fem.cli import app as cli
from tactile_fem.errors import StudyError
from tactile_fem.finger import read_mesh
from tactile_fem.shapes import Mesh
from tactile_fem.stimulus.body import Ball
from tactile_fem.study import Sphere, Study
from tactile_fem.study.file import load_study

pytest.importorskip("igl", reason='pip install "tactile-fem[cad]"')

HALF = np.array([2.0, 1.5, 1.0])
# A step down in the direction of Y, 3 mm below its top.
STEP = shapely.Polygon([(-2, -3), (2, -3), (2, -1), (0, -1), (0, 0), (-2, 0)])


def body_of(mesh, folder, **keys):
    file = folder / "part.stl"
    mesh.export(file)
    return Mesh(file=file, **keys).body()


def prism(polygon, half):
    """Return a prism along X of a polygon in Y and Z that is cut along Y = 0 into rectangles."""
    boxes = [(-2, 0, -3, -1), (-2, 0, -1, 0), (0, 2, -3, -1)]
    outline = shapely.get_coordinates(polygon.exterior)[:-1]
    outline = np.insert(outline, 1, [0, -3], axis=0)
    outline = np.append(outline, [[-2, -1]], axis=0)
    n = len(outline)
    ends = [np.column_stack([np.full(n, x), outline]) for x in (-half, half)]
    faces = []
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, n + j), (i, n + j, n + i)]
    index = {tuple(p): i for i, p in enumerate(outline.tolist())}
    for a, b, c, d in boxes:
        p, q, r, s = (index[key] for key in ((a, c), (b, c), (b, d), (a, d)))
        faces += [(p, r, q), (p, s, r), (n + p, n + q, n + r), (n + p, n + r, n + s)]
    mesh = trimesh.Trimesh(np.vstack(ends), faces, process=False)
    assert mesh.is_watertight and mesh.volume == pytest.approx(polygon.area * 2 * half)
    return mesh


def rounded_box(points, radius):
    """Return the distance to a box whose top is z = 0 and whose edges are rounded."""
    q = np.abs(points + np.array([0, 0, HALF[2]])) - HALF + radius
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - radius


def around(exact, box, low=-0.03, high=0.3, count=4000):
    """Return points (n, 3) whose exact distance is small."""
    points = np.random.default_rng(3).uniform(*box, (200_000, 3))
    gap = exact(points)
    return points[(gap > low) & (gap < high)][:count]


BOX = ([-2.4, -1.9, -2.0], [2.4, 1.9, 0.4])


@pytest.mark.parametrize(("grid", "bound"), [(0.1, 0.004), (0.05, 0.002)])
def test_edges_and_corners_of_a_box_have_the_radius(grid, bound, tmp_path):
    box = trimesh.creation.box(2 * HALF)
    body = body_of(box, tmp_path, edge_radius_mm=0.3, grid_mm=grid)
    points = around(lambda p: rounded_box(p, 0.3), BOX)
    at = body.distance(points)
    assert np.abs(at.gap - rounded_box(points, 0.3)).max() < bound
    assert np.abs(np.linalg.norm(at.normal, axis=1) - 1).max() < 0.03
    # Off the edges it is the box itself.
    off = np.all(np.abs(points[:, :2]) < HALF[:2] - 0.6, axis=1) & (points[:, 2] > -1)
    at = body.distance(points[off])
    assert np.abs(at.gap - points[off, 2]).max() < 1e-4
    assert np.abs(at.hessian).max() < 0.05


def test_a_step_is_rounded_inside_and_outside(tmp_path):
    body = body_of(prism(STEP, 2.0), tmp_path, edge_radius_mm=0.4, grid_mm=0.1)
    rounded = STEP.buffer(-0.4, quad_segs=64).buffer(0.8, quad_segs=64).buffer(-0.4, quad_segs=64)
    yz = np.random.default_rng(3).uniform([-1.5, -1.7], [1.5, 0.3], (40_000, 2))
    points = shapely.points(yz)
    exact = shapely.distance(rounded.exterior, points)
    exact[shapely.contains(rounded, points)] *= -1
    close = (exact > -0.03) & (exact < 0.3)
    at = body.distance(np.column_stack([np.zeros(close.sum()), yz[close]]))
    assert np.abs(at.gap - exact[close]).max() < 0.008
    # The fillet's middle: 0.4 mm around the axis at Y 0.4, Z -0.6.
    middle = np.array([0.4, -0.6]) - 0.4 * np.sqrt(0.5)
    at = body.distance(np.array([[0.0, *middle]]))
    assert at.gap == pytest.approx(0, abs=0.008)
    assert at.normal[0] == pytest.approx([0, np.sqrt(0.5), np.sqrt(0.5)], abs=0.03)
    assert np.trace(at.hessian[0]) == pytest.approx(-1 / 0.4, rel=0.25)


def test_a_large_radius_on_a_coarse_grid(tmp_path):
    keys = {"edge_radius_mm": 2.0, "reach_mm": 6.0}  # a grid of 0.67 mm
    body = body_of(trimesh.creation.box([16, 16, 8]), tmp_path, **keys)
    lean = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5)])
    for gap in (0.0, 0.2, 0.45):
        at = body.distance(np.array([[0.0, 6.0, -2.0] + (2 + gap) * lean]))
        assert at.gap == pytest.approx(gap, abs=0.03)
        assert at.normal[0] == pytest.approx(lean, abs=0.03)


def test_a_ball_converges_to_the_ball(tmp_path):
    ball = Ball(2.0)
    box = ([-1.6, -1.6, -1.5], [1.6, 1.6, 0.3])
    points = around(lambda p: ball.distance(p).gap, box, low=-0.05)
    exact = ball.distance(points)
    errors = []
    for fineness in (4, 6):
        sphere = trimesh.creation.icosphere(fineness, 2.0)
        at = body_of(sphere, tmp_path, grid_mm=0.1, reach_mm=1.5).distance(points)
        errors.append(
            [np.abs(a - b).max() for a, b in ((at.gap, exact.gap), (at.normal, exact.normal))]
            + [np.sqrt(np.mean((at.hessian - exact.hessian) ** 2))]
        )
    coarse, fine = np.array(errors)
    assert np.all(fine < coarse / 4), (coarse, fine)
    assert np.all(fine < [3e-4, 5e-3, 0.02]), fine


def test_a_bar_that_lies_along_the_files_z_axis(tmp_path):
    bar = trimesh.creation.cylinder(radius=1.5, height=5.0, sections=360)
    body = body_of(bar, tmp_path, up="+x", grid_mm=0.1, reach_mm=1.4)  # z of the file is Y then
    exact = Ball(1.5, axes=(0, 2))
    box = ([-1.4, -1.5, -1.2], [1.4, 1.5, 0.3])
    points = around(lambda p: exact.distance(p).gap, box)
    at, expected = body.distance(points), exact.distance(points)
    assert np.abs(at.gap - expected.gap).max() < 1e-3
    assert np.abs(at.normal - expected.normal).max() < 0.02
    assert np.sqrt(np.mean((at.hessian - expected.hessian) ** 2)) < 0.1


@pytest.fixture(scope="module")
def tilted(tmp_path_factory):
    keys = {"tilt_deg": (10.0, -5.0), "turn_deg": 30.0, "shift_mm": (0.4, -0.3), "grid_mm": 0.1}
    return body_of(trimesh.creation.box(2 * HALF), tmp_path_factory.mktemp("tilted"), **keys)


def test_a_part_is_turned_and_its_highest_point_is_zero(tilted):
    turn = Rotation.from_euler("xyz", [10, -5, 30], degrees=True)
    signs = np.array(list(product((-1, 1), repeat=3)))
    top = turn.apply(signs * (HALF - 0.3))[:, 2].max() + 0.3

    def exact(points):
        middle = np.array([0.4, -0.3, -top])
        return rounded_box(turn.inv().apply(points - middle) - [0, 0, HALF[2]], 0.3)

    points = around(exact, ([-3, -3, -2.0], [3, 3, 0.3]))
    assert np.abs(tilted.distance(points).gap - exact(points)).max() < 0.005


def test_derivatives_are_those_of_the_gap(tilted):
    points = np.random.default_rng(5).uniform([-3, -3, -2], [3, 3, 0.4], (40_000, 3))
    gap = tilted.distance(points).gap
    points, eps = points[(gap > -0.1) & (gap < 0.4)], 1e-5
    at = tilted.distance(points)
    for axis in range(3):
        step = eps * np.eye(3)[axis]
        ahead, behind = tilted.distance(points + step), tilted.distance(points - step)
        assert np.abs((ahead.gap - behind.gap) / (2 * eps) - at.normal[:, axis]).max() < 1e-6
        bend = (ahead.normal - behind.normal) / (2 * eps)
        assert np.abs(bend - at.hessian[:, axis]).max() < 1e-2  # its own slope jumps
    assert at.hessian == pytest.approx(at.hessian.transpose(0, 2, 1), abs=1e-12)


def test_beyond_its_grid_a_part_goes_on_and_far_away_it_points_up(tmp_path):
    body = body_of(trimesh.creation.box([6, 6, 8]), tmp_path, window_mm=(4, 4), reach_mm=2.0)
    at = body.distance(np.array([[0, 0, -3.0], [2.9, 0, 0.1], [9, 9, 0.1], [0, 0, 9.0]]))
    assert at.gap[:3] == pytest.approx([-3.0, 0.1, 0.1], abs=0.3)
    assert at.gap[3] > 0.5
    assert np.all(np.isfinite(at.normal)) and np.all(at.normal[1:, 2] > 0.9)


def test_a_window_does_not_change_what_is_in_it(tmp_path):
    box = trimesh.creation.box([8, 8, 8])
    keys = {"shift_mm": (0.5, -3.0), "grid_mm": 0.1}
    whole = body_of(box, tmp_path, **keys, reach_mm=2.0)
    piece = body_of(box, tmp_path, **keys, reach_mm=1.5, window_mm=(3.0, 3.0))
    points = np.random.default_rng(5).uniform([-1.5, -1.5, -1.4], [1.5, 1.5, 0.4], (5000, 3))
    gap = whole.distance(points).gap
    near = (gap > -0.1) & (gap < 0.4)
    assert np.ptp(points[near, 2]) > 1.5  # over the edge at Y 1
    assert piece.distance(points[near]).gap == pytest.approx(gap[near], abs=2e-3)


def test_the_highest_point_of_a_piece_is_zero(tmp_path):
    stairs = prism(STEP, 2.0)  # 1 mm lower at Y > 0
    body = body_of(stairs, tmp_path, window_mm=(2.0, 0.8), shift_mm=(0.0, -1.2), reach_mm=0.5)
    at = body.distance(np.array([[0.0, 0.0, 0.1], [0.0, 0.3, -0.02]]))
    assert at.gap == pytest.approx([0.1, -0.02], abs=1e-4)


@pytest.mark.parametrize("aside", [4.0, -1.95, -2.0])
def test_a_high_place_beside_the_window_takes_no_layers(aside, tmp_path):
    profile = shapely.Polygon([(-6, -1), (10, -1), (10, 31), (6, 31), (6, 1), (-6, 1)])
    file = tmp_path / "tower.obj"
    n, corners = 6, shapely.get_coordinates(profile.exterior)[:-1]
    lines = [f"v {x} {y} {z}" for y in (3, -3) for x, z in corners.tolist()]
    faces = [[*range(n, 0, -1)], [*range(n + 1, 2 * n + 1)]]
    faces += [[k, k % n + 1, k % n + 1 + n, k + n] for k in range(1, n + 1)]
    file.write_text("\n".join([*lines, *("f " + " ".join(map(str, face)) for face in faces)]))
    keys = {"window_mm": (4.0, 4.0), "shift_mm": (aside, 0.0)}  # the wall is at X 4 of the part
    body = Mesh(file=file, **keys).body()
    points = np.random.default_rng(3).uniform([-1.4, -1.9, -0.3], [1.2, 1.9, 0.4], (1000, 3))
    at = body.distance(points)
    assert np.abs(at.gap - points[:, 2]).max() < 0.005
    assert len(body.body.values[0, 0]) < 60


def test_the_unit_scales_a_part(tmp_path):
    ball = trimesh.creation.icosphere(5, 0.002)
    body = body_of(ball, tmp_path, unit_mm=1000.0, reach_mm=1.0)
    assert body.distance(np.array([[0.5, 0.0, 0.2]])).gap == pytest.approx(
        np.hypot(0.5, 2.2) - 2.0, abs=2e-3
    )


def test_a_part_that_is_inside_out_is_turned_with_a_note(tmp_path, caplog):
    box = trimesh.creation.box([4, 4, 2])
    box.invert()
    with caplog.at_level(logging.WARNING, logger="tactile_fem"):
        body = body_of(box, tmp_path, grid_mm=0.15)
    assert "is inside out: its triangles are turned" in caplog.text
    assert body.distance(np.array([[0.0, 0.0, 0.1]])).gap == pytest.approx(0.1, abs=1e-5)


def without_a_triangle():
    box = trimesh.creation.box([4, 4, 2])
    box.update_faces(np.arange(12) != 3)
    return box


def with_a_triangle_turned():
    box = trimesh.creation.box([4, 4, 2])
    faces = box.faces.copy()
    faces[3] = faces[3][::-1]
    return trimesh.Trimesh(box.vertices, faces, process=False)


def two_boxes(size, shift, *, inverted=False):
    other = trimesh.creation.box(size).apply_translation(shift)
    if inverted:
        other.invert()
    return trimesh.util.concatenate([trimesh.creation.box([6, 6, 3]), other])


def glued():
    """Return two boxes that share a face, which is there twice."""
    return trimesh.util.concatenate(
        [trimesh.creation.box([4, 4, 2]).apply_translation([x, 0, 0]) for x in (0, 4)]
    )


@pytest.mark.parametrize(
    ("mesh", "keys", "sentence"),
    [
        (without_a_triangle(), {}, r"it is open at 3 edges, the first at -2, 0, -1 mm in the file"),
        (with_a_triangle_turned(), {}, "neighbours face opposite ways at 3 edges, the first at"),
        (
            two_boxes([2, 2, 3], [0, 0, 1]),
            {},
            "overlaps another around X -.* Z -.* unite its solids",
        ),
        (
            two_boxes([2, 2, 2], [8, 0, 0], inverted=True),
            {},
            r"a part of the surface is inside out around X [345]",
        ),
        (
            two_boxes([0.4, 4, 3], [6, 0, 0]),
            {},
            "= 0.3 removes a wall of the part at X 4.* thinner",
        ),
        (
            two_boxes([4.0, 0.4, 1], [0, 0, -1], inverted=True),
            {"up": "-z"},
            "= 0.3 removes a gap of the part at X",
        ),
        (trimesh.creation.box([4, 4, 0.5]), {}, "edge_radius_mm = 0.3 leaves nothing of the part"),
        (trimesh.creation.box([4, 4, 2]), {"unit_mm": 1e3}, r"4e\+03 x 4e\+03 x 2e\+03 mm large"),
        (trimesh.creation.box([4, 4, 2]), {"unit_mm": 1e-3}, r"must have 1 to 1000 mm"),
        (trimesh.creation.box([4, 4, 2]), {"grid_mm": 0.2}, r"half of edge_radius_mm \(0.15\)"),
        (trimesh.creation.box([200, 200, 2]), {}, "takes 20.* points .* at most 5 million"),
        (glued(), {}, "solids touch at 4 edges, the first at 2, .*repair it"),
        (
            trimesh.creation.box([4, 4, 2]),
            {"grid_mm": 1e-300},
            r"takes 5e\+300 x 5e\+300 x 3e\+300 points",
        ),
        (
            trimesh.creation.box([4, 4, 2]),
            {"window_mm": (2.0, 2.0), "shift_mm": (9.0, 0.0)},
            r"window_mm = \[2.0, 2.0\] holds no piece of the part, which lies from -2 to 2 mm",
        ),
    ],
)
def test_a_part_that_cannot_be_used_is_told(mesh, keys, sentence, tmp_path):
    with pytest.raises(StudyError, match=sentence):
        body_of(mesh, tmp_path, **keys)


def forces(stimulus, mesh):
    """Return the forces (3,) of a ball pressed obliquely, to two depths."""
    pytest.importorskip("tactile_fem.runtime.backend")
    from mpi4py import MPI

    from tactile_fem.mechanics.domain import create_domain
    from tactile_fem.solvers.finger_problem import FingerProblem

    study = Study(stimulus=stimulus)
    domain = create_domain(mesh, MPI.COMM_WORLD, study.solver.held)
    problem = FingerProblem(domain, study.tissue, stimulus.body(), stimulus.friction, study.solver)
    for depth in (0.4, 0.8):
        assert problem.solve(np.array([0.0, -0.2 * depth, depth]), 0.05).converged
        load = problem.accept()
    return load.force_N


@pytest.mark.slow
def test_a_ball_from_a_file_presses_like_the_ball(small_finger, tmp_path):
    file = tmp_path / "ball.stl"
    trimesh.creation.icosphere(5, 4.0).export(file)
    mesh = read_mesh(small_finger)
    exact = forces(Sphere(radius_mm=4.0), mesh)
    assert exact[2] > 0.02
    error = np.linalg.norm(forces(Mesh(file=file, reach_mm=1.5), mesh) - exact)
    assert error < 0.005 * np.linalg.norm(exact)


def test_a_wrong_file_is_told_in_a_sentence(tmp_path, capsys):
    file = tmp_path / "many.stl"
    file.write_bytes(bytes(80) + (10**9).to_bytes(4, "little") + bytes(500))
    options = ["--set", "stimulus.kind=mesh", "--set", f"stimulus.file={file}"]
    assert cli.main(["scan", *options, "--results", str(tmp_path / "out")]) == 2
    *log, message = capsys.readouterr().err.splitlines()  # the log is empty if the mesh is known
    assert all(" INFO " in line for line in log)
    assert message.startswith(f"tactile-fem: stimulus.file = {file} ")
    assert "not its header's 50000000084" in message
    assert not (tmp_path / "out").exists()


def test_a_file_lies_beside_its_study(tmp_path):
    trimesh.creation.box([4, 4, 2]).export(tmp_path / "key.stl")
    study = tmp_path / "study.toml"
    study.write_text('[stimulus]\nkind = "mesh"\nfile = "key.stl"\n')
    assert load_study(study).stimulus == Mesh(file=tmp_path / "key.stl")

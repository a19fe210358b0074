"""The reader of triangulated surfaces: formats, units, and one sentence for each wrong file."""

import struct

import numpy as np
import pytest
import trimesh

from tactile_fem.errors import StudyError
from tactile_fem.shapes.surface_files import MOST_TRIANGLES, read_triangles

BALL = trimesh.creation.icosphere(2)
FIELD = "finger.skin_file"


@pytest.mark.parametrize(
    ("name", "kind"), [("a.stl", "stl"), ("a.STL", "stl_ascii"), ("a.obj", "obj"), ("a.ply", "ply")]
)
def test_a_file_is_read_in_mm_with_merged_vertices(tmp_path, name, kind):
    data = BALL.export(file_type=kind)
    (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    found = read_triangles(tmp_path / name, FIELD, unit_mm=1000.0)
    assert found.points.shape == BALL.vertices.shape and found.points.dtype == np.float64
    assert found.triangles.shape == BALL.faces.shape and found.triangles.dtype == np.int64
    assert np.allclose(np.linalg.norm(found.points, axis=1), 1000.0, atol=1e-3)
    ball = trimesh.Trimesh(found.points, found.triangles, process=False)
    assert ball.is_watertight and ball.volume == pytest.approx(BALL.volume * 1e9, rel=1e-5)


STL, PLY = BALL.export(file_type="stl"), BALL.export(file_type="ply")
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf "
WITH_NAN = np.where(np.arange(len(BALL.vertices))[:, None] == 3, np.nan, BALL.vertices)
BROKEN = trimesh.Trimesh(WITH_NAN, BALL.faces, process=False).export(file_type="stl")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.vtk", b"x", "must be a surface of triangles"),
        ("a.stl", None, "does not exist"),
        ("a.stl", b"", "is empty"),
        ("a.stl", b"this is a text\n" * 20, "is no .stl file, or damaged"),
        ("a.obj", b"this is a text\n" * 20, "contains no triangles"),
        ("a.ply", b"this is a text\n" * 20, "is no .ply file, or damaged"),
        ("a.stl", STL[:-100], "or damaged (cut off: 15984 bytes, not its header's 16084"),
        ("a.stl", BALL.export(file_type="stl_ascii")[:-100].encode(), "does not end with endsolid"),
        ("a.ply", PLY[:-100], "is no .ply file, or damaged"),
        ("a.stl", BROKEN, "no finite numbers"),
        ("a.obj", (SQUARE + "1 2 9").encode(), "is no .obj file, or damaged"),
        ("a.obj", (SQUARE + "1 1 2").encode(), "no triangles with an area"),
        ("a.obj", (SQUARE + "1 2 3").replace("1 1 0", "1 1e9 0").encode(), "is its unit right?"),
        ("a.ply", PLY.replace(b"face 320", b"face 1000000000"), "has 1000000000 triangles"),
    ],
)
def test_a_wrong_file_is_one_sentence(tmp_path, name, content, words):
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(StudyError) as error:
        read_triangles(file, FIELD, unit_mm=1.0)
    message = str(error.value)
    assert message.startswith(f"{FIELD} = {file} ") and words in message and "\n" not in message


def test_huge_files_are_refused_without_reading(tmp_path):
    file = tmp_path / "a.stl"
    with file.open("wb") as stream:
        stream.write(bytes(80) + struct.pack("<I", 10**9))
        stream.truncate(84 + 50 * 10**9)  # a sparse file
    with pytest.raises(StudyError, match=f"1000000000 triangles, but at most {MOST_TRIANGLES}"):
        read_triangles(file, FIELD, unit_mm=1.0)
    text = tmp_path / "a.obj"
    with text.open("wb") as stream:
        stream.truncate(10**11)
    with pytest.raises(StudyError, match="100000 MB large"):
        read_triangles(text, FIELD, unit_mm=1.0)


def test_quads_negative_indices_and_objects_are_read_and_materials_ignored(tmp_path):
    file = tmp_path / "a.obj"
    text = "mtllib elsewhere.mtl\no one\n" + SQUARE + "1//1 2//1 3//1 4//1\no two\nf -1 -2 -3\n"
    file.write_text(text)
    found = read_triangles(file, FIELD, unit_mm=2.0)
    assert len(found.triangles) == 3 and found.points.max() == 2.0


L_SHAPE = [(-6, -6), (6, -6), (6, 0), (0, 0), (0, 6), (-6, 6)]
TURN = np.arange(8) * np.pi / 4
STAR = np.where(np.arange(8) % 2, 0.6, 2.0)[:, None] * np.column_stack([np.cos(TURN), np.sin(TURN)])
# A dart of four corners, an L with corners on its sides, one with a hole and a slit to it, a star.
OUTLINES = {
    "l": (L_SHAPE, 108.0),
    "dart": ([(0, 0), (4, 0), (4, 4), (3, 1)], 4.0),
    "straight": ([(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (0, 1)], 3.0),
    "slit": (
        [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)],
        12.0,
    ),
    "star": (STAR.tolist(), 4 * np.sin(np.pi / 4) * 2 * 0.6),
    "convex": ((np.column_stack([np.cos(TURN), np.sin(TURN)])).tolist(), 4 * np.sin(np.pi / 4)),
}


def prism(outline):
    """Return vertices and faces of a prism, 1 mm high and turned in space, of any outline."""
    corners = list(dict.fromkeys(map(tuple, outline)))
    n, number = len(corners), {corner: k for k, corner in enumerate(corners)}
    ring = [number[tuple(corner)] for corner in outline]
    sides = list(zip(ring, ring[1:] + ring[:1], strict=True))
    faces = [ring[::-1], [k + n for k in ring]]
    faces += [[a, b, b + n, a + n] for a, b in sides if (b, a) not in sides]
    points = np.array([[x, y, z] for z in (0, 1) for x, y in corners], dtype=float)
    return trimesh.transform_points(points, trimesh.transformations.euler_matrix(1, 2, 3)), faces


def as_obj(points, faces, back=False):
    lines = [f"v {x} {y} {z}" for x, y, z in points.tolist()] + ["vt 0 0", "vn 0 0 1"]
    first = -len(points) if back else 1
    lines += ["f " + " ".join(f"{k + first}/1/1" for k in face) for face in faces]
    return "\n".join([*lines, *(["v 9 9 9"] * 5 if back else [])]).encode()


def as_ply(points, faces, order):
    kind = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    head = f"ply\nformat {kind} 1.0\ncomment c\nelement vertex {len(points)}\n"
    head += "property double x\nproperty double y\nproperty double z\nproperty uchar red\n"
    head += f"element face {len(faces)}\nproperty list uchar int vertex_index\n"
    head += "property float quality\nelement edge 1\nproperty int vertex1\nend_header\n"
    rows = [(3 * "d" + "B", [*point, 255]) for point in points.tolist()]
    rows += [(f"B{len(face)}if", [len(face), *face, 0.5]) for face in faces] + [("i", [7])]
    if order:
        return head.encode() + b"".join(struct.pack(order + kinds, *row) for kinds, row in rows)
    return (head + "".join(" ".join(map(str, row)) + "\n" for _, row in rows)).encode()


@pytest.mark.parametrize("name", OUTLINES)
def test_faces_of_any_shape_are_divided(name, tmp_path):
    outline, area = OUTLINES[name]
    points, faces = prism(outline)
    files = {"a.obj": as_obj(points, faces), "b.obj": as_obj(points, faces, back=True)}
    files |= {f"{k}.ply": as_ply(points, faces, order) for k, order in enumerate(("<", ">", ""))}
    for file, content in files.items():
        (tmp_path / file).write_bytes(content)
        found = read_triangles(tmp_path / file, FIELD, unit_mm=1.0)
        solid = trimesh.Trimesh(found.points, found.triangles, process=False)
        assert solid.is_watertight and solid.area_faces.min() > 1e-6, file
        if area is not None:
            assert solid.volume == pytest.approx(area), file


def test_a_bent_quadrilateral_is_two_triangles_that_face_alike(tmp_path):
    text = SQUARE.replace("v 1 1 0", "v 0.3 0.3 0.1") + "1 2 3 4\n"  # its third corner turns in
    (tmp_path / "a.obj").write_text(text)
    found = read_triangles(tmp_path / "a.obj", FIELD, unit_mm=1.0)
    a, b, c = np.moveaxis(found.points[found.triangles], 1, 0)
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0.05)


def test_a_face_whose_sides_cross_is_told(tmp_path):
    (tmp_path / "a.obj").write_text(SQUARE.replace("f ", "v 0.5 -1 0\nf ") + "1 3 2 4 5\n")
    with pytest.raises(StudyError, match=r"damaged \(the sides of its face at .* cross\)"):
        read_triangles(tmp_path / "a.obj", FIELD, unit_mm=1.0)

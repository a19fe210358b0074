"""The reader of triangulated surfaces: formats, units, and one sentence for each wrong file."""

import struct

import numpy as np
import pytest
import trimesh

from tactile_fem.errors import StudyError
from tactile_fem.runtime.triangles import MOST_TRIANGLES, read_triangles

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
        ("a.stl", b"this is a text\n" * 20, "is no .stl file, or cut off"),
        ("a.obj", b"this is a text\n" * 20, "contains no triangles"),
        ("a.ply", b"this is a text\n" * 20, "is no .ply file, or damaged"),
        ("a.stl", STL[:-100], "or cut off: it has 15984 bytes, not the 16084"),
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

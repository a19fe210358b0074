"""The finger's mesh: layers, tags, files, refusals."""

import dataclasses
import math
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from needs import needs_gmsh

from tactile_fem.errors import MeshError
from tactile_fem.finger import SURFACES, TISSUES, build_finger, describe, read_mesh, write_mesh
from tactile_fem.finger.anatomy import depth_below
from tactile_fem.finger.shape import skin_shape
from tactile_fem.finger.simplex import facets_of, gammas, volumes
from tactile_fem.study import Finger

FINGER = Finger()
SHIPPED = {"coarse": FINGER, "small": Finger(pad_size_mm=3.0, far_size_mm=6.0)}


@pytest.fixture(scope="module", params=["shipped", pytest.param("built", marks=needs_gmsh)])
def mesh(request):
    return FINGER.mesh() if request.param == "shipped" else build_finger(FINGER)


@pytest.fixture(scope="module")
def shipped():
    return FINGER.mesh()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"dermis_mm": 4.0}, "too thick"),
        ({"subcutaneous_mm": 0.05}, "below the skin"),
        ({"bone_half_width_mm": 9.0}, "outside the skin"),
        ({"bone_tip_gap_mm": 13.0}, "bone_tip_gap_mm"),
        ({"tip_length_mm": 13.0}, "tip_length_mm"),
        ({"pad_radius_mm": 5.0}, "pad_radius_mm"),
        ({"straight_length_mm": 1.0}, "straight_length_mm"),
        ({"nail_width_mm": 17.0}, "nail"),
        ({"nail_length_mm": 26.0}, "nail"),
        ({"nail_thickness_mm": 2.0}, "nail_thickness_mm"),
        ({"pad_size_mm": 2.0, "far_size_mm": 1.0}, "far_size_mm"),
    ],
)
def test_impossible_fingers_are_refused(values, words):
    with pytest.raises(MeshError, match=words) as caught:
        build_finger(Finger(**values))
    assert "\n" not in str(caught.value)


# --- mesh ----------------------------------------------------------------------------------------


def test_size_of_the_coarse_mesh(mesh):
    assert 7_000 < len(mesh.cells) < 10_500
    assert 3 * len(mesh.nodes) < 42_000
    assert len(np.unique(mesh.cells)) == len(mesh.nodes)


def test_jacobians_and_quality(mesh):
    mesh.check()
    assert volumes(mesh.nodes, mesh.cells).min() > 0
    thick = np.isin(mesh.tissue, [TISSUES[name] for name in ("dermis", "subcutaneous", "bone")])
    assert gammas(mesh.nodes, mesh.cells)[thick].min() > 0.08


def test_gamma_of_known_tetrahedra():
    nodes = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0, 0, 0]], dtype=float)
    nodes = np.vstack([nodes, [[1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    found = gammas(nodes, np.array([[0, 2, 1, 3], [4, 5, 6, 7]]))
    inscribed, circumscribed = 1 / (3 + math.sqrt(3)), math.sqrt(3) / 2
    assert found == pytest.approx([1.0, 3 * inscribed / circumscribed])


def test_layers_are_as_thick_as_wanted_over_the_pad(mesh):
    for name, found in mesh.layer_thickness_mm.items():
        expected = getattr(FINGER, f"{name}_mm")
        assert len(found) > 200
        off = np.abs(found / expected - 1)
        assert off.mean() < 0.005 and off.max() < 0.1, name  # chords where the tip closes


def test_layers_and_pad_are_measured_whoever_made_the_mesh(shipped):
    expected = {"stratum_corneum": 0.17, "epidermis": 0.65, "dermis": 0.8}
    # Chords of edges as long as 1.6 mm on the round pad cut up to 0.02 mm off.
    assert shipped.layers_mm == pytest.approx(expected, rel=5e-3)
    assert shipped.pad_thickness_mm == pytest.approx(5.3, abs=0.02)
    thicker = dataclasses.replace(shipped, nodes=1.2 * shipped.nodes)
    scaled = {name: 1.2 * value for name, value in shipped.layers_mm.items()}
    # The pad is cut out where it was before: a few other facets count.
    assert thicker.layers_mm == pytest.approx(scaled, rel=2e-3)
    assert thicker.pad_thickness_mm == pytest.approx(1.2 * shipped.pad_thickness_mm)


def test_a_mesh_beside_the_contact_point_is_refused(shipped):
    beside = dataclasses.replace(shipped, nodes=shipped.nodes + np.array([0.0, -8.0, 0.0]))
    with pytest.raises(MeshError, match="no bone_surface above the contact point"):
        beside.check()
    far = dataclasses.replace(shipped, nodes=shipped.nodes + np.array([50.0, 0.0, 0.0]))
    assert far.layers_mm == {}
    with pytest.raises(MeshError, match="no skin above the contact point"):
        far.check()


def bone_height(mesh):
    bone = mesh.nodes[np.unique(mesh.facets[mesh.surface == SURFACES["bone_surface"]])]
    return bone[np.hypot(bone[:, 0], bone[:, 1]) < 2.0, 2].min()


def test_pad_thickness_at_the_contact_point(mesh):
    assert bone_height(mesh) == pytest.approx(FINGER.pad_thickness_mm, abs=0.1)
    skin = mesh.nodes[mesh.facets[mesh.surface == SURFACES["skin"], :3]]
    assert 0 <= skin[..., 2].min() < 0.02


def test_volumes(mesh):
    volume = volumes(mesh.nodes, mesh.cells)
    facets, _, second = facets_of(mesh.cells)
    a, b, c = np.moveaxis(mesh.nodes[facets[second < 0]], 1, 0)
    enclosed = np.einsum("ij,ij->", np.cross(a, b), c) / 6.0
    assert volume.sum() == pytest.approx(enclosed, rel=1e-9)
    tip = 2 / 3 * math.pi * 8.0 * 6.75 * 11.0
    assert volume.sum() == pytest.approx(tip + math.pi * 8.0 * 6.75 * 14.0, rel=0.07)
    parts = {name: volume[mesh.tissue == tag].sum() for name, tag in TISSUES.items()}
    assert sum(parts.values()) == pytest.approx(volume.sum(), rel=1e-12)
    skin = parts["stratum_corneum"] + parts["epidermis"] + parts["nail"]
    assert parts["stratum_corneum"] < parts["epidermis"] < parts["dermis"] < parts["subcutaneous"]
    assert skin / 0.82 == pytest.approx(parts["dermis"] / 0.8, rel=0.2)


def test_conforming_and_closed(mesh):
    facets, _, second = facets_of(mesh.cells)  # raises beyond two cells to a facet
    rim = facets[second < 0]
    edges = np.sort(rim[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert np.all(count == 2)
    assert len(np.unique(rim)) - len(count) + len(rim) == 2  # a sphere


def test_surfaces_lie_where_their_names_say(mesh):
    facets, first, second = facets_of(mesh.cells)
    key = {tuple(sorted(f)): i for i, f in enumerate(facets.tolist())}
    number = np.array([key[tuple(sorted(t))] for t in mesh.facets[:, :3].tolist()])
    assert len(np.unique(number)) == len(number)
    one = mesh.tissue[first[number]]
    other = np.where(second[number] < 0, 0, mesh.tissue[second[number]])
    pairs = 10 * np.minimum(one, other) + np.maximum(one, other)
    sides = {name: set(pairs[mesh.surface == tag].tolist()) for name, tag in SURFACES.items()}
    assert sides["skin"] == {1}
    assert sides["interface"] == {23}
    assert sides["bone_surface"] == {45}
    assert sides["cut"] == {1, 2, 3, 4, 5}
    assert np.all(
        mesh.nodes[mesh.facets[mesh.surface == SURFACES["cut"]], 1] == skin_shape(FINGER).cut_y
    )
    centre = mesh.nodes[mesh.facets[:, :3]].mean(axis=1)
    interface = centre[mesh.surface == SURFACES["interface"]]
    depth = depth_below(skin_shape(FINGER), interface[interface[:, 1] > -9.0])
    assert np.median(depth) == pytest.approx(0.82, abs=0.05)


def test_skin_triangles_turn_outwards_and_are_fine_under_the_letters(mesh):
    corner = mesh.nodes[mesh.facets[mesh.surface == SURFACES["skin"], :3]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    centre = corner.mean(axis=1)
    pad = (np.abs(centre[:, 0]) < 4.0) & (np.abs(centre[:, 1]) < 5.5) & (centre[:, 2] < 4.0)
    assert np.all(normal[pad, 2] < 0)
    edges = np.linalg.norm(corner[pad] - np.roll(corner[pad], 1, axis=1), axis=2)
    assert edges.max() < 1.6 and edges.mean() < 1.15
    area = 0.5 * np.linalg.norm(normal[pad], axis=1)
    assert (4 * math.sqrt(3) * area / np.sum(edges**2, axis=1)).min() > 0.6


def test_midpoints_are_straight(mesh):
    edges = np.array([[0, 1], [1, 2], [2, 0], [3, 0], [2, 3], [1, 3]])
    middle = mesh.nodes[mesh.cells[:, edges]].mean(axis=2)
    assert np.abs(middle - mesh.nodes[mesh.cells[:, 4:]]).max() < 1e-8
    middle = mesh.nodes[mesh.facets[:, edges[:3]]].mean(axis=2)
    assert np.abs(middle - mesh.nodes[mesh.facets[:, 3:]]).max() < 1e-8


@needs_gmsh
def test_every_process_makes_the_same_mesh():
    """Of a finger for which gmsh's optimizer found one of two meshes, by chance."""
    code = (
        "from tactile_fem import Study\n"
        "from tactile_fem.people import people\n"
        "from tactile_fem.study import Finger\n"
        "study = Study(finger=Finger(pad_size_mm=3.0, far_size_mm=6.0))\n"
        "print(people(study, 2)[1].study.finger.mesh().hash)\n"
    )
    command = [sys.executable, "-c", code]
    runs = [subprocess.run(command, capture_output=True, text=True, check=True) for _ in range(4)]
    assert len({run.stdout for run in runs}) == 1


@needs_gmsh
def test_same_parameters_same_mesh_and_gmsh_is_left_closed():
    import gmsh

    finger = Finger(pad_size_mm=2.5, far_size_mm=5.0, epidermis_rows=1)
    first, again = build_finger(finger), build_finger(finger)
    assert first.hash == again.hash
    assert len(first.cells) < 6_000
    assert not gmsh.isInitialized()
    with pytest.raises(MeshError):
        build_finger(Finger(dermis_mm=4.0))
    assert not gmsh.isInitialized()


@needs_gmsh
def test_a_session_of_the_callers_survives():
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("mine")
        build_finger(Finger(pad_size_mm=2.5, far_size_mm=5.0))
        assert gmsh.isInitialized()
        assert gmsh.model.getCurrent() == "mine"
        assert gmsh.option.getNumber("Mesh.Algorithm3D") == 1
    finally:
        gmsh.finalize()


@needs_gmsh
def test_subcutaneous_tissue_of_the_paper():
    mesh = build_finger(Finger(subcutaneous_mm=0.7))
    assert bone_height(mesh) == pytest.approx(2.32, abs=0.1)


@needs_gmsh
@pytest.mark.slow
@pytest.mark.parametrize(("preset", "count"), [("medium", 25_000), ("paper", 81_000)])
def test_finer_presets(preset, count):
    finger = Finger(preset=preset)
    mesh = build_finger(finger)
    assert len(mesh.cells) == pytest.approx(count, rel=0.05)
    fat = mesh.tissue == TISSUES["subcutaneous"]
    assert gammas(mesh.nodes, mesh.cells[fat]).min() > 0.1
    for name, found in mesh.layer_thickness_mm.items():
        thickness = getattr(finger, f"{name}_mm")
        assert found.min() > 0.95 * thickness and found.max() < 1.05 * thickness


# --- files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["npz", pytest.param("msh", marks=needs_gmsh)])
def test_write_and_read(shipped, kind, tmp_path):
    one, other = (tmp_path / f"{name}.{kind}" for name in "ab")
    write_mesh(one, shipped)
    write_mesh(other, shipped)
    assert one.read_bytes() == other.read_bytes()
    assert sorted(tmp_path.iterdir()) == [one, other]
    assert read_mesh(one).hash == shipped.hash
    assert Finger(mesh_file=one).mesh().hash == shipped.hash


@needs_gmsh
def test_names_decide_not_numbers(shipped, tmp_path):
    other = dataclasses.replace(shipped, tissue=7 - shipped.tissue)
    path = tmp_path / "a.msh"
    write_mesh(path, other)
    text = path.read_text()
    for name, tag in TISSUES.items():
        text = text.replace(f'3 {tag} "{name}"', f'3 {7 - tag} "@{name}"')
    path.write_text(text.replace('"@', '"'))
    assert read_mesh(path).hash == shipped.hash


def saved_by_gmsh(path, options, more=lambda gmsh: None):
    """Save the small finger, with a line in no physical group, as gmsh does with some options."""
    import gmsh

    write_mesh(path, SHIPPED["small"].mesh())
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        line = gmsh.model.addDiscreteEntity(1, 555)
        gmsh.model.mesh.addElementsByType(line, 1, [9_000_001], [1, 2])
        more(gmsh)
        for name, value in options.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


def content(mesh):
    """Return the corners of all cells and facets with their tags, whatever the order."""
    parts = ((mesh.cells, mesh.tissue), (mesh.facets, mesh.surface))
    rows = [np.column_stack([tags, mesh.nodes[c].reshape(len(c), -1)]) for c, tags in parts]
    return [row[np.lexsort(row.T)] for row in rows]


def another_group(gmsh):
    """Put all volumes into one more group, all surfaces into one that has a tissue's name."""
    volumes, surfaces = ([tag for _, tag in gmsh.model.getEntities(dim)] for dim in (3, 2))
    gmsh.model.addPhysicalGroup(3, volumes, name="all that's soft")
    gmsh.model.addPhysicalGroup(2, surfaces, name="bone")


def in_parts(gmsh):
    gmsh.model.mesh.partition(2)


@needs_gmsh
@pytest.mark.parametrize(("version", "binary"), [(2.2, 0), (2.2, 1), (4.0, 0), (4.1, 0), (4.1, 1)])
def test_files_of_gmsh_are_read_whatever_it_was_told_to_save(version, binary, tmp_path):
    options = {"MshFileVersion": version, "Binary": binary}
    ways = [({}, another_group), ({"SaveParametric": int(version < 3)}, in_parts)]
    if version > 4:  # format 2 loses the groups, format 4.0 puts partitions elsewhere
        ways += [({"SaveAll": 1}, another_group), ({"SaveAll": 1, "SaveParametric": 1}, in_parts)]
    elif version == 4:
        ways = [({"SaveAll": 1, "SaveParametric": 1}, another_group)]
    expected = content(SHIPPED["small"].mesh())
    for k, (more, change) in enumerate(ways):
        found = read_mesh(saved_by_gmsh(tmp_path / f"{k}.msh", options | more, change))
        for rows, others in zip(content(found), expected, strict=True):
            np.testing.assert_allclose(rows, others, atol=1e-12)


@needs_gmsh
def test_groups_that_a_file_lost_or_that_contradict_are_told(tmp_path):
    lost = saved_by_gmsh(tmp_path / "a.msh", {"MshFileVersion": 2.2, "SaveAll": 1})
    with pytest.raises(MeshError, match=r"no elements in physical groups: .*Mesh.SaveAll"):
        read_mesh(lost)

    def both(gmsh):
        gmsh.model.addPhysicalGroup(3, [1], 3)

    for version in (2.2, 4.1):
        file = saved_by_gmsh(tmp_path / "b.msh", {"MshFileVersion": version}, both)
        with pytest.raises(MeshError, match="elements in two of the groups stratum_corneum"):
            read_mesh(file)


@needs_gmsh
@pytest.mark.parametrize("name", ["interface", "bone", "skin"])
def test_a_missing_part_is_named(shipped, tmp_path, name):
    tags = TISSUES | SURFACES
    triangles = shipped.surface != tags[name]
    tissue = np.where(shipped.tissue == tags[name], 4, shipped.tissue)
    part = dataclasses.replace(
        shipped,
        tissue=tissue,
        facets=shipped.facets[triangles],
        surface=shipped.surface[triangles],
    )
    write_mesh(tmp_path / "a.msh", part)
    with pytest.raises(MeshError, match=rf"lacks the physical group {name}$"):
        read_mesh(tmp_path / "a.msh")
    with pytest.raises(MeshError, match=name):
        part.check()


@needs_gmsh
def test_linear_elements_and_other_files_are_refused(tmp_path):
    import meshio

    linear = meshio.Mesh(np.eye(4, 3), [("tetra", np.array([[0, 1, 2, 3]]))])
    meshio.write(tmp_path / "a.msh", linear, file_format="gmsh22")
    with pytest.raises(MeshError, match="ten-node"):
        read_mesh(tmp_path / "a.msh")
    (tmp_path / "b.msh").write_text("no mesh at all\n")
    with pytest.raises(MeshError, match="cannot read"):
        read_mesh(tmp_path / "b.msh")
    write_mesh(tmp_path / "d.msh", SHIPPED["small"].mesh())
    whole = (tmp_path / "d.msh").read_text()
    (tmp_path / "d.msh").write_text(whole[: len(whole) // 2])
    with pytest.raises(MeshError, match="cannot read the mesh"):
        read_mesh(tmp_path / "d.msh")
    np.savez(tmp_path / "e.npz", x=np.zeros(3))
    with pytest.raises(MeshError, match="it is no mesh"):
        read_mesh(tmp_path / "e.npz")
    with pytest.raises(MeshError, match="does not exist"):
        Finger(mesh_file=tmp_path / "c.msh").mesh()


def test_inverted_tetrahedra_are_refused(shipped):
    nodes = shipped.nodes.copy()
    nodes[:, 0] *= -1
    with pytest.raises(MeshError, match="Jacobian"):
        dataclasses.replace(shipped, nodes=nodes).check()


def test_a_shipped_mesh_is_that_of_its_recipe_only():
    for name, finger in SHIPPED.items():
        assert finger.shipped_file().name == f"{name}.npz"
        finger.mesh().check()
        assert finger.model_copy(update={"dermis_mm": 0.81}).shipped_file() is None


@needs_gmsh
@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_mesh_is_what_gmsh_makes(name):
    finger = SHIPPED[name]
    mesh, built = finger.mesh(), build_finger(finger)
    assert len(mesh.cells) == pytest.approx(len(built.cells), rel=0.05)
    for tag in TISSUES.values():
        one, other = (volumes(m.nodes, m.cells[m.tissue == tag]).sum() for m in (mesh, built))
        assert one == pytest.approx(other, rel=0.01)
    for tag in SURFACES.values():
        one, other = (m.nodes[m.facets[m.surface == tag]] for m in (mesh, built))
        np.testing.assert_allclose(one.min((0, 1)), other.min((0, 1)), atol=0.05)
        np.testing.assert_allclose(one.max((0, 1)), other.max((0, 1)), atol=0.05)


@pytest.mark.parametrize("fault", [ImportError("not here"), OSError("libGLU.so.1: not here")])
def test_shipped_fingers_need_no_gmsh_and_others_say_so(tmp_path, fault):
    (tmp_path / "gmsh.py").write_text(f"raise {fault!r}\n")
    write_mesh(tmp_path / "a.msh", SHIPPED["small"].mesh())
    code = (
        "from tactile_fem.study import Finger\n"
        "from tactile_fem.errors import MeshError\n"
        "Finger().mesh()\n"
        "Finger(pad_size_mm=3.0, far_size_mm=6.0).mesh()\n"
        "try:\n    Finger(dermis_mm=0.7).mesh()\n"
        "except MeshError as error:\n    print(error)\n"
        f"try:\n    Finger(mesh_file={str(tmp_path / 'a.msh')!r}).mesh()\n"
        "except MeshError as error:\n    print(error)\n"
    )
    path = os.pathsep.join([str(tmp_path), os.getcwd(), *sys.path])
    found = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    sentences = found.stdout.splitlines()
    assert len(sentences) == 2
    assert all("not here" in line and "pip install gmsh" in line for line in sentences)


def test_report(shipped, tmp_path):
    text = describe(shipped, FINGER)
    for word in ("stratum_corneum", "bone_surface", "tetrahedra", shipped.hash):
        assert word in text
    assert re.search(r"\ndermis +0\.800( +0\.[78]\d\d){3}\n", text)
    of_a_file = describe(shipped, Finger(mesh_file=tmp_path / "a.msh"))
    assert "study" not in of_a_file
    assert re.search(r"\ndermis( +0\.[78]\d\d){3}\n", of_a_file)
    assert f"contact point {shipped.pad_thickness_mm:.3f} mm" in of_a_file

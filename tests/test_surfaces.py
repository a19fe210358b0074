"""Fields on surfaces: exact where the deformation is affine, and forces that add up."""

import csv

import meshio
import numpy as np
import pytest
from needs import needs_gmsh, needs_graphics
from scipy.spatial import cKDTree

from tactile_fem.errors import StudyError
from tactile_fem.finger.files import read_mesh
from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.output.maps import faces_down, surface_map
from tactile_fem.results.contact_fields import Contact, SkinContact, vertex_areas
from tactile_fem.results.fields import FieldState, FieldWriter
from tactile_fem.results.surfaces import interface_of, skin_of
from tactile_fem.study import Finger

F = np.array([[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.05, 0.0, 1.2]])
STRETCHES = np.sqrt(np.linalg.eigvalsh(F.T @ F))


@pytest.fixture(scope="module", params=["solid", pytest.param("section", marks=needs_gmsh)])
def finger(request, small_finger):
    if request.param == "solid":
        return read_mesh(small_finger)
    return Finger(kind="section", pad_size_mm=2.0, far_size_mm=5.0).mesh()


@pytest.fixture(scope="module")
def state(finger, tmp_path_factory):
    """An affine deformation, with fields that are constant in each tissue, as a scan writes it."""
    gradient = F.copy()
    gradient[finger.plane.outside] = np.eye(3)[finger.plane.outside]
    gradient[:, finger.plane.outside] = np.eye(3)[:, finger.plane.outside]
    folder = tmp_path_factory.mktemp("fields")
    writer = FieldWriter(folder, finger.nodes, finger.cells, finger.tissue)
    moved = finger.nodes @ (gradient - np.eye(3)).T
    contact = SkinContact(finger)
    none = np.zeros_like(moved)
    of_nodes = {
        "displacement_mm": moved,
        **contact.fields(moved, none, none, none),
        "skin": contact.on_skin.astype(np.int8),
    }
    stress = finger.tissue[:, None] * np.arange(1.0, 7.0)
    path = writer.write(0.1, of_nodes, {"sed_kPa": 10.0 * finger.tissue, "stress_kPa": stress})
    return FieldState.read(path), np.sqrt(np.linalg.eigvalsh(gradient.T @ gradient))


def test_the_skin_is_that_of_the_mesh_and_its_fields_are_exact(finger, state):
    kept, stretches = state
    skin = skin_of(kept, 0.1, 2.0)
    corners = finger.corners_of("skin")
    apart, nearest = cKDTree(corners.mean(axis=1)).query(skin.points_mm[skin.facets].mean(axis=1))
    assert sorted(nearest) == list(range(len(corners)))
    assert apart.max() < 1e-5
    np.testing.assert_allclose(skin.stretches, np.tile(stretches, (len(skin), 1)), rtol=2e-4)
    tissue = np.median(skin.sed_kPa) / 10
    np.testing.assert_allclose(
        skin.stress_kPa, tissue * np.tile(np.arange(1.0, 7.0), (len(skin), 1))
    )
    deformed = skin.points_mm + skin.displacement_mm
    np.testing.assert_allclose(vertex_areas(deformed, skin.facets), skin.area_mm2, rtol=1e-6)
    assert (skin.at_mm, skin.time_s) == (2.0, 0.1)
    with pytest.raises(AttributeError, match="the surface has no heat, only displacement_mm"):
        _ = skin.heat


@pytest.mark.parametrize(
    ("side", "other", "tag"), [("epidermis", "dermis", 2), ("dermis", "epidermis", 3)]
)
def test_an_interface_has_the_fields_of_its_side(finger, state, side, other, tag):
    interface = interface_of(state[0], 0.1, 2.0, side, other)
    np.testing.assert_allclose(interface.sed_kPa, 10.0 * tag)
    np.testing.assert_allclose(interface.stretches[:, 0], state[1][0], rtol=2e-4)
    assert len(interface.facets) == np.sum(finger.surface == SURFACES["interface"])
    assert "contact" not in interface.columns


def test_tissues_that_do_not_meet_and_old_files_are_refused(state):
    with pytest.raises(StudyError, match="bone and stratum_corneum do not meet"):
        interface_of(state[0], 0.0, 0.0, "bone", "stratum_corneum")
    with pytest.raises(StudyError, match="fat is no tissue: choose among stratum_corneum, epid"):
        interface_of(state[0], 0.0, 0.0, "fat", "dermis")
    old = FieldState(**{**vars(state[0]), "of_nodes": {"displacement_mm": np.zeros((1, 3))}})
    with pytest.raises(StudyError, match="have no contact pressure"):
        skin_of(old, 0.0, 0.0)


def test_a_constant_traction_is_recovered_and_forces_add_up(finger):
    """The forces are those of a constant traction at quadratic nodes of straight facets."""
    shape, skin = finger.simplex, finger.facets[finger.surface == SURFACES["skin"]]
    still = np.zeros_like(finger.nodes)
    sizes = [vertex_areas(finger.nodes, facet[None, : shape.dim]).sum() for facet in skin]
    shares = {3: [0, 0, 0, 1 / 3, 1 / 3, 1 / 3], 2: [1 / 6, 1 / 6, 2 / 3]}[shape.dim]
    traction = np.array([3e-3, 0.0, -4e-3])
    force = still.copy()
    for facet, size in zip(skin, sizes, strict=True):
        force[facet] += size * np.outer(shares, traction)
    contact = SkinContact(finger)
    fields = contact.fields(still, force, -0.1 * force, 0.3 * force)
    on_skin = contact.on_skin
    np.testing.assert_allclose(fields["contact_pressure_kPa"][on_skin], 5.0, rtol=1e-9)
    np.testing.assert_allclose(
        fields["friction_kPa"][on_skin], np.tile([-0.3, 0, 0.4], (on_skin.sum(), 1)), atol=1e-9
    )
    assert set(fields["contact"][on_skin]) == {Contact.STICKS}
    assert not fields["contact"][~on_skin].any()
    assert not fields["contact_pressure_kPa"][~on_skin].any()

    any_force = np.random.default_rng(1).normal(size=force.shape) * on_skin[:, None]
    moved = 0.1 * np.sin(finger.nodes)
    fields = contact.fields(moved, 10 * force, any_force, force)
    area = vertex_areas(finger.nodes + moved, skin[:, : shape.dim])
    total = (fields["friction_kPa"] * area[:, None]).sum(axis=0) / 1000
    np.testing.assert_allclose(total, any_force.sum(axis=0), rtol=1e-9)


def test_skin_slips_where_friction_is_at_its_bound(finger):
    force = np.zeros_like(finger.nodes)
    contact = SkinContact(finger)
    force[contact.on_skin, 2] = 1.0
    aside = force[:, [2, 1, 0]]
    for share, expected in ((0.2, Contact.STICKS), (0.3, Contact.SLIPS)):
        fields = contact.fields(0 * force, force, share * aside, 0.3 * force)
        assert set(fields["contact"][contact.on_skin]) == {expected}
    frictionless = contact.fields(0 * force, force, 0 * force, 0 * force)
    assert set(frictionless["contact"][contact.on_skin]) == {Contact.SLIPS}


def test_a_surface_is_saved_as_table_arrays_and_mesh(state, tmp_path):
    skin = skin_of(state[0], 0.1, 2.0)
    for ending in ("csv", "npz", "vtu"):
        skin.save(tmp_path / f"skin.{ending}")
    with (tmp_path / "skin.csv").open(newline="") as stream:
        head, *rows = csv.reader(stream)
    assert head[:4] == ["x_mm", "y_mm", "z_mm", "displacement_x_mm"]
    assert {"contact_pressure_kPa", "friction_z_kPa", "stretches_3", "stress_xz_kPa"} <= {*head}
    np.testing.assert_allclose(np.array(rows, dtype=float)[:, :3], skin.points_mm, atol=1e-5)
    with np.load(tmp_path / "skin.npz") as saved:
        np.testing.assert_array_equal(saved["stretches"], skin.stretches)
        assert saved["at_mm"] == 2.0
    mesh = meshio.read(tmp_path / "skin.vtu")
    np.testing.assert_array_equal(mesh.cells[0].data, skin.facets)
    np.testing.assert_allclose(mesh.point_data["sed_kPa"], skin.sed_kPa)
    with pytest.raises(StudyError, match=r"skin.txt must end in .csv, .npz, .vtu"):
        skin.save(tmp_path / "skin.txt")


@needs_graphics
def test_a_surface_is_a_deformed_mesh_in_pyvista(finger, state):
    skin = skin_of(state[0], 0.1, 2.0)
    mesh = skin.to_pyvista()
    np.testing.assert_allclose(mesh.points, skin.points_mm + skin.displacement_mm, atol=1e-5)
    assert mesh.n_cells == len(skin.facets)
    np.testing.assert_array_equal(mesh["stretches"], skin.stretches)


def test_a_map_shows_the_side_that_faces_the_stimulator(finger, state):
    skin = skin_of(state[0], 0.1, 2.0)
    figure = surface_map(skin, "stress_xx_kPa")
    axes = figure.axes[0]
    assert axes.get_title() == "100 ms, displacement 2.00 mm"
    if finger.plane.is_space:
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("Y (mm)", "X (mm)")
        assert axes.child_axes[0].get_ylabel() == "Stress xx (kPa)"
        drawn = skin.facets[faces_down(skin)]
        assert 0 < len(drawn) < len(skin.facets)
        assert set(np.flatnonzero(skin.points_mm[:, 2] < 4.0)) <= set(drawn.ravel())
        ends = skin.points_mm[np.unique(drawn)][:, [1, 0]]
        filled = axes.collections[0].get_datalim(axes.transData)
        assert np.ravel([ends.min(axis=0), ends.max(axis=0)]) == pytest.approx(filled.extents)
    else:
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("Y (mm)", "Stress xx (kPa)")
    with pytest.raises(StudyError, match="heat is no column of the surface: choose x_mm, y_mm"):
        surface_map(skin, "heat")

"""A section of the finger: its mesh, what cuts it, its receptors, and its scan."""

from __future__ import annotations

import numpy as np
import pytest
from needs import needs_gmsh
from synthetic import make_results

from tactile_fem.errors import MeshError, StudyError
from tactile_fem.finger import SURFACES, TISSUES, describe, read_mesh, write_mesh
from tactile_fem.finger.layers import Ridges
from tactile_fem.finger.mesh_data import edges_per_ridge
from tactile_fem.finger.plane import Plane
from tactile_fem.finger.simplex import volumes
from tactile_fem.receptors import place
from tactile_fem.series import numbers_of
from tactile_fem.simulation.checks import check
from tactile_fem.stimulus.body import Ball, Cut, Moved
from tactile_fem.study import Finger, Grating, Plate, Protocol, Receptors, Solver, Study, Text

RIDGED = Finger(kind="section", ridge_height_mm=0.1, papilla_depth_mm=0.2)
SMOOTH = Finger(kind="section")


@pytest.fixture(scope="module")
def sagittal():
    return SMOOTH.mesh()


@pytest.fixture(scope="module")
def ridged():
    return RIDGED.mesh()


@needs_gmsh
def test_a_section_across_has_the_areas_of_its_ellipses():
    mesh = Finger(kind="section", plane="transverse", pad_size_mm=0.1, far_size_mm=0.2).mesh()
    area = volumes(mesh.plane.within(mesh.nodes), mesh.cells)
    assert area.min() > 0 and mesh.plane == Plane((0, 2))
    ellipses = (
        np.pi / 2 * SMOOTH.half_width_mm * (SMOOTH.palmar_height_mm + SMOOTH.dorsal_height_mm)
    )
    assert area.sum() == pytest.approx(ellipses, rel=1e-3)
    bone = np.pi * SMOOTH.bone_half_width_mm * SMOOTH.bone_half_height_mm
    assert area[mesh.tissue == TISSUES["bone"]].sum() == pytest.approx(bone, rel=0.03)


@needs_gmsh
def test_a_section_across_from_a_file_is_checked_in_its_own_plane(tmp_path):
    own = Finger(kind="section", plane="transverse", pad_size_mm=0.6, far_size_mm=3.0)
    write_mesh(tmp_path / "across.msh", own.mesh())
    protocol = Protocol(path=({"kind": "press", "force_N": 0.02},))
    across = Finger(kind="section", mesh_file=tmp_path / "across.msh")
    study = Study(finger=across, stimulus=Plate())
    with pytest.raises(StudyError, match="leaves the section's plane, Y"):
        check(study)
    check(study.model_copy(update={"protocol": protocol}))


@needs_gmsh
def test_a_section_is_written_and_read(sagittal, tmp_path):
    write_mesh(tmp_path / "section.msh", sagittal)
    assert read_mesh(tmp_path / "section.msh").hash == sagittal.hash
    found = Finger(kind="section", mesh_file=tmp_path / "section.msh").mesh()
    assert found.hash == sagittal.hash
    with pytest.raises(MeshError, match=r'finger\.kind is "solid" but must be "section"'):
        Finger(mesh_file=tmp_path / "section.msh").mesh()


@needs_gmsh
def test_ridges_have_their_pitch_and_height(ridged):
    skin = ridged.nodes[np.unique(ridged.facets[ridged.surface == SURFACES["skin"]])]
    near = skin[np.abs(skin[:, 1]) < 1.2 * RIDGED.ridge_pitch_mm]
    crest = near[np.abs(near[:, 1]) < 0.02, 2].min()
    groove = near[np.abs(np.abs(near[:, 1]) - RIDGED.ridge_pitch_mm / 2) < 0.02, 2]
    assert crest == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(groove, 0.1, atol=0.01)


@needs_gmsh
def test_how_well_the_mesh_resolves_ridges_is_told(ridged, sagittal):
    assert edges_per_ridge(sagittal, SMOOTH) is None
    assert edges_per_ridge(ridged, RIDGED) == pytest.approx(8.0, rel=0.1)
    assert f"{edges_per_ridge(ridged, RIDGED):.1f} edges to a ridge" in describe(ridged, RIDGED)
    assert "edges to a ridge" not in describe(sagittal, SMOOTH)


def test_a_section_has_defaults_of_its_own():
    own = Study.model_validate({"finger": {"kind": "section"}, "protocol": {"distance_mm": 1.0}})
    assert own.protocol.force_N == 0.06 and own.protocol.distance_mm == 1.0
    assert own.solver.linear == Study(finger=SMOOTH).solver.linear == "multigrid"
    assert Study(finger=RIDGED).solver.linear == "direct"
    chosen = Study(
        finger=RIDGED, protocol=Protocol(depth_mm=1.0), solver=Solver(linear="multigrid")
    )
    assert chosen.protocol.depth_mm == 1.0 and chosen.protocol.force_N is None
    assert chosen.solver.linear == "multigrid"
    assert Study.model_validate(own.model_dump()) == own


def test_a_series_names_forces_per_width(tmp_path):
    names = {"pressed", "normal", "tangential"}
    solid = numbers_of(make_results(tmp_path / "solid"))
    section = numbers_of(make_results(tmp_path / "section", Study(finger=SMOOTH)))
    assert {f"{name}_N" for name in names} <= solid.keys()
    assert {key for key in section if "_N" in key} == {f"{name}_N_per_mm" for name in names}


def test_a_papilla_is_as_wide_as_it_should_at_half_its_height():
    ridges = Ridges(Finger(kind="section", papilla_depth_mm=0.2, papilla_width_mm=0.1))
    middle, half = ridges.finger.ridge_pitch_mm / 4, 0.05
    s = np.array([0.0, middle, middle - half, middle + half])
    np.testing.assert_allclose(ridges.interface(s), [0.1, -0.1, 0.0, 0.0], atol=1e-12)


@needs_gmsh
@pytest.mark.parametrize(("placement", "per_pitch"), [("papillae", 2), ("intermediate_ridges", 1)])
def test_receptors_lie_at_the_tips(ridged, placement, per_pitch):
    places = place(Receptors(placement=placement, half_length_mm=3.0), ridged)
    # Along the skin; below it the pad's curve of 29 mm makes them closer by a few percent.
    apart = np.linalg.norm(np.diff(places[np.abs(places[:, 1]) < 1.5], axis=0), axis=1).mean()
    assert apart == pytest.approx(RIDGED.ridge_pitch_mm / per_pitch, rel=0.04)
    mean = RIDGED.stratum_corneum_mm + RIDGED.epidermis_mm
    below = places[np.abs(places[:, 1]) < 1.0, 2] - mean
    assert np.all(below < -0.05) if per_pitch == 2 else np.all(below > 0.05)


@needs_gmsh
def test_tips_need_papillae(sagittal):
    with pytest.raises(StudyError, match="papilla_depth_mm"):
        place(Receptors(placement="papillae"), sagittal)


def test_a_cut_body_has_the_body_s_contour_and_slopes():
    beside = Moved(Ball(2.0), (1.0, 0.0))
    cut, step = Cut(beside, Plane((1, 2))), 1e-6
    radius = np.sqrt(2.0**2 - 1.0**2)
    angle = np.linspace(0, np.pi, 7)
    circle = np.column_stack([radius * np.cos(angle), radius * np.sin(angle) - 2.0])
    found = cut.distance(circle)
    np.testing.assert_allclose(found.gap, 0.0, atol=1e-12)
    for axis in range(2):
        ahead = cut.distance(circle + step * np.eye(2)[axis])
        np.testing.assert_allclose((ahead.gap - found.gap) / step, found.normal[:, axis], atol=1e-5)
        slope = (ahead.normal - found.normal) / step
        np.testing.assert_allclose(slope, found.hessian[:, :, axis], atol=1e-5)


@pytest.mark.parametrize(
    ("study", "says"),
    [
        (Study(finger=Finger(kind="section", ridge_height_mm=0.2)), "ridge_height_mm = 0.2"),
        (
            Study(finger=Finger(kind="section", ridge_height_mm=0.1, pad_size_mm=0.2)),
            "ridge_pitch_mm = 0.47 must be at least 4 times the edge",
        ),
        (Study(finger=Finger(kind="section", plane="transverse")), "leaves the section's plane, Y"),
        (
            Study(finger=SMOOTH, stimulus=Text(shift_mm=(30.0, 0.0))),
            "cuts none of its raised parts",
        ),
    ],
)
def test_what_does_not_fit_a_section_is_told_at_once(study, says):
    with pytest.raises((StudyError, MeshError), match=says):
        check(study)


@needs_gmsh
@pytest.mark.ranks
def test_a_section_is_scanned(tmp_path):
    from mpi4py import MPI

    from tactile_fem.simulation.run import scan

    study = Study(
        finger=Finger(kind="section", pad_size_mm=0.6, far_size_mm=3.0),
        stimulus=Grating(ridge_mm=1.0, groove_mm=1.0, along="x", start_mm=-10.0),
        protocol=Protocol(force_N=0.02, distance_mm=0.4),
    )
    found = scan(study, comm=MPI.COMM_SELF).trace
    assert found.force_N[-1][0] == 0.0 and found.force_N[-1][2] > 0.015
    assert np.all(found.stimulator_mm[-1] == [0.0, pytest.approx(-0.4), found.depth_mm[-1]])
    assert np.ptp(found.receptors_mm[:, 1]) == pytest.approx(8.0)
    shared = scan(study).trace
    np.testing.assert_allclose(shared.force_N[-1], found.force_N[-1], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(shared.sed_kPa[-1], found.sed_kPa[-1], rtol=1e-5)

"""Raw curves of a test rig: whatever wrote them, they become points of a press."""

import numpy as np
import pytest

from tactile_fem.calibration.curves import curve_of, points_of
from tactile_fem.calibration.measurements import Experiment, read_measurements
from tactile_fem.errors import StudyError
from tactile_fem.study import Sphere

FILES = {
    "plain": "depth_mm,force_N\n0.5,0.02\n1.0,0.1\n1.5,0.3\n",
    "no names": "0.5 0.02\n1.0 0.1\n1.5 0.3\n",
    "NumPy's": "# depth_mm force_N\n0.5 0.02\n1.0 0.1\n1.5 0.3\n",
    "others besides": "t (s);Fx (mN);Fz (mN);Displacement (µm)\n"
    "0;9;20;500\n1;9;100;1000\n2;9;300;1500\n",
    "units below": 'Sample: "left 2"\nForce,Depth\n(cN),(um)\n2,500\n10,1000\n30,1500\n',
    "commas": "Indentation [mm]\tNormal force [N]\n0,5\t0,02\n1,0\t0,1\n1,5\t0,3\n",
    "gaps": "depth_mm,force_N\n0.5,0.02\n0.7,nan\n1.0,0.1\n1.5,0.3\n",
    "goes out": "depth_mm,force_N\n0.5,0.02\n1.0,0.1\n1.5,0.3\n1.5,0.2\n1.0,0.05\n0.5,0.0\n",
}


@pytest.mark.parametrize("name", FILES)
def test_columns_are_found_with_their_units(name, tmp_path):
    file = tmp_path / "f.csv"
    file.write_bytes(FILES[name].encode("cp1252"))
    expected = [[0.5, 0.02], [1.0, 0.1], [1.5, 0.3]]
    np.testing.assert_allclose(curve_of(file)[0], expected, rtol=1e-12)


def test_a_standard_deviation_of_the_file_is_taken(tmp_path):
    file = tmp_path / "f.csv"
    file.write_text("depth_mm,force_N,sd_N\n0.5,0.02,0.01\n1.0,0.1,0.02\n1.5,0.3,0.03\n")
    (found,) = read_measurements([file], indenters=["plate"], speed_mm_s=0.5)
    np.testing.assert_allclose(found.sd, [0.01, 0.02, 0.03])
    (given,) = read_measurements([file], indenters=["plate"], speed_mm_s=0.5, sd_N=0.05)
    np.testing.assert_allclose(given.sd, 0.05)


def test_many_rows_in_any_order_become_some_points():
    rng = np.random.default_rng(0)
    depth = rng.permutation(np.linspace(-0.3, 1.5, 700))
    force = np.where(depth > 0, 0.3 * depth**2, 0.0)
    found = Experiment.of_curve(Sphere(radius_mm=2.0), 0.5, depth, force)
    assert found.is_force.all() and len(found.mean) == 12
    np.testing.assert_allclose(found.mean, 0.3 * found.depth_mm**2, atol=1e-3)
    np.testing.assert_allclose(found.sd, 0.05 * found.mean + 0.01 * found.mean.max(), rtol=0.05)
    assert "583 of 700 rows are deeper than 0, averaged to 12 points; sd not" in found.origin


def test_scatter_counts_by_the_error_of_the_mean():
    rng = np.random.default_rng(1)
    depth = np.linspace(0.001, 1.0, 1200)
    noisy = points_of(depth, depth + rng.normal(scale=0.5, size=1200), None, "it")
    default = 0.05 * np.abs(noisy.force_N) + 0.01 * noisy.force_N.max()
    np.testing.assert_allclose(np.sqrt(noisy.sd_N**2 - default**2), 0.05, rtol=0.25)


def test_curves_of_equal_presses_are_one(tmp_path):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(FILES["plain"])
    files = [tmp_path / "a.csv", tmp_path / "b.csv"]
    (both,) = read_measurements(files, indenters=["sphere  radius_mm=2"], speed_mm_s=1.0)
    assert both.name == "sphere radius_mm=2 at 1 mm/s" and len(both.rows) == 6
    two = read_measurements(files, indenters=["plate", "sphere"], speed_mm_s=1.0)
    assert [one.indenter.kind for one in two] == ["plate", "sphere"]


# --- which columns, in which units ---------------------------------------------------------------

DEPTH = np.linspace(0.02, 1.5, 61)
FORCE = 0.095 * DEPTH**2.25
# Besides columns D and F, of depth and force, those that could be taken for them.
COLUMNS = [
    ("depth_rate_mm_s,D,F", "depth_mm", "force_N"),
    ("D,force setpoint (N),F", "depth (mm)", "force (N)"),
    ("F,force limit (N),target depth (mm),D,depth offset (mm)", "Depth [mm]", "Force [N]"),
    ("targetDepth_mm,ForceSetpoint_N,D,F", "depth_mm", "forceN"),
    ("Speed (mm/s),D,dF/dt (N/s),stiffness N/mm,F", "z (mm)", "Load (N)"),
    ("Position X (mm),D,Force Y (N),F", "Position Z (mm)", "Force Z (N)"),
    ("Fx (N),Fy (N),F,D,Position (mm)", "Depth in mm", "Fz (N)"),
    ("demand_depth_mm,D,depth_error_mm,max_force_N,F", "DEPTH_MM", "FORCE_N"),
    ("Time s,D,F,load cell temperature (C)", "Displacement/mm", "Load cell (N)"),
]


def curve_file(folder, names, depth=DEPTH, force=FORCE):
    """Write a curve below a line of names, of which D and F are those of depth and force."""
    head, d, f = names
    cells = [{"D": depth, "F": force}.get(name, 0.5 + 0 * depth) for name in head.split(",")]
    head = ",".join({"D": d, "F": f}.get(name, name) for name in head.split(","))
    np.savetxt(folder / "c.csv", np.column_stack(cells), "%.10g", ",", header=head, comments="")
    return folder / "c.csv"


@pytest.mark.parametrize("names", COLUMNS, ids=[names[0] for names in COLUMNS])
def test_the_columns_are_the_quantities_themselves(names, tmp_path, caplog):
    caplog.set_level("INFO")
    file = curve_file(tmp_path, names)
    np.testing.assert_allclose(curve_of(file)[0], np.column_stack([DEPTH, FORCE]), rtol=1e-6)
    assert f'depth from "{names[1]}" (mm), force from "{names[2]}" (N)' in caplog.text
    (found,) = read_measurements([file], indenters=["plate"], speed_mm_s=0.5)
    assert f'depth from "{names[1]}"' in found.origin


UNITS = [
    ("Depth (um)", 1e-3, "Force (MN)", 1e6),
    ("Depth (\u03bcm)", 1e-3, "Force (mN)", 1e-3),
    ("depth inch", 25.4, "force_lbf", 4.4482216152605),
    ("Depth [in]", 25.4, "Load [g]", 9.80665e-3),
    ("depth_mil", 0.0254, "Force kgf", 9.80665),
    ("Depth/cm", 10.0, "Force/cN", 0.01),
    ("DEPTH (M)", 1e3, "FORCE (KN)", 1e3),
    ("z in um", 1e-3, "Fz <oz>", 0.27801385095378125),
    ("depth_microns", 1e-3, "force_mn", 1e-3),
    ("Depth (mm)", 1.0, "Force (dyn)", 1e-5),
]


@pytest.mark.parametrize(("d", "mm", "f", "N"), UNITS)
def test_the_units_of_a_laboratory(d, mm, f, N, tmp_path):
    file = curve_file(tmp_path, ("D,F", d, f), DEPTH / mm, FORCE / N)
    np.testing.assert_allclose(curve_of(file)[0], np.column_stack([DEPTH, FORCE]), rtol=1e-6)


REFUSED = [
    (("force 1 (N),F,D", "depth_mm", "Force 2 (N)"), '"force 1 (N)" and "Force 2 (N)" fit equally'),
    (("depth_um,D,F", "depth_mm", "force_N"), '"depth_um" and "depth_mm" fit equally'),
    (("D,F", "depth_mm", "Force (kip)"), 'the unit of column "Force (kip)" must be one of N, mN'),
    (("D,F", "depth_mm", "force_V"), 'the unit of column "force_V" must be one of N,'),
    (("D,F", "depth_ft", "force_N"), 'the unit of column "depth_ft" must be one of mm, um'),
    (("D,F", "depth_mm", "force setpoint (N)"), "its columns are depth_mm, force setpoint (N) but"),
    (("D,F", "Time (s)", "Force (N)"), "its columns are Time (s), Force (N) but must be depth_mm"),
    (("D,F", "force_N,depth_mm", "left"), "its columns are force_N,depth_mm,left but must be"),
]


@pytest.mark.parametrize(("names", "sentence"), REFUSED)
def test_columns_that_cannot_be_told_are_named(names, sentence, tmp_path):
    with pytest.raises(StudyError) as error:
        curve_of(curve_file(tmp_path, names))
    assert sentence in str(error.value)


# --- first contact -------------------------------------------------------------------------------


def machine(contact, offset, *, back=False, noise=0.0, rows=61):
    """Return positions and forces of a machine that touches the finger at `contact`."""
    z = np.linspace(min(contact, 0.0) - 0.2, contact + 1.5, rows)
    z = np.concatenate([z, z[::-1]]) if back else z
    scatter = np.random.default_rng(0).normal(scale=noise, size=len(z)) if noise else 0.0
    return z, 0.095 * np.maximum(z - contact, 0) ** 2.25 + offset + scatter


MACHINES = [(1.0, 0.0), (0.2, 0.05), (-0.5, -2.0), (12.0, 0.013)]


@pytest.mark.parametrize(("contact", "offset"), MACHINES)
@pytest.mark.parametrize("back", [False, True], ids=["in", "in and out"])
def test_depths_count_from_first_contact(contact, offset, back, tmp_path, caplog):
    """Wherever the machine has its zeros: the points are those of a curve that was tared."""
    caplog.set_level("INFO")
    z, force = machine(contact, offset, back=back, rows=400)
    file = curve_file(tmp_path, ("F,D", "position_mm", "force_N"), z, force)
    (found,) = read_measurements([file], indenters=["plate"], speed_mm_s=0.5)
    assert len(found.mean) == 12 and found.depth_mm[-1] == pytest.approx(1.44, abs=0.02)
    np.testing.assert_allclose(found.mean, 0.095 * found.depth_mm**2.25, atol=1.5e-3)
    said = f"contact at {found.origin.split('contact at ')[1]}"
    assert float(said.split()[2]) == pytest.approx(contact, abs=0.01) and said in caplog.text
    if offset:
        assert float(said.split()[-2]) == pytest.approx(offset, abs=1e-3)
    if not back:
        of_arrays = Experiment.of_curve("plate", 0.5, z, force)
        np.testing.assert_allclose(of_arrays.mean, found.mean, rtol=1e-6)


def test_contact_is_found_in_noise():
    z, force = machine(1.0, 0.1, noise=1e-3, rows=300)
    found = Experiment.of_curve("plate", 0.5, z, force)
    assert found.depth_mm[-1] == pytest.approx(1.44, abs=0.1)
    assert (np.abs(found.mean - 0.095 * found.depth_mm**2.25) < 3 * found.sd).all()


@pytest.mark.parametrize("power", [1.0, 1.5, 2.25])
def test_a_curve_that_was_tared_stays_as_it_is(power):
    noise = np.random.default_rng(1)
    for _ in range(3):
        force = 0.095 * DEPTH**power * noise.normal(1.0, 0.03, 61) + noise.normal(0, 1e-3, 61)
        found = Experiment.of_curve("plate", 0.5, DEPTH, force)
        np.testing.assert_array_equal(found.rows, np.column_stack([DEPTH, force]))
        assert "contact" not in found.origin


NO_PRESS = [
    (
        1.5 - DEPTH,
        FORCE,
        "but must be above 0 and the largest; it is 0.237 N at the smallest, 0 mm",
    ),
    (-DEPTH, FORCE, "Depths must grow into the finger"),
    (DEPTH, 0.5 - FORCE, "the largest; it is 0.5 N at the smallest, 0.02 mm"),
    (DEPTH, -FORCE, "the force at the largest depth is -0.237 N but must be above 0"),
    (12.3 + DEPTH, FORCE, "depths begin at 12.5 mm, where the force is 0.00"),
    (12.5 + DEPTH[:4], FORCE[:4], "no press from first contact"),
    (DEPTH, 0.5 + 0 * FORCE, "the force is 0.5 N, and it grows to 0.5 N"),
    (DEPTH, 0 * FORCE, "the force at the largest depth is 0 N but must be above 0"),
    (0.5 + 0 * DEPTH, FORCE, "the depth does not change"),
    (DEPTH, 1e6 * FORCE, "not a finger's, at most 50 mm and 1000 N: check their units"),
    (1e3 * DEPTH, FORCE, "not a finger's, at most 50 mm"),
]


@pytest.mark.parametrize(("depth", "force", "sentence"), NO_PRESS)
def test_what_is_no_press_gets_one_sentence(depth, force, sentence, tmp_path):
    file = curve_file(tmp_path, ("D,F", "z_mm", "force_N"), depth, force)
    with pytest.raises(StudyError) as error:
        read_measurements([file], indenters=["plate"], speed_mm_s=0.5)
    assert sentence in str(error.value)
    with pytest.raises(StudyError, match="plate"):
        Experiment.of_curve("plate", 0.5, depth, force)


WRONG = [
    ("a,b\n1,2\n", {}, r"its columns are a, b but must be depth_mm and force_N, or those of a tab"),
    ("1,2,3\n", {}, "its columns are not named but must be depth_mm"),
    ("depth_mm,force_N\n", {}, "it has no rows of numbers"),
    (FILES["plain"], {"indenters": ()}, "is a raw curve: its indenter, such as plate or sphere"),
    (FILES["plain"], {"speed_mm_s": None}, "is a raw curve: its indenter"),
    (FILES["plain"], {"speed_mm_s": 0.0}, "speed is 0 mm/s but must be above 0"),
    (FILES["plain"], {"sd_N": -1.0}, "standard deviations of forces must be above 0"),
    (FILES["plain"], {"indenters": ["plate"] * 3}, "3 indenters are given for 1 raw curves"),
    (FILES["plain"], {"indenters": ["flat"]}, 'stimulus.kind is "flat"'),
    (FILES["plain"].replace("0.3", "-0.3"), {}, r"largest depth is -0\.3 N but must be above 0"),
    (FILES["plain"].replace("1.0", "-1"), {}, "the curve has 2 rows with a depth above 0"),
]


@pytest.mark.parametrize(("text", "keys", "sentence"), WRONG)
def test_a_curve_that_cannot_be_fitted_gets_one_sentence(text, keys, sentence, tmp_path):
    file = tmp_path / "f.csv"
    file.write_text(text)
    with pytest.raises(StudyError, match=sentence):
        read_measurements([file], **{"indenters": ["plate"], "speed_mm_s": 0.5, **keys})


def test_tables_take_no_indenter(tmp_path):
    file = tmp_path / "f.csv"
    file.write_text("indenter,speed_mm_s,depth_mm,force_N,sd_N\nplate,0.2,1,0.2,0.1\n")
    with pytest.raises(StudyError, match="indenter and sd must not be given: no file is a raw"):
        read_measurements([file], indenters=["plate"], sd_N=0.1)

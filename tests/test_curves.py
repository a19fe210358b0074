"""Raw curves of a test rig: whatever wrote them, they become points of a press."""

import numpy as np
import pytest

from tactile_fem.calibration.curves import points_of, read_curve
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
    np.testing.assert_allclose(read_curve(file), expected, rtol=1e-12)


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

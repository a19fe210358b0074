"""The variance of a surface by wavelength, and what a mesh can follow of it."""

import logging

import numpy as np
import pytest

from tactile_fem.simulation.checks import tell_resolution
from tactile_fem.stimulus.roughness import Roughness
from tactile_fem.stimulus.spline import GridSpline
from tactile_fem.study import Finger, Surface


def two_waves():
    x = 0.05 * (np.arange(200) + 0.5)[:, None]
    y = 0.04 * (np.arange(300) + 0.5)[None, :]
    return 0.03 * np.cos(2 * np.pi * x / 2.5) + 0.04 * np.cos(2 * np.pi * y / 0.5) + 7


def test_each_wave_has_its_variance():
    found = Roughness.of(GridSpline.through(two_waves(), [0, 0], [0.05, 0.04]))
    assert found.rms_mm == pytest.approx(np.sqrt((0.03**2 + 0.04**2) / 2), rel=0.01)
    for wavelength, share in [(20.0, 0.0), (1.0, 0.36), (0.6, 0.36), (0.4, 1.0), (0.1, 1.0)]:
        assert found.share(wavelength) == pytest.approx(share, abs=0.01)
    assert found.wavelength_of(0.3) == pytest.approx(2.5, rel=0.03)
    assert found.wavelength_of(0.9) == pytest.approx(0.5, rel=0.03)


def test_a_plane_is_followed_whole():
    found = Roughness.of(GridSpline.through(np.zeros((20, 20)), [0, 0], [0.1, 0.1]))
    assert found.rms_mm == 0 and found.share(5.0) == 1.0


def test_the_splines_values_are_those_it_went_through():
    values = np.random.default_rng(0).normal(size=(12, 15))
    for beyond in ("mirror", "grid-wrap"):
        spline = GridSpline.through(values, [0, 0], [1, 1], beyond)
        assert spline.values_on_grid() == pytest.approx(values)


def test_a_scan_says_what_the_mesh_can_follow(tmp_path, caplog):
    file = tmp_path / "waves.npy"
    np.save(file, two_waves())
    finger = Finger().mesh()
    edge = finger.facet_size_mm
    assert 0.85 < edge < 1.1  # the preset asks for 1 mm
    surface = Surface(file=file, spacing_mm=0.05, unit_mm=1.0, low_pass_mm=0.0)
    with caplog.at_level(logging.INFO):
        tell_resolution(surface, finger)
    assert "0.0354 mm rms" in caplog.text
    assert "coarse 36 %, medium 36 %, paper 36 %" in caplog.text
    assert "pad_size_mm = 0.3" in caplog.text

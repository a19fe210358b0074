"""The analytic finger: contours, normals, the bone's place, the rows of the layers."""

import numpy as np
import pytest

from tactile_fem.finger import TISSUES
from tactile_fem.finger.anatomy import depth_below
from tactile_fem.finger.layers import layering
from tactile_fem.finger.shape import bone_shape, skin_shape
from tactile_fem.study import Finger

FINGER = Finger()


@pytest.mark.parametrize("shape", [skin_shape(FINGER), bone_shape(FINGER, skin_shape(FINGER))])
def test_normals_are_the_gradient_of_the_level(shape):
    rng = np.random.default_rng(1)
    turn = rng.uniform(0, 2 * np.pi, 300)
    y = rng.uniform(shape.cut_y + 0.1, shape.tip_y - 0.1, 300)
    points, normals = shape.place(np.column_stack([np.cos(turn), y, np.sin(turn)]))
    assert np.abs(shape.level(points)).max() < 1e-12
    step = 1e-6 * np.eye(3)
    gradient = np.column_stack(
        [(shape.level(points + e) - shape.level(points - e)) / 2e-6 for e in step]
    )
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.abs(gradient - normals).max() < 1e-5
    assert np.all(shape.level(points - 0.05 * normals) < 0)


def contour(shape, y):
    zero = np.zeros_like(y)
    return shape.place(np.column_stack([zero, y, zero - 1.0]))[0][:, 2]


@pytest.mark.parametrize("pad_radius_mm", [FINGER.pad_radius_mm, 14.0])
def test_pad_curvature_at_the_contact_point_and_lift_off(pad_radius_mm):
    skin = skin_shape(Finger(pad_radius_mm=pad_radius_mm))
    step = 0.05
    low = contour(skin, np.array([-2 * step, -step, 0.0, step, 2 * step]))
    assert low[2] == 0.0 and low.min() == 0.0
    for a, b, c in (low[:3], low[1:4], low[2:]):  # proximal, centred, distal
        assert (a - 2 * b + c) / step**2 == pytest.approx(1 / pad_radius_mm, rel=0.01)
    x = np.array([0.0, 0.1])
    across, _ = skin.place(np.column_stack([x, 0 * x, -np.sqrt(1 - x**2)]))
    lateral = across[1, 0] ** 2 / (2 * across[1, 2])
    assert lateral == pytest.approx(FINGER.half_width_mm**2 / FINGER.palmar_height_mm, rel=0.01)
    assert contour(skin, np.array([skin.cut_y]))[0] > 3.5


@pytest.mark.parametrize("subcutaneous_mm", [FINGER.subcutaneous_mm, 0.7])
def test_the_bone_lies_above_the_pad(subcutaneous_mm):
    finger = Finger(subcutaneous_mm=subcutaneous_mm)
    skin = skin_shape(finger)
    under, _ = bone_shape(finger, skin).place(np.array([[0.0, 0.0, -1.0]]))
    assert under[0] == pytest.approx([0.0, 0.0, 1.62 + subcutaneous_mm], abs=1e-12)
    assert depth_below(skin, under)[0] == pytest.approx(finger.pad_thickness_mm, abs=0.02)


@pytest.mark.parametrize(("rows", "found"), [(1, 2), (2, 2), (3, 4), (4, 4)])
def test_rows_have_the_layers_and_the_nail_as_limits(rows, found):
    layers = layering(FINGER, rows)
    for depth in (0.0, 0.17, 0.5, 0.82, 1.62):
        assert np.abs(layers.depths - depth).min() < 1e-12
    assert np.sum(layers.tissue == TISSUES["epidermis"]) == found
    assert layers.depths[layers.nail_rows] == pytest.approx(FINGER.nail_thickness_mm)

"""The joint of the bone: its settings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_fem.errors import StudyError
from tactile_fem.study import Joint, Study
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.template import commented_template


def test_arms_are_those_of_the_moment():
    joint, rng = Joint(length_mm=20.0, height_mm=5.0), np.random.default_rng(0)
    places, forces = rng.normal(size=(2, 7, 3))
    moment = np.cross(places - joint.centre_mm, forces).sum(0)[0]
    np.testing.assert_allclose(np.sum(joint.arms(places) * forces), moment)


def test_the_default_is_a_fifth_of_a_newton_per_mm_at_the_pad_and_70_Hz():
    joint = Joint()
    up = joint.arms(np.zeros(3))[2]
    assert joint.stiffness_Nmm_rad / up**2 == pytest.approx(0.192)
    resonance = math.sqrt(joint.stiffness_Nmm_rad / joint.inertia_Nmms2) / (2 * math.pi)
    assert resonance == pytest.approx(69.7, abs=0.1)
    loss = joint.moment_per_angle(100.0).imag
    assert loss == pytest.approx(200 * math.pi * joint.damping_Nmms_rad)


def test_a_study_has_a_joint_only_where_it_is_given(tmp_path):
    assert Study().joint is None and "joint" not in dump_study(Study())
    file = tmp_path / "study.toml"
    file.write_text("[joint]\n")
    assert load_study(file).joint == Joint()
    file.write_text(dump_study(load_study(file, ["joint.damping_Nmms_rad=0"])))
    assert load_study(file).joint == Joint(damping_Nmms_rad=0.0)
    assert "[joint]: hinge" in commented_template()


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["joint.stiffness_Nmm_rad=0"], "joint.stiffness_Nmm_rad is 0 but must be greater than 0."),
        (["joint.mass_g=2", "finger.kind=section"], 'finger.kind is "section" but must be "solid"'),
    ],
)
def test_what_is_wrong_with_a_joint_is_said(overrides, message):
    with pytest.raises(StudyError, match=message.replace("[", r"\[")):
        load_study(None, overrides)

"""Demos of letters under many fingers and fingers of three ages: what they compute, small scans."""

from __future__ import annotations

import re

import numpy as np
import pytest
from ages import CHILD, FINGERS, aged
from needs import needs_gmsh
from people_letters import FRICTION, LETTERS, alike, base, conditions, is_pass, read, sparse
from scripts import number, run

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response
from tactile_fem.series import RateImage

# Coarse, shallow, short: all letters are flat in it but have firing.
QUICK = ["finger.pad_size_mm=3", "finger.far_size_mm=6", "protocol.depth_mm=0.4"]
QUICK += ["protocol.distance_mm=2", "protocol.output_mm=1", "neuron.threshold_mV=1"]


def images(seed: int, people: int = 4) -> np.ndarray:
    """Return images of letters, alike in all people but for their scale; two nearly the same."""
    rng = np.random.default_rng(seed)
    letters = rng.random((len(LETTERS), 12, 30))
    letters[1] = letters[0] + 1e-3 * letters[1]
    return letters * (1 + np.arange(people))[:, None, None, None]


def test_letters_that_are_nearly_the_same_are_taken_for_one_another():
    shares = read(images(0), noise_Hz=0.2)
    assert shares.sum(axis=2) == pytest.approx(np.ones(shares.shape[:2]))
    assert shares[:, :2, :2].sum(axis=2) == pytest.approx(np.ones((4, 2)))
    assert np.einsum("kii->ki", shares)[:, 2:] == pytest.approx(1)
    assert 0.3 < shares[3, 0, 0] < 0.7
    r = alike(images(0))
    assert r[:, 0, 1] == pytest.approx(1, abs=1e-4) and r[:, 0, 2:].max() < 0.5


def test_a_reader_knows_letters_of_other_people_only():
    """Of two people with exchanged letters each is read as the other one."""
    mine = images(0, 1)[0]
    swapped = mine[[0, 1, 3, 2, 4]]
    shares = read(np.array([mine, swapped]), noise_Hz=0.0)
    assert shares[:, 2, 3].tolist() == shares[:, 3, 2].tolist() == [1, 1]
    with pytest.raises(StudyError, match="two people or more"):
        read(mine[None])


def test_both_images_of_the_G_have_the_same_rows():
    each = conditions(base())
    shifts = sorted(one.study.stimulus.shift_mm[0] for one in each if is_pass(one.name))
    places = base().receptors
    across = np.arange(-places.half_width_mm, places.half_width_mm + 0.1, places.spacing_mm)
    image = RateImage(across, np.arange(3.0), np.outer(across, np.ones(3)), Response([], 0.0, 1.0))
    assert sparse(image).across_mm == pytest.approx(shifts)
    assert sparse(image).rate_Hz[:, 0] == pytest.approx(shifts)
    found = {one.name: one.study.stimulus.friction for one in each if one.name in FRICTION}
    assert found == FRICTION


def test_fingers_of_three_ages():
    adult, child = (aged(base(), FINGERS[name]).finger for name in ("adult", "child"))
    assert child.half_width_mm == pytest.approx(CHILD["finger.size"] * adult.half_width_mm)
    assert child.epidermis_mm == pytest.approx(adult.epidermis_mm)
    assert child.dermis_mm == pytest.approx(0.85 * adult.dermis_mm)
    old, stiff = (aged(base(), FINGERS[name]) for name in ("old", "old-stiff"))
    assert old.stimulus.friction == pytest.approx(0.225)
    assert old.finger == stiff.finger
    assert stiff.tissue.dermis.C10_MPa == pytest.approx(1.3 * old.tissue.dermis.C10_MPa)


@pytest.mark.slow
@needs_gmsh
def test_letters_of_people_and_of_ages(tmp_path):
    output = run("validation/people_letters.py", str(tmp_path), *QUICK, "--number", "2")
    assert len(re.findall(r"^\| (?:0|0\.3|1) \|", output, re.M)) == 3 * 6
    assert 0 <= number(r"known without noise: (\d+) %", output) <= 100
    assert (tmp_path / "people_letters.png").stat().st_size > 10_000
    way = ["--people", str(tmp_path), "--letters", "GC"]
    output = run("validation/ages.py", str(tmp_path / "ages"), *QUICK, *way)
    assert (
        "adults: 33 % of people" in output and (tmp_path / "ages/ages.png").stat().st_size > 10_000
    )

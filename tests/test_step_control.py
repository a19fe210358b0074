"""Step control needs no finite element."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_fem.simulation.control import StepControl


def walk(control: StepControl, iterations=lambda time: 4):
    times = []
    while not control.finished:
        target = control.target_s
        control.accept(target, iterations(target))
        times.append(target)
    return times


def test_hits_every_output_exactly_with_steps_within_bounds():
    outputs = tuple(0.3 * np.arange(1, 8))
    times = walk(StepControl(2.0, 0.01, 1e-3, lambda time: 0.25, outputs))
    assert set(outputs[:-1]) <= set(times)
    assert times[-1] == 2.0
    steps = np.diff([0.0, *times])
    assert steps.min() > 0
    assert steps.max() <= 0.25 + 1e-12


def test_a_bound_that_changes_along_the_piece_is_kept_to():
    times = walk(StepControl(2.0, 0.5, 1e-3, lambda time: 0.1 if time < 1.0 else 0.4))
    steps = np.diff([0.0, *times])
    before = np.array(times) - steps < 1.0 - 1e-9
    assert steps[before].max() <= 0.1 + 1e-12
    assert 0.1 < steps[~before].max() <= 0.4 + 1e-12


def test_brief_and_long_pieces_are_stepped_alike():
    of_a_second = np.array(walk(StepControl(1.0, 0.01, 1e-4, outputs_s=(0.3, 0.6))))
    for lasts in (1e-6, 1e4):
        outputs = (0.3 * lasts, 0.6 * lasts)
        times = walk(StepControl(lasts, 0.01 * lasts, 1e-4 * lasts, outputs_s=outputs))
        np.testing.assert_allclose(np.array(times) / lasts, of_a_second, rtol=1e-12)


def test_easy_steps_grow_hard_ones_do_not():
    easy = walk(StepControl(2.0, 0.01, 1e-3, lambda time: 0.5))
    hard = walk(StepControl(2.0, 0.01, 1e-3), lambda time: 20)
    assert easy[1] - easy[0] == pytest.approx(0.02, rel=0.1)
    assert len(hard) == 200
    assert len(easy) < 15


def test_a_step_cut_short_by_an_output_does_not_shorten_the_next():
    times = walk(StepControl(1.0, 0.2, 1e-3, lambda time: 0.2, (0.21,)))
    assert times[:2] == pytest.approx([0.105, 0.21])
    assert max(np.diff(times)) > 0.15


def test_failure_halves_until_the_floor():
    control = StepControl(1.0, 0.4, 0.06)
    target = control.target_s
    assert control.reject(target)
    assert control.target_s == pytest.approx(target / 2, rel=0.1)
    assert control.reject(control.target_s)
    assert not control.reject(control.target_s)
    assert control.time_s == 0.0


def test_after_a_failure_the_step_grows_only_when_it_has_been_easy_for_a_while():
    control = StepControl(10.0, 0.2, 1e-3, lambda time: 0.2, patience=3)
    control.reject(control.target_s)
    taken = []
    for _ in range(6):
        target = control.target_s
        taken.append(target - control.time_s)
        control.accept(target, 4)
    assert taken == pytest.approx([0.1, 0.1, 0.1, 0.1, 0.2, 0.2], rel=0.05)


def test_output_is_reported():
    control = StepControl(1.0, 0.5, 0.1, outputs_s=(0.5,))
    control.accept(0.25, 4)
    assert not control.at_output
    control.accept(0.5, 4)
    assert control.at_output


def test_what_is_saved_goes_on_the_same():
    made = {"end_s": 1.0, "step_s": 0.1, "min_step_s": 1e-3, "outputs_s": (0.3, 0.7)}
    control = StepControl(**made)
    control.reject(control.target_s)
    for _ in range(3):
        control.accept(control.target_s, 4)
    assert walk(StepControl(**made | control.to_save())) == walk(control)

"""The rectified band-pass: its gain, its slopes, phase locking, both directions."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_fem.neuron import Population
from tactile_fem.neuron.population import fire
from tactile_fem.neuron.transduction import BandPass
from tactile_fem.study import Neuron

GAIN = 100.0


def made(**values) -> Neuron:
    constants = {"model": "band_pass", "filter_gain_pA": GAIN, "filter_off": 0.0, **values}
    return Neuron.model_validate(constants)


def current(neuron: Neuron, time_s: np.ndarray, drive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return begins and currents of the segments, of one receptor."""
    segments = list(BandPass(neuron).segments(time_s, drive[:, None]))
    at = np.array([segment.start_s for segment in segments])
    return at, np.array([segment.current_pA.at(0.0)[0] for segment in segments])


def settled(neuron: Neuron, frequency: float, phase: float = 0.0) -> float:
    """Return the largest current that a sine of amplitude 1 evokes after 30 periods."""
    time_s = np.linspace(0, 40 / frequency, 40 * 200 + 1)
    at, found = current(neuron, time_s, np.sin(2 * np.pi * frequency * time_s + phase))
    return found[at > 30 / frequency].max()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("frequency", [4.0, 40.0, 300.0])
def test_a_sine_is_passed_as_the_transfer_function_says(order, frequency):
    centre, quality = 40.0, 0.8
    neuron = made(filter_centre_Hz=centre, filter_quality=quality, filter_order=order)
    s, w = 2j * np.pi * frequency, 2 * np.pi * centre
    H = ((w / quality) * s / (s**2 + (w / quality) * s + w**2)) ** order
    assert settled(neuron, frequency) == pytest.approx(GAIN * abs(H), rel=5e-3)


def test_at_the_centre_the_current_is_the_gain():
    assert settled(made(filter_centre_Hz=50.0), 50.0) == pytest.approx(GAIN, rel=1e-3)


def test_samples_that_add_nothing_change_nothing():
    time_s, drive = np.array([0.0, 0.1, 0.13]), np.array([0.0, 1.0, 0.2])
    finer = np.union1d(np.linspace(0, 0.13, 53), time_s)
    neuron = made(filter_centre_Hz=35.0)
    at, coarse = current(neuron, time_s, drive)
    there, fine = current(neuron, finer, np.interp(finer, time_s, drive))
    # Between its values the current is linear: compared at the samples.
    for moment in time_s[:-1]:
        k, j = (int(abs(values - moment).argmin()) for values in (at, there))
        assert coarse[k] == pytest.approx(fine[j], rel=1e-9, abs=1e-12)


def test_what_has_been_felt_for_ever_evokes_nothing():
    _, found = current(made(filter_off=1.0), np.array([0.0, 1.0]), np.array([3.0, 3.0]))
    np.testing.assert_allclose(found, 0.0, atol=1e-9)


def test_the_other_direction_counts_by_its_share():
    neuron, time_s = made(filter_centre_Hz=50.0, filter_off=0.3), np.linspace(0, 0.1, 201)
    _, up = current(neuron, time_s, 10 * time_s)
    _, down = current(neuron, time_s, -10 * time_s)
    assert down.max() == pytest.approx(0.3 * up.max(), rel=1e-9)


def test_a_raised_threshold_holds_the_second_spike_of_a_period_back():
    frequency, levels = 100.0, np.geomspace(20.0, 5000.0, 80)
    time_s = np.linspace(0, 1.0, int(24 * frequency) + 1)
    drive = np.sin(2 * np.pi * frequency * time_s)[:, None] * levels / GAIN
    rested = {"filter_centre_Hz": 100.0, "capacitance_pF": 0.9, "refractory_s": 0.003}
    second = []
    for jump_mV in (0.0, 480.0):
        neuron = made(**rested, threshold_jump_mV=jump_mV, threshold_recovery_s=0.008)
        spikes = fire(time_s, drive, neuron).spikes
        rates = np.array([np.sum(times > 0.5) / 0.5 for times in spikes])
        assert np.sum(np.abs(rates - frequency) < 3) > 20  # one spike a period
        second.append(levels[rates > 1.05 * frequency].min())
    assert second[1] > 5 * second[0]


@pytest.mark.parametrize("frequency", [20.0, 50.0])
def test_spikes_lock_to_the_vibration(frequency):
    neuron = made(
        filter_gain_pA=25.0,
        filter_centre_Hz=40.0,
        filter_quality=0.5,
        capacitance_pF=3.0,
        refractory_s=0.02,
    )
    time_s = np.linspace(0, 1.0, int(24 * frequency) + 1)
    felt = 1 + np.sin(2 * np.pi * frequency * time_s)
    histories = {"time_s": time_s, "stretches": 1 - np.stack([felt[:, None]] * 3, axis=-1)}
    spikes = Population("RA", neuron, "compression").fire(histories).spikes[0]
    assert np.diff(spikes)[2:] == pytest.approx(1 / frequency, rel=1e-3)

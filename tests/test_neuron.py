import numpy as np
import pytest

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response, respond, transduction
from tactile_fem.study import Neuron

PLAIN = Neuron(adaptation=0, dynamic_gain_pA_s_per_kPa=0)


def constant(sed, duration=1.0):
    return np.array([0.0, duration]), np.full((2, len(sed)), sed, dtype=float)


def closed_form(current, n):
    drive = n.resistance_GOhm * current
    tau = 1e-3 * n.resistance_GOhm * n.capacitance_pF
    return 1 / (n.refractory_s + tau * np.log(drive / (drive - n.threshold_mV)))


@pytest.mark.parametrize("dt", [1e-4, 3.3e-3])
def test_constant_current_fires_at_the_closed_form_rate(dt):
    n = PLAIN.model_copy(update={"dt_s": dt})
    sed = np.array([0.1, 1.0, 5.0, 40.0])
    spikes = respond(*constant(sed, 2.0), n).spikes
    rates = [1 / np.diff(times) for times in spikes]
    for rate, current in zip(rates, n.threshold_mV / n.resistance_GOhm + 10 * sed, strict=True):
        assert rate == pytest.approx(closed_form(current, n), rel=1e-10)


def test_refractoriness_limits_the_rate():
    n = PLAIN.model_copy(update={"refractory_s": 0.00123})
    (times,) = respond(*constant([1e5], 0.1), n).spikes
    assert np.diff(times).min() >= 0.00123
    assert len(times) == pytest.approx(0.1 / 0.00123, abs=1)


def test_several_spikes_fit_into_one_step():
    n = PLAIN.model_copy(update={"refractory_s": 0, "dt_s": 0.05})
    (times,) = respond(*constant([20.0], 0.5), n).spikes
    current = n.threshold_mV / n.resistance_GOhm + 200
    assert 1 / np.diff(times) == pytest.approx(closed_form(current, n), rel=1e-9)


def test_a_finger_at_rest_is_silent():
    n = Neuron(intercept_pA=1000.0)
    time = np.array([-1.0, -0.5, 0.0, 0.5])
    sed = np.array([[0, 0], [0, -1e-12], [0, 1e-6], [0, 0]])
    silent, touched = respond(time, sed, n).spikes
    assert silent.size == 0
    assert touched.size and touched.min() > -0.5


def test_rate_decays_with_the_adaptation():
    n = Neuron(adaptation=0.4, adaptation_time_s=0.5, refractory_s=0.0005)
    (times,) = respond(*constant([4.0], 5.0), n).spikes
    rest = n.threshold_mV / n.resistance_GOhm
    middle = 0.5 * (times[1:] + times[:-1])
    expected = closed_form(rest + 40 * (0.6 + 0.4 * np.exp(-middle / 0.5)), n)
    assert 1 / np.diff(times) == pytest.approx(expected, rel=2e-3)
    assert 1 / np.diff(times)[-1] == pytest.approx(closed_form(rest + 40 * 0.6, n), rel=1e-3)


def test_dynamic_part_counts_on_a_rise_only():
    time = np.array([0, 0.2, 0.4, 0.6])
    sed = np.array([0, 4, 4, 0])[:, None]
    dynamic = respond(time, sed, Neuron(dynamic_gain_pA_s_per_kPa=5)).psth(0.2)[1][:, 0]
    static = respond(time, sed, Neuron(dynamic_gain_pA_s_per_kPa=0)).psth(0.2)[1][:, 0]
    assert dynamic[0] > static[0] + 5
    assert np.abs(dynamic - static)[1:].max() <= 1


def history(receptors=7, samples=40):
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.003, 0.03, samples)) - 0.2
    sed = np.maximum(rng.normal(1, 2, (samples, receptors)), 0)
    sed[0] = 0
    return time, sed


def test_receptors_do_not_know_of_each_other(monkeypatch):
    time, sed = history()
    together = respond(time, sed, Neuron())
    monkeypatch.setattr(transduction, "VALUES_PER_PIECE", 100)
    for k, times in enumerate(together.spikes):
        (alone,) = respond(time, sed[:, [k]], Neuron()).spikes
        assert times.size and np.array_equal(times, alone)
    assert together.counts().tolist() == [len(times) for times in together.spikes]


def test_more_samples_of_the_same_history_change_nothing():
    time, sed = history()
    fine = np.unique(np.concatenate([time, np.linspace(time[0], time[-1], 777)]))
    split = np.stack([np.interp(fine, time, column) for column in sed.T], axis=1)
    for a, b in zip(
        respond(time, sed, Neuron()).spikes, respond(fine, split, Neuron()).spikes, strict=True
    ):
        assert len(a) == len(b) > 5
        assert a == pytest.approx(b, abs=1e-8)


def test_a_crossing_that_turns_back_within_a_step_is_found():
    n = PLAIN.model_copy(update={"intercept_pA": 0.0, "refractory_s": 0.2})
    time, sed = np.array([0, 0.1]), np.array([[10.0], [0.0]])
    coarse = respond(time, sed, n.model_copy(update={"dt_s": 0.1})).spikes[0]
    assert coarse == pytest.approx(respond(time, sed, n).spikes[0], abs=1e-12)
    assert len(coarse) == 1


def test_rate_and_psth_hold_all_spikes():
    response = Response([np.array([0.0, 0.05, 0.1]), np.empty(0)], -0.1, 0.1)
    edges, counts = response.psth(0.05)
    assert edges == pytest.approx([-0.1, -0.05, 0, 0.05, 0.1])
    assert counts.sum(axis=0).tolist() == [3, 0]
    times = np.linspace(-0.5, 0.5, 1001)
    rate = response.rate(times, 0.02)
    assert rate.shape == (1001, 2)
    assert np.trapezoid(rate, times, axis=0) == pytest.approx([3, 0], abs=1e-6)
    for wrong in (0, -1, np.nan):
        with pytest.raises(StudyError, match="must be positive"):
            response.rate(times, wrong)


@pytest.mark.parametrize(
    ("time", "sed", "sentence"),
    [
        ([0, np.nan], [[0], [1]], "time_s is nan at index .1,."),
        ([0, 1], [[0], [np.inf]], "sed_kPa is inf at index .1, 0."),
        ([0, 0], [[0], [1]], "does not increase: 0 s follows 0 s at row 1"),
        ([0, 1], [0, 1], "sed_kPa has shape .2,."),
        ([0, 1, 2], [[0], [1]], "it needs .3, receptors."),
        ([0], [[0]], "two times or more"),
        ([0, 1], [[0], [-1e-3]], "-0.001 kPa at row 1, receptor 0"),
        ([0, 1], [["a"], [1]], "not an array of numbers"),
    ],
)
def test_bad_input_is_told_in_a_sentence(time, sed, sentence):
    with pytest.raises(StudyError, match=sentence):
        respond(time, sed, Neuron())

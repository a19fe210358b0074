import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tactile_fem.errors import StudyError
from tactile_fem.neuron import (
    ExponentialSum,
    Population,
    Response,
    compressive,
    current_at,
    load,
    respond,
    save,
    to_neo,
    transduction,
)
from tactile_fem.neuron.membrane import Variability
from tactile_fem.study import Neuron

MODELS = ["hamasaki2020", "power", "logarithmic", "gerling2018"]
GAINS = {"model": "hamasaki2020", "static_gain_pA_per_kPa": 10.0, "dynamic_gain_pA_s_per_kPa": 1.0}
PLAIN = Neuron(
    model="hamasaki2020", static_gain_pA_per_kPa=10.0, adaptation=0, dynamic_gain_pA_s_per_kPa=0
)
USUAL = Neuron(**GAINS, adaptation=0.45, adaptation_time_s=0.5, intercept_pA=18.0)
GENERATOR = Neuron(model="gerling2018", generator_gains_pA_per_kPa=(40.0, 20.0, 10.0, 8.0))
LOGARITHMIC = Neuron(
    model="logarithmic",
    static_gain_pA_per_kPa=600.0,
    compression_kPa=0.2,
    adaptation=0.1,
    fast_adaptation=0.7,
    fast_adaptation_time_s=0.02,
)
POWERS = [
    LOGARITHMIC.model_copy(
        update={"model": "power", "power": power, "drive_threshold_kPa": threshold}
    )
    for power, threshold in ((0.4, 0.0), (0.4, 0.3), (1.0, 0.3), (1.5, 0.1))
]
NOISY = [n.model_copy(update={"threshold_noise": 0.2}) for n in (USUAL, GENERATOR)]
# Relative refractoriness; one comes back as fast as the membrane.
RAISED = [
    USUAL.model_copy(
        update={"threshold_noise": 0.2, "threshold_jump_mV": 25.0, "threshold_recovery_s": tau_s}
    )
    for tau_s in (0.02, USUAL.time_constant_s)
]
ALL = [USUAL, GENERATOR, *NOISY, *RAISED]


def name_of(n):
    return f"{n.model}, noise {n.threshold_noise:g}, jump {n.threshold_jump_mV:g}"


def constant(sed, duration=1.0):
    return np.array([0.0, duration]), np.full((2, len(sed)), sed, dtype=float)


def closed_form(current, n):
    drive = n.resistance_GOhm * current
    return 1 / (n.refractory_s + n.time_constant_s * np.log(drive / (drive - n.threshold_mV)))


def test_constant_current_fires_at_the_closed_form_rate():
    sed = np.array([0.1, 1.0, 5.0, 40.0])
    spikes = respond(*constant(sed, 2.0), PLAIN).spikes
    currents = PLAIN.threshold_mV / PLAIN.resistance_GOhm + 10 * sed
    for times, current in zip(spikes, currents, strict=True):
        rate = closed_form(current, PLAIN)
        assert len(times) == int(2.0 * rate + PLAIN.refractory_s * rate)
        assert 1 / np.diff(times) == pytest.approx(rate, rel=1e-10)


def test_a_raised_threshold_makes_intervals_longer():
    jump, recovery = 60.0, 0.03
    slow = PLAIN.model_copy(update={"threshold_jump_mV": jump, "threshold_recovery_s": recovery})
    strong = 40.0
    spikes = respond(*constant(np.array([strong]), 2.0), slow).spikes[0]
    usual = respond(*constant(np.array([strong]), 2.0), PLAIN).spikes[0]
    assert spikes[0] == usual[0] and np.diff(spikes).min() > 2 * np.diff(usual).max()
    # In a steady rhythm V, from 0, meets the threshold and what is left of all jumps before.
    interval = np.diff(spikes)[-1]
    left = jump / np.expm1(interval / recovery)
    drive = slow.threshold_mV + 10 * strong * slow.resistance_GOhm
    potential = -drive * np.expm1(-(interval - slow.refractory_s) / slow.time_constant_s)
    assert potential == pytest.approx(slow.threshold_mV + left, rel=1e-6)


def test_a_finger_at_rest_is_silent():
    n = Neuron(model="hamasaki2020", intercept_pA=1000.0)
    time = np.array([-1.0, -0.5, 0.0, 0.5])
    sed = np.array([[0, 0], [0, -1e-12], [0, 1e-6], [0, 0]])
    silent, touched = respond(time, sed, n).spikes
    assert silent.size == 0
    assert touched.size and touched.min() > -0.5


def history(receptors=7, samples=40):
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.003, 0.03, samples)) - 0.2
    sed = np.maximum(rng.normal(1, 2, (samples, receptors)), 0)
    sed[0] = 0
    return time, sed


def reference(time, sed, n, unit):
    """Integrate one receptor's equations step by step; return the spikes."""
    generator, logarithmic, power = (
        n.model == name for name in ("gerling2018", "logarithmic", "power")
    )
    tau = n.generator_times_s if generator else (n.adaptation_time_s, n.fast_adaptation_time_s)
    fast, scale = n.fast_adaptation * (logarithmic or power), n.compression_kPa
    rest_pA = n.intercept_pA or 0.0
    membrane = 1e-3 * n.resistance_GOhm * n.capacitance_pF
    *gains, lasting = n.generator_gains_pA_per_kPa

    def current(s, slope, state):
        rest = rest_pA * (sed[k] + sed[k + 1] > 0)
        if generator:
            parts = (max(k * e, 0.0) for k, e in zip(gains, state, strict=True))
            return rest + lasting * s + sum(parts)
        static = n.static_gain_pA_per_kPa * (s - n.adaptation * state[0] - fast * state[1])
        total = rest + static + n.dynamic_gain_pA_s_per_kPa * max(slope, 0.0)
        return max(total, 0.0) if power else total

    def change(t, y):
        s = sed[k] + slope * (t - time[k])
        if logarithmic:
            s = scale * np.log1p(s / scale)
        if power:
            s = max(s - n.drive_threshold_kPa, 0.0) ** n.power
        if generator:
            states = [slope - e / way for e, way in zip(y[1:], tau, strict=True)]
        else:
            states = [(s - a) / way for a, way in zip(y[1:], tau, strict=True)]
        free = t >= quiet
        return [free * (n.resistance_GOhm * current(s, slope, y[1:]) - y[0]) / membrane, *states]

    def crossing(t, y):
        raised = jumps * np.exp(-(t - spikes) / n.threshold_recovery_s) if spikes.size else 0.0
        return y[0] - n.threshold_mV - np.sum(raised)

    crossing.terminal, crossing.direction = True, 1
    spikes, jumps = np.empty(0), n.threshold_jump_mV
    quiet, variability = -np.inf, Variability(n, np.array([unit]))
    y = np.array([0.0, *([sed[0]] * 3 if generator else [0.0, 0.0])])
    for k, slope in enumerate(np.diff(sed) / np.diff(time)):
        t = time[k]
        while t < time[k + 1]:
            end = min(quiet, time[k + 1]) if quiet > t else time[k + 1]
            accurate = {"rtol": 1e-11, "atol": 1e-12, "method": "DOP853", "max_step": 2e-3}
            solved = solve_ivp(change, (t, end), y, events=crossing, **accurate)
            t, y = solved.t[-1], solved.y[:, -1]
            if solved.status == 1:
                spikes = np.append(spikes, t)
                (factor,) = variability.after_spike(np.array([0]))
                quiet, y[0] = t + n.refractory_s, n.threshold_mV * (1 - factor)
    return spikes


@pytest.mark.parametrize("n", ALL, ids=name_of)
def test_spikes_equal_an_accurate_integration(n):
    time, sed = history(3, 25)
    for unit, times in enumerate(respond(time, sed, n).spikes):
        expected = reference(time, sed[:, unit], n, unit)
        assert len(times) == len(expected) > 4
        # The integrator, not the closed form, sets the tolerance; clipped parts have kinks.
        smooth = n.model == "hamasaki2020"
        assert times == pytest.approx(expected, abs=1e-9 if smooth else 1e-7)


@pytest.mark.parametrize("n", [LOGARITHMIC, POWERS[1]], ids=name_of)
def test_a_compressed_drive_is_as_exact_as_its_chords(monkeypatch, n):
    """S is off by at most 0.002 units; a finer division brings the spikes home."""
    time, sed = history(3, 25)
    expected = [reference(time, column, n, 0) for column in sed.T]
    worst = []
    for chord in (compressive.CHORD_ERROR, 0.01 * compressive.CHORD_ERROR):
        monkeypatch.setattr(compressive, "CHORD_ERROR", chord)
        spikes = respond(time, sed, n).spikes
        assert [len(times) for times in spikes] == [len(times) for times in expected]
        away = [np.abs(a - b) for a, b in zip(spikes, expected, strict=True)]
        worst.append(np.quantile(np.concatenate(away), 0.9))  # some just reach the threshold
    assert min(map(len, expected)) > 15
    assert worst[0] < 1e-4
    assert worst[1] < 0.05 * worst[0]


@pytest.mark.parametrize("n", POWERS, ids=lambda n: f"{n.power:g}, {n.drive_threshold_kPa:g}")
def test_a_power_answers_to_what_is_above_its_threshold(n):
    """After some time a constant drive leaves what does not adapt."""
    n = n.model_copy(update={"adaptation_time_s": 0.1})
    drive = np.array([0.05, 0.5, 1.0, 2.0, 4.0])
    (found,) = current_at(np.array([2.0]), *constant(drive, 2.0), n)
    S = np.maximum(drive - n.drive_threshold_kPa, 0.0) ** n.power
    assert found == pytest.approx(n.static_gain_pA_per_kPa * S * n.lasting_share, rel=1e-6)
    assert (found[drive < n.drive_threshold_kPa] == 0).all()


@pytest.mark.parametrize("n", [USUAL, *POWERS, LOGARITHMIC], ids=name_of)
@pytest.mark.parametrize("contact_s", [0.0, 2.0, 1000.0])
def test_the_current_at_times_is_that_of_the_stretches(n, contact_s):
    time, sed = history(3, 25)
    at = np.linspace(time[0], time[-1], 5000)[1:-1]
    found = current_at(at, time, sed, n, contact_s)
    own = transduction.accustomed(transduction.transduction_of(n), contact_s)
    off = []
    for start, length, current, who in own.segments(time, sed):
        begin = np.broadcast_to(start, len(np.arange(3)[who]))
        for column, first in zip(np.arange(3)[who], begin, strict=True):
            rows = np.flatnonzero((at > first) & (at < first + np.min(length)))
            values = current.at(at[rows, None] - begin)[:, list(np.arange(3)[who]).index(column)]
            off.append(np.abs(values - found[rows, column]))
    off = np.concatenate(off)
    assert len(off) > 10_000
    assert np.quantile(off, 0.99) < 0.01 * n.static_gain_pA_per_kPa


def test_a_long_contact_leaves_what_changes_and_what_does_not_adapt():
    """Adapted for long, an afferent has the mean of its history behind it."""
    n = POWERS[0].model_copy(update={"adaptation": 0.1, "adaptation_time_s": 60.0})
    time = np.linspace(0.0, 2.0, 401)
    drive = 1 + 0.1 * np.sin(2 * np.pi * 5 * time)[:, None]
    S = drive**n.power
    fresh, used = (current_at(time[200:], time, drive, n, s).mean() for s in (0.0, 1e4))
    assert fresh - used == pytest.approx(n.static_gain_pA_per_kPa * 0.1 * S.mean(), rel=0.04)
    population = Population(neuron=n)
    histories = {"time_s": time, "sed_kPa": drive}
    counts = [one.fire(histories).counts().sum() for one in (population, population.accustomed(30))]
    assert counts[1] < counts[0]


def test_a_logarithm_leaves_a_weak_drive_as_it_is_and_answers_to_ratios_of_a_strong_one():
    n = LOGARITHMIC.model_copy(update={"adaptation": 0.0, "static_gain_pA_per_kPa": 1e6})
    linear = Neuron(
        model="hamasaki2020",
        static_gain_pA_per_kPa=1e6 * (1 - n.fast_adaptation),
        adaptation=0.0,
        dynamic_gain_pA_s_per_kPa=0.0,
        intercept_pA=0.0,
    )
    weak = np.array([1e-4, 2e-4])
    late = [respond(*constant(weak, 2.0), model).mean_rate(1.0, 2.0) for model in (n, linear)]
    assert late[0].min() > 5 and late[0] == pytest.approx(late[1], abs=1.0)
    n = n.model_copy(update={"static_gain_pA_per_kPa": 1000.0})
    currents = current_at(np.array([1.0]), *constant([10.0, 20.0, 40.0], 2.0), n)[0]
    assert np.diff(currents) == pytest.approx(300.0 * 0.2 * np.log(2), rel=0.02)


def test_a_current_that_adaptation_makes_negative_is_none():
    """After a release nothing holds the membrane back: it answers to the next press as at rest."""
    time = np.array([0.0, 0.05, 0.5, 0.51, 0.515, 0.52, 1.0])
    sed = np.array([0.0, 4.0, 4.0, 0.0, 0.0, 4.0, 4.0])[:, None]
    n = POWERS[0]
    assert current_at(np.array([0.512]), time, sed, n)[0, 0] == 0.0
    linear = n.model_copy(update={"model": "logarithmic", "compression_kPa": 1e6})
    assert current_at(np.array([0.512]), time, sed, linear)[0, 0] < -50.0
    (times,) = respond(time, sed, n).spikes
    assert not ((times > 0.511) & (times < 0.515)).any()
    assert times[times > 0.515][0] < 0.525


def test_adaptation_as_fast_as_the_membrane():
    tau = 1e-3 * USUAL.resistance_GOhm * USUAL.capacitance_pF
    time, sed = history()
    equal, near = (
        respond(time, sed, USUAL.model_copy(update={"adaptation_time_s": tau * factor})).spikes
        for factor in (1.0, 1 + 1e-9)
    )
    for a, b in zip(equal, near, strict=True):
        assert a.size and a == pytest.approx(b, abs=1e-8)


@pytest.mark.parametrize("n", [USUAL, GENERATOR, LOGARITHMIC, RAISED[0]], ids=name_of)
def test_parts_of_a_population_fire_as_the_whole(n):
    time, sed = history()
    noisy = n.model_copy(update={"threshold_noise": 0.1, "gain_spread": 0.3})
    together = respond(time, sed, noisy)
    for units in ([0], [5, 2], [1, 3, 4, 6]):
        part = respond(time, sed[:, units], noisy, units=units).spikes
        for unit, times in zip(units, part, strict=True):
            assert times.size and np.array_equal(times, together.spikes[unit])
    assert together.counts().tolist() == [len(times) for times in together.spikes]
    other = respond(time, sed, noisy.model_copy(update={"seed": 2}))
    assert not np.array_equal(other.spikes[0], together.spikes[0])


@pytest.mark.parametrize("noise", [0.1, 0.5])
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_without_a_stimulus_none_fires_whatever_the_noise(model, noise, share):
    rheobase = USUAL.threshold_mV / USUAL.resistance_GOhm
    n = Neuron(model=model, intercept_pA=share * rheobase, threshold_noise=noise)
    assert respond(*constant([1e-30] * 200), n).counts().sum() == 0
    time, sed = np.array([0, 0.1, 0.5, 0.52, 2.0]), np.array([0, 1.0, 1.0, 0, 0])
    released = respond(time, np.repeat(sed[:, None], 200, axis=1), n)
    assert released.counts().min() > 5
    assert max(times[-1] for times in released.spikes) < 0.52


@pytest.mark.parametrize("model", ["hamasaki2020", "gerling2018"])
@pytest.mark.parametrize("above_rheobase", [0.001, 0.01, 0.1, 1.0])
def test_noise_makes_intervals_vary_about_those_without_it(model, above_rheobase):
    """As long as the current is constant; the rate stays also where S, not I_0, brings it."""
    gain = {"static_gain_pA_per_kPa": 10.0, "generator_gains_pA_per_kPa": (0.0, 0.0, 0.0, 10.0)}
    plain = Neuron(model=model, intercept_pA=9.0, adaptation=0, dynamic_gain_pA_s_per_kPa=0, **gain)
    current = (1 + above_rheobase) * plain.threshold_mV / plain.resistance_GOhm
    time, sed = constant([(current - 9.0) / 10.0] * 100, 20.0)
    variation = []
    for noise in (0.1, 0.2):
        spikes = respond(time, sed, plain.model_copy(update={"threshold_noise": noise})).spikes
        intervals = np.concatenate([np.diff(times) for times in spikes])
        assert 1 / intervals.mean() == pytest.approx(closed_form(current, plain), rel=noise**2)
        variation.append(intervals.std() / intervals.mean())
    assert variation[0] > 0.01
    assert variation[1] == pytest.approx(2 * variation[0], rel=0.05)


@pytest.mark.parametrize("sed", [1.0, 100.0])
def test_noise_has_the_spread_that_was_asked_for(sed):
    n = PLAIN.model_copy(update={"threshold_noise": 0.05, "refractory_s": 0.0})
    spikes = respond(*constant([sed] * 200, 20.0 / sed), n).spikes
    assert min(map(len, spikes)) > 200  # several blocks of random numbers
    # Current is above rheobase by 10 sed: from the interval follows where V began.
    above = n.resistance_GOhm * 10.0 * sed
    logarithm = np.concatenate([np.log(np.expm1(np.diff(t) / n.time_constant_s)) for t in spikes])
    assert logarithm.mean() == pytest.approx(np.log(n.threshold_mV / above), abs=0.001)
    assert logarithm.std() == pytest.approx(0.05, rel=0.01)
    assert np.corrcoef(logarithm[:-1], logarithm[1:])[0, 1] == pytest.approx(0, abs=0.02)


def test_gains_have_the_spread_that_was_asked_for():
    gains = PLAIN.model_copy(update={"gain_spread": 0.2, "refractory_s": 0.0})
    rates = respond(*constant([100.0] * 200, 0.2), gains).counts()
    assert np.log(rates).std() == pytest.approx(0.2, rel=0.2)


@pytest.mark.parametrize("n", [*ALL, LOGARITHMIC], ids=name_of)
def test_thresholds_have_the_spread_that_was_asked_for(n):
    """Each afferent fires as one whose potentials are all as many times as large."""
    n = n.model_copy(update={"intercept_pA": 18.0})
    time, sed = history()
    varied = n.model_copy(update={"threshold_spread": 0.3})
    factors = Variability(varied, np.arange(7)).thresholds()
    spikes = respond(time, sed, varied).spikes
    for unit, factor in enumerate(factors.tolist()):
        higher = {key: factor * getattr(n, key) for key in ("threshold_mV", "threshold_jump_mV")}
        (alone,) = respond(time, sed[:, [unit]], n.model_copy(update=higher), units=[unit]).spikes
        assert spikes[unit] == pytest.approx(alone, abs=1e-9)
    many = Variability(varied, np.arange(1000))
    assert np.log(many.thresholds()).std() == pytest.approx(0.3, rel=0.1)
    assert abs(np.corrcoef(np.log(many.thresholds()), np.log(many.gains() + 1e-9))[0, 1]) < 0.1


def test_a_hold_goes_on_adapting_for_seconds():
    """The default afferent follows its law: a third of the rate goes in 12 s."""
    n, sed = Neuron(), np.array([1.0, 2.0, 5.0])
    response = respond(*constant(sed, 14.0), n)
    S = sed**n.power
    for start in (0.5, 12.5):
        adapted = n.fast_adaptation - n.adaptation * np.expm1(-(start + 0.5) / n.adaptation_time_s)
        current = n.static_gain_pA_per_kPa * S * (1 - adapted)
        expected = closed_form(current, n)
        assert response.mean_rate(start, start + 1.0) == pytest.approx(expected, abs=1.0)
    left = response.mean_rate(12.0, 13.0) / response.mean_rate(0.0, 1.0)
    assert (left > 0.5).all() and (left < 0.75).all()


@pytest.mark.parametrize("n", [USUAL, GENERATOR, LOGARITHMIC], ids=name_of)
def test_afferents_may_have_met_the_state_before(n):
    """As if the first value had been held: the current is that of the longer history."""
    time, sed = history()
    sed[0] = 0.5
    longer = np.append(time[0] - 3.0, time), np.vstack([sed[:1], sed])
    (segment, *_) = transduction.held(transduction.transduction_of(n), 3.0).segments(time, sed)
    expected = current_at(time[:1] + 1e-10, *longer, n)[0][segment.who]
    assert segment.current_pA.at(1e-10) == pytest.approx(expected, rel=1e-6)
    population = Population(neuron=n)
    histories = {"time_s": time, "sed_kPa": sed}
    adapted, fresh = population.held(3.0).fire(histories), population.fire(histories)
    assert adapted.start_s == time[0] and min(times[0] for times in adapted.spikes) > time[0]
    assert adapted.counts().sum() < fresh.counts().sum()


def test_spikes_without_end_are_told_however_fine_the_samples():
    n = PLAIN.model_copy(update={"refractory_s": 0.0})  # the intervals are of 4.5 microseconds
    with pytest.raises(StudyError, match="fires more than 100,000 times a second"):
        respond(np.linspace(0, 1e-3, 1001), np.full((1001, 1), 2e4), n)


@pytest.mark.parametrize("n", ALL, ids=name_of)
def test_more_samples_of_the_same_history_change_nothing(n):
    time, sed = history()
    fine = np.unique(np.concatenate([time, np.linspace(time[0], time[-1], 777)]))
    split = np.stack([np.interp(fine, time, column) for column in sed.T], axis=1)
    pairs = zip(respond(time, sed, n).spikes, respond(fine, split, n).spikes, strict=True)
    for a, b in pairs:
        assert len(a) == len(b) > 5
        assert a == pytest.approx(b, abs=1e-10)


def test_a_crossing_that_turns_back_between_samples_is_found():
    n = PLAIN.model_copy(update={"intercept_pA": 0.0, "refractory_s": 0.2})
    time, sed = np.array([0, 0.1]), np.array([[10.0], [0.0]])
    (coarse,) = respond(time, sed, n).spikes
    fine = np.linspace(0, 0.1, 1000)
    assert coarse == pytest.approx(respond(fine, 10 - 100 * fine[:, None], n).spikes[0], abs=1e-12)
    assert len(coarse) == 1


def test_signs_of_a_sum_of_exponentials_change_where_a_fine_grid_says():
    rng = np.random.default_rng(1)
    n, end = 200, 2.0
    curves = ExponentialSum(
        rng.normal(size=n), rng.normal(size=n), rng.normal(0, 3, (3, n)), np.array([0.05, 0.2, 1.0])
    )
    zeros = curves.zeros(np.full(n, end))
    grid = np.linspace(0, end, 20001)[:, None]
    changes = np.diff(curves.at(grid) < 0, axis=0)
    found = 0
    for k in range(n):
        expected = grid[1:, 0][changes[:, k]]
        mine = zeros[:, k][zeros[:, k] < end]
        found = max(found, len(mine))
        assert mine == pytest.approx(expected, abs=1e-4)
    assert found >= 3
    single = curves.of(np.array([3])).at(zeros[:, [3]])
    assert np.abs(single[zeros[:, [3]] < end]).max() < 1e-13


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


def test_latency_mean_rate_and_events():
    response = Response([np.array([0.0, 0.05, 0.15]), np.empty(0)], -0.1, 0.2)
    assert response.latency() == pytest.approx([0.1, np.nan], nan_ok=True)
    assert response.latency(0.01) == pytest.approx([0.04, np.nan], nan_ok=True)
    assert response.mean_rate(0.0, 0.15) == pytest.approx([2 / 0.15, 0])
    receptor, time = response.events()
    assert receptor.tolist() == [0, 0, 0] and time.tolist() == [0.0, 0.05, 0.15]


def test_bundles_end_where_spikes_are_rare():
    spikes = np.array([0.1, 0.3, 0.5, 2.0, 4.0, 4.2, 4.3, 4.6])
    found, none = Response([spikes, np.empty(0)], 0.0, 5.0).bundles(gap_s=0.6, least=3)
    assert [(b.start_s, b.end_s, b.spikes) for b in found] == [(0.1, 0.5, 3), (4.0, 4.6, 4)]
    assert found[0].rate_Hz == pytest.approx(2 / 0.4)
    assert none == []


def test_the_peak_rate_is_that_of_the_shortest_successive_intervals():
    spikes = np.array([0.0, 0.1, 0.2, 0.21, 0.25, 0.6])
    few = spikes[:3]
    response = Response([spikes, few], 0.0, 1.0)
    np.testing.assert_allclose(response.peak_rate(2), [2 / 0.05, 2 / 0.2])
    np.testing.assert_allclose(response.peak_rate(), [3 / 0.15, 0.0])


def test_responses_are_kept(tmp_path):
    response = Response([np.empty(0), np.array([0.1, 1 / 3]), np.empty(0)], -0.1, 0.5)
    save(response, tmp_path / "spikes.npz")
    again = load(tmp_path / "spikes.npz")
    assert (again.start_s, again.end_s, len(again.spikes)) == (-0.1, 0.5, 3)
    assert all(np.array_equal(*pair) for pair in zip(again.spikes, response.spikes, strict=True))
    save(response, tmp_path / "spikes.csv")
    lines = (tmp_path / "spikes.csv").read_text().splitlines()
    assert lines == ["receptor,time_s", "1,0.1", f"1,{1 / 3}"]
    with pytest.raises(StudyError, match=r'not "\.mat"'):
        save(response, tmp_path / "spikes.mat")
    with pytest.raises(StudyError, match="holds no response"):
        load(tmp_path / "spikes.csv")


def test_neo_gets_every_spike():
    response = Response([np.empty(0), np.array([0.1, 0.3])], -0.1, 0.5)
    if not find_spec("neo"):
        with pytest.raises(StudyError, match="neo is not installed"):
            to_neo(response)
        return
    trains = to_neo(response, kind=["SA1", "RA"]).spiketrains
    assert [train.annotations["kind"] for train in trains] == ["SA1", "RA"]
    assert [train.rescale("s").magnitude.tolist() for train in trains] == [[], [0.1, 0.3]]
    assert float(trains[0].t_start) == -0.1 and float(trains[1].t_stop) == 0.5


def test_annotations_are_one_for_each_receptor():
    with pytest.raises(StudyError, match="kind has 1 values; it needs 2, one a receptor"):
        to_neo(Response([np.empty(0), np.array([0.1])], 0.0, 0.5), kind=["SA1"])


def test_neurons_need_neither_solver_nor_plots():
    code = (
        "import sys, tactile_fem.neuron; wanted = ('dolfinx', 'mpi4py', 'petsc4py', 'matplotlib'); "
        "print([name for name in wanted if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_numbers_of_afferents_must_fit():
    for units in ([0], [0, -1], [0.0, 1.0]):
        with pytest.raises(StudyError, match="2 whole numbers from 0 on"):
            respond([0, 1], np.ones((2, 2)), PLAIN, units=units)


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

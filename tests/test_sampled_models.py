"""Afferents that a model of another package lets fire, and what is handed to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import other_models
import pytest

from tactile_fem import Parts, Population, StudyError
from tactile_fem.neuron import SampledModel, fire_all
from tactile_fem.simulation.checks import check_parts
from tactile_fem.study import Neuron

LINEAR = Neuron(
    power=1.0,
    drive_threshold_kPa=0.0,
    fast_adaptation=0.0,
    adaptation=0.0,
    static_gain_pA_per_kPa=20.0,
)


@dataclass(frozen=True)
class Stepped:
    """The membrane of a linear afferent, step by step."""

    neuron: Neuron = LINEAR

    def __call__(self, sed_kPa, step_s):
        n, tau = self.neuron, 1e-3 * self.neuron.resistance_GOhm * self.neuron.capacitance_pF
        v, rest = np.zeros(sed_kPa.shape[1]), np.zeros(sed_kPa.shape[1])
        fired = np.zeros(sed_kPa.shape)
        for k, felt in enumerate(sed_kPa):
            steady = n.resistance_GOhm * n.static_gain_pA_per_kPa * felt
            v = np.where(rest > 0, 0.0, steady + (v - steady) * np.exp(-step_s / tau))
            rest = rest - step_s
            fired[k] = v >= n.threshold_mV
            v, rest = np.where(fired[k], 0.0, v), np.where(fired[k], n.refractory_s, rest)
        return fired


def held(*sed_kPa):
    time = np.array([-0.1, 0.0, 0.31])  # at uneven times
    return {"time_s": time, "sed_kPa": np.outer([0.0, 1.0, 1.0], sed_kPa)}


def test_a_stepped_membrane_fires_as_ours_to_a_step_or_two():
    histories = held(1.0, 3.0, 0.0)
    exact = Population(neuron=LINEAR).fire(histories)
    stepped = SampledModel(model=Stepped(), rate_Hz=20_000).fire(histories)
    assert (stepped.start_s, stepped.end_s) == (exact.start_s, exact.end_s)
    assert stepped.counts() == pytest.approx(exact.counts(), abs=1)
    assert stepped.counts()[1] > 10 and stepped.counts()[2] == 0
    for ours, theirs in zip(exact.spikes[:2], stepped.spikes, strict=False):
        assert theirs[0] == pytest.approx(ours[0], abs=2 / 20_000)


def test_a_model_is_given_samples_at_equal_intervals():
    given = []

    def model(felt, step_s):
        given.append((felt, step_s))
        return np.zeros(felt.shape, dtype=bool)

    SampledModel(model=model, rate_Hz=100.0).fire(held(2.0))
    ((felt, step_s),) = given
    assert step_s == pytest.approx(0.01)
    assert felt[:, 0] == pytest.approx(np.minimum(0.2 * np.arange(42), 2.0))


def test_it_takes_its_place_among_populations():
    histories = held(1.0, 3.0) | {"population": np.array(["SA1", "other"])}
    own = SampledModel("other", model=Stepped(), rate_Hz=20_000)
    fired = fire_all([Population(neuron=LINEAR), own], histories)
    assert fired.spikes[0].tolist() == Population(neuron=LINEAR).fire(held(1.0)).spikes[0].tolist()
    assert fired.spikes[1].tolist() == own.fire(held(3.0)).spikes[0].tolist()
    check_parts(Parts(populations=(own,)))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: SampledModel(), "needs a model"),
        (lambda: SampledModel(model=Stepped(), rate_Hz=0.0), "rate_Hz is 0.0; it must be positive"),
        (lambda: SampledModel(model=Stepped(), neuron=LINEAR), "would have no effect beside"),
        (lambda: SampledModel(model=lambda f, s: f[:2]), r"\(2, 1\) values; it needs \(4101, 1\)"),
        (lambda: SampledModel(model=Stepped()).held(1.0), "SA1 afferents cannot begin adapted"),
        (lambda: SampledModel(model=Stepped()).accustomed(1.0), "cannot begin adapted"),
    ],
)
def test_what_a_model_cannot_do_is_one_sentence(make, says):
    with pytest.raises(StudyError, match=says):
        make().fire(held(1.0))


def test_the_demo_compares_where_both_fire(tmp_path, monkeypatch, capsys):
    """With a membrane in place of SensoryForge, which is not on the package index."""

    @dataclass(frozen=True)
    class Membrane:
        gain: float

        def __call__(self, sed_kPa, step_s):
            return Stepped()(self.gain * sed_kPa, step_s)

    other_models.main(tmp_path)
    assert "not installed" in capsys.readouterr().out
    monkeypatch.setattr(other_models, "find_spec", lambda name: True)
    monkeypatch.setattr(other_models, "SensoryForge", Membrane)
    other_models.main(tmp_path, rate_Hz=2000.0)
    ours, theirs = (tmp_path / "other_models.csv").read_text().splitlines()[1:]
    assert ours.startswith("ours,560,") and 520 < int(theirs.split(",")[1]) < 600
    assert (tmp_path / "other_models.png").is_file() and (tmp_path / "ours.npz").is_file()

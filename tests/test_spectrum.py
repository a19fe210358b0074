"""What a vibration tells of afferents, and what it does not."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from synthetic import make_results

from tactile_fem.neuron import DRIVES, Drive, Population, rate_of
from tactile_fem.study import Neuron, Study
from tactile_fem.vibration import Spectrum, unfelt
from tactile_fem.vibration.figures import spectrum_figure, write_vibration

PC = {"name": "PC", "kind": "PC"}
FELT = {"fast": "sed", "soft": "compression", "deep": "pressure", "own": "squeeze"}


def made_up() -> Spectrum:
    """Return two frequencies of one receptor of each population."""
    count = len(FELT)
    stretches = np.full((2, count, 3), 0.1 + 0j)
    return Spectrum(
        frequency_Hz=np.array([10.0, 40.0]),
        motion=np.array([0.0, 0.0, 1.0]),
        receptors_mm=np.zeros((count, 3)),
        population=np.array(list(FELT)),
        moved=np.full((2, count, 3), 0.5 + 0j),
        sed_kPa=np.full((2, count), 2.0 + 1j),
        stretches=stretches,
        force_N=np.full((2, 3), 0.3 + 0j),
        still_moved_mm=np.zeros((count, 3)),
        still_sed_kPa=np.ones((count,)),
        still_stretches=np.ones((count, 3)),
    )


@pytest.mark.parametrize("name", DRIVES)
def test_what_a_vibration_has_is_what_its_histories_have(name):
    histories = made_up().histories(0, 0.1, 0.2)
    without = {"von_mises", "largest_stress", "smallest_stress", "pressure", "directed_stretch"}
    for feels in (name, f"{name}_rate"):
        population = Population("fast", feels=feels)
        assert bool(unfelt(population)) == (name in without)
        if name not in without:
            population.drive.of(histories)


def test_a_fast_filter_does_not_answer_to_the_lines_between_samples():
    spectrum, (pc,) = made_up(), Study.model_validate({"afferents": [PC]}).populations
    n = pc.neuron.model_copy(update={"gain_spread": 0.0})
    x = spectrum.frequency_Hz[0] / n.filter_centre_Hz
    H = (1 + (n.filter_quality * (x - 1 / x)) ** 2) ** (-n.filter_order / 2)
    rheobase_mm = n.threshold_mV / n.resistance_GOhm / (n.filter_gain_pA * H * 0.5)
    population = Population("fast", n, "indentation")
    below, above = (spectrum.rates_Hz(0, factor * rheobase_mm, population) for factor in (0.9, 1.2))
    assert below == 0 and above >= 10


def test_rates_are_those_of_afferents_that_have_adapted_to_the_state():
    n = Neuron()
    n = n.model_copy(update={"adaptation": 0.04})
    (still,) = made_up().rates_Hz(0, 0.0, Population("fast", n))
    S = 1.0**n.power
    left = 1 - n.fast_adaptation + n.adaptation * np.expm1(-60.0 / n.adaptation_time_s)
    assert still == pytest.approx(rate_of(n.static_gain_pA_per_kPa * left * S, n), abs=1.0)


def test_afferents_that_feel_something_else_have_no_rates_and_lose_none(
    tmp_path, monkeypatch, capsys
):
    with monkeypatch.context() as script:  # a drive that only the scan's script knows
        script.setitem(DRIVES, "squeeze", Drive("Squeeze", "1", lambda h: h["sed_kPa"]))
        study = Study.model_validate(
            {"afferents": [{"name": name, "feels": what} for name, what in FELT.items()]}
        )
    results = make_results(tmp_path / "r", study)
    write_vibration(results, made_up(), None, 0.01)
    assert {path.name for path in results.vibration.iterdir()} == {
        "spectrum.npz",
        "spectrum.csv",
        "spectrum.png",
    }
    rows = list(csv.DictReader((results.vibration / "spectrum.csv").open()))
    assert {row["amplitude_mm"] for row in rows} == {"0.01"}
    for row in rows:
        assert (row["rate_Hz"] == "nan") == (row["population"] in ("deep", "own"))
        assert float(row["sed_kPa"]) == pytest.approx(0.01 * np.sqrt(5), rel=1e-5)


def test_one_frequency_is_drawn_and_its_rates_are_within_the_figure():
    both = made_up()
    one = replace(
        both,
        **{
            name: getattr(both, name)[:1]
            for name in ("frequency_Hz", "moved", "sed_kPa", "stretches", "force_N")
        },
    )
    figure = spectrum_figure(one, list(FELT), np.array([[100.0, 0.0, np.nan, np.nan]]), 0.01)
    assert figure.axes[3].get_ylim()[1] > 100.0

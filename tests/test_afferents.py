"""Several populations of afferents: what each feels, and that each fires as it would alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError
from synthetic import make_results, make_trace

from tactile_fem.errors import StudyError
from tactile_fem.neuron import (
    DRIVES,
    Drive,
    ExponentialSum,
    Population,
    Response,
    Segment,
    drive_of,
    fire_all,
    replaced,
    respond,
)
from tactile_fem.output.figures import draw_plots
from tactile_fem.results.numbers import numbers_of
from tactile_fem.results.results import Results
from tactile_fem.series import fibre_image
from tactile_fem.series.members import single_fibre
from tactile_fem.simulation.checks import check, check_parts
from tactile_fem.simulation.parts import Parts
from tactile_fem.study import Afferents, Neuron, Receptors, Study
from tactile_fem.study.explain import in_words
from tactile_fem.study.file import dump_study, load_study

NOISY = Neuron(
    model="hamasaki2020", gain_spread=0.3, threshold_noise=0.2, static_gain_pA_per_kPa=150.0
)
LIVELY = Neuron(
    model="hamasaki2020",
    gain_spread=0.2,
    threshold_noise=0.1,
    static_gain_pA_per_kPa=300.0,
    intercept_pA=0.0,
)
TWO = """
[receptors]
spacing_mm = 2.0
[neuron]
adaptation = 0.2
intercept_pA = 18.0
[[afferents]]
name = "SA1"
[[afferents]]
name = "RA"
feels = "largest_stretch_rate"
[afferents.receptors]
side = "dermis"
[afferents.neuron]
threshold_mV = 20.0
"""


def test_a_population_of_another_model_has_its_constants():
    shared = {"gain_spread": 0.1, "static_gain_pA_per_kPa": 5.0}
    entries = [{"name": "one"}, {"name": "two", "neuron": {"model": "hamasaki2020"}}]
    study = Study.model_validate({"neuron": shared, "afferents": entries})
    one, two = (population.neuron for population in study.populations)
    assert one == Neuron(**shared)
    assert two == Neuron(model="hamasaki2020", gain_spread=0.1)


def histories(receptors=3, population=None):
    """Return a made-up trace in which every receptor feels something else."""
    time = np.sort(np.random.default_rng(0).uniform(0, 1, 40))
    wave = np.sin(4 * time)[:, None] * np.linspace(1, 2, receptors)
    trace = {
        "time_s": time,
        "moved_mm": np.stack([0 * wave, 0.1 * wave, 0.3 * wave], axis=-1),
        "sed_kPa": wave**2,
        "von_mises_kPa": 3 * np.abs(wave),
        "stretches": 1 + np.stack([-0.1 * wave**2, 0 * wave, 0.1 * wave**2], axis=-1),
        "stresses_kPa": np.stack([wave - 1, wave, wave + 1], axis=-1),
        "right_cauchy_green": ((1 + 0.1 * wave) ** 2)[..., None] * [1, 0, 2, 0, 0, 3],
        "directions": np.tile([1.0, 0.0, 0.0], (receptors, 1)),
    }
    if population is not None:
        trace["population"] = np.array(population)
    return trace


# --- what is felt ---------------------------------------------------------------------------------


def test_drives_are_what_their_names_say():
    trace = histories()
    wave = trace["stresses_kPa"][..., 1]
    expected = {
        "sed": wave**2,
        "von_mises": 3 * np.abs(wave),
        "largest_stretch": 0.1 * wave**2,
        "smallest_stretch": -0.1 * wave**2,
        "largest_stress": wave + 1,
        "smallest_stress": wave - 1,
        "pressure": -wave,
        "directed_stretch": 0.1 * wave,
        "compression": 0.1 * wave**2,
        "indentation": 0.3 * wave,
    }
    assert set(expected) == set(DRIVES)
    for name, value in expected.items():
        _, felt = drive_of(name).of(trace)
        np.testing.assert_allclose(felt, value, rtol=1e-12, atol=1e-15, err_msg=name)
        assert name in Afferents.model_fields["feels"].description


def test_rates_are_exact_for_lines_and_parabolas_at_uneven_times():
    trace = histories()
    time = trace["time_s"][:, None]
    trace["stresses_kPa"] = np.stack([2 - 3 * time, 5 * time, 5 * time**2 - time], axis=-1)
    np.testing.assert_allclose(drive_of("smallest_stress_rate").of(trace)[1], -3, rtol=1e-9)
    parabola = drive_of("largest_stress_rate")
    np.testing.assert_allclose(parabola.of(trace)[1], 10 * time - 1, rtol=1e-9)
    assert parabola.unit == "kPa/s" and parabola.label == "Rate of largest stress"
    two = {name: array[:2] for name, array in trace.items()}
    np.testing.assert_allclose(drive_of("smallest_stress_rate").of(two)[1], -3, rtol=1e-9)


def test_strain_energy_density_is_never_negative_but_a_stress_may_be():
    trace = histories()
    trace["sed_kPa"] = trace["sed_kPa"] - 1e-3
    with pytest.raises(StudyError, match="a strain energy density is never negative"):
        drive_of("sed").of(trace)
    assert (drive_of("smallest_stress").of(trace)[1] < 0).any()


def test_a_drive_that_cannot_be_told_is_named():
    trace = histories()
    for unknown in ("strain", "sed_rate_rate", "_rate"):
        with pytest.raises(StudyError, match=f'There is no drive "{unknown}"; there are sed, '):
            drive_of(unknown)
    old = {name: array for name, array in trace.items() if name != "stresses_kPa"}
    with pytest.raises(StudyError, match="Pressure: the histories have no stresses_kPa"):
        drive_of("pressure").of(old)
    flat = Drive("Touch", "1", lambda h: h["time_s"])
    with pytest.raises(StudyError, match=r"Touch has shape \(40,\)"):
        flat.of(trace)
    with pytest.raises(StudyError, match=r"Touch is nan at index \(0, 0\)"):
        Drive("Touch", "1", lambda h: h["sed_kPa"] * np.nan).of(trace)


# --- firing ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["hamasaki2020", "gerling2018"])
def test_a_population_fires_in_company_as_it_does_alone(model):
    neuron = LIVELY.model_copy(update={"model": model})
    kinds = [Population("SA1", NOISY), Population("RA", neuron, "smallest_stress")]
    trace = histories(6, ["SA1", "RA", "SA1", "RA", "RA", "SA1"])
    together = fire_all(kinds, trace)
    assert together.counts().min() > 0
    for kind in kinds:
        who = trace["population"] == kind.name
        time, felt = kind.drive.of(trace)
        own = {"time_s": time, "sed_kPa": felt[:, who]}
        alone = Population("x", kind.neuron, Drive("Felt", "1", lambda h: h["sed_kPa"])).fire(own)
        for a, b in zip(np.flatnonzero(who), alone.spikes, strict=True):
            np.testing.assert_array_equal(together.spikes[a], b)
    of_sed = respond(trace["time_s"], trace["sed_kPa"][:, [0, 2, 5]], NOISY).spikes
    for a, b in zip((0, 2, 5), of_sed, strict=True):
        np.testing.assert_array_equal(together.spikes[a], b)


def test_a_drive_sees_the_receptors_of_its_own_population_only():
    """The mean of SED within 1 mm, where two kinds lie at the same places: by hand, of RA alone."""

    def near(h):
        apart = np.linalg.norm(h["receptors_mm"][:, None] - h["receptors_mm"], axis=2) < 1.0
        return h["sed_kPa"] @ (apart / apart.sum(axis=1)).T

    trace = histories(6, ["SA1", "RA"] * 3)
    trace["receptors_mm"] = np.repeat([[0.0, 0, 0], [0.5, 0, 0], [9.0, 0, 0]], 2, axis=0)
    trace |= {"force_N": np.zeros((40, 3)), "phase": np.full(40, "slide")}
    sed = trace["sed_kPa"][:, 1::2]
    expected = np.column_stack([sed[:, :2].mean(axis=1)] * 2 + [sed[:, 2]])
    population = Population("RA", LIVELY, Drive("Near", "kPa", near))
    time, felt = population.felt(trace)
    np.testing.assert_allclose(felt, expected)
    assert time.shape == (40,) and (np.abs(near(trace)[:, 1::2] - expected) > 0.1).any()
    alone = {**trace, "receptors_mm": trace["receptors_mm"][1::2], "sed_kPa": sed}
    own = population.fire({name: alone[name] for name in ("time_s", "receptors_mm", "sed_kPa")})
    for a, b in zip(own.spikes, population.fire(trace).spikes, strict=True):
        np.testing.assert_array_equal(a, b)
    assert own.counts().min() > 0
    assert Population("PC", LIVELY, Drive("Near", "kPa", near)).fire(trace).spikes == []
    check_parts(Parts(populations=(replace(population, name="SA1"),)))


@pytest.mark.parametrize("columns", [3, 40])
def test_columns_of_receptors_are_told_from_those_of_steps(columns):
    """As many receptors as a vector has components, or as there are steps."""
    trace = histories(columns, ["SA1"] * (columns - 1) + ["RA"])
    trace |= {name: np.ones((40, 3)) for name in ("force_N", "stimulator_rad")}
    trace |= {"own": np.ones((40, columns)), "phase": np.full(40, "slide")}
    seen = {}
    Population("RA", LIVELY, Drive("Own", "1", lambda h: seen.update(h) or h["own"])).felt(trace)
    shapes = {name: seen[name].shape for name in ("force_N", "stimulator_rad", "phase", "own")}
    assert shapes == {"force_N": (40, 3), "stimulator_rad": (40, 3), "phase": (40,), "own": (40, 1)}
    assert seen["sed_kPa"].shape == (40, 1) and seen["stretches"].shape == (40, 1, 3)
    assert seen["population"].tolist() == ["RA"] and seen["directions"].shape == (1, 3)


def test_a_signed_history_needs_the_name_of_its_drive():
    time, signed = np.array([0.0, 0.5, 1.0]), np.array([[0.0], [-5.0], [5.0]])
    with pytest.raises(StudyError, match=r"^sed_kPa is -5 kPa .* other drives may be: name what"):
        respond(time, signed, LIVELY)
    with pytest.raises(StudyError, match='There is no drive "pull"'):
        respond(time, signed, LIVELY, feels="pull")
    with pytest.raises(StudyError, match=r"^Pressure is nan at index"):
        respond(time, signed * np.nan, LIVELY, feels="pressure")
    own = Drive("Strain", "%", lambda h: h["strain"])
    expected = Population("x", LIVELY, own).fire({"time_s": time, "strain": signed}).spikes[0]
    for feels in ("pressure", "sed_rate", own):
        (spikes,) = respond(time, signed, LIVELY, feels=feels).spikes
        np.testing.assert_array_equal(spikes, expected)
    assert len(expected) and expected.min() > 0.5  # what is negative inhibits


@pytest.mark.parametrize(
    ("neuron", "last_s"),
    [
        (Neuron(model="hamasaki2020", adaptation=0.0, dynamic_gain_pA_s_per_kPa=20.0), 1.1),
        (Neuron(model="hamasaki2020"), 2.0),  # what adapted to the negative drive rebounds
        (Neuron(model="gerling2018"), 2.0),
    ],
)
def test_a_negative_drive_inhibits_and_its_rise_excites(neuron, last_s):
    """Compression held, and released from 1.0 to 1.1 s."""
    trace = {
        "time_s": np.array([0.0, 0.5, 1.0, 1.1, 2.0]),
        "strain": -np.array([[0.0], [5.0], [5.0], [0.0], [0.0]]),
    }
    strain = Drive("Strain", "%", lambda h: h["strain"])
    (spikes,) = Population(neuron=neuron, feels=strain).fire(trace).spikes
    assert len(spikes) > 0 and spikes.min() > 1.0 and last_s - 0.1 < spikes.max() < last_s
    pulled = {**trace, "strain": -trace["strain"]}
    (spikes,) = Population(neuron=neuron, feels=strain).fire(pulled).spikes
    assert 0 < spikes.min() < 0.5 and np.any((spikes > 0.5) & (spikes < 1.0))


@dataclass(frozen=True)
class OnAndOff:
    """I = gain |dS/dt|."""

    gain: float

    def segments(self, time_s, drive):
        for k, h in enumerate(np.diff(time_s)):
            current = self.gain * np.abs(drive[k + 1] - drive[k]) / h
            none = np.empty((0, len(current)))
            yield Segment(time_s[k], h, ExponentialSum(current, 0 * current, none, np.empty(0)))


def test_a_transduction_and_a_drive_of_ones_own():
    feels = Drive("Touch", "1", lambda h: np.sqrt(h["sed_kPa"]))
    time = np.array([0.0, 0.5, 1.0, 1.5])
    sed = np.array([0.0, 4.0, 4.0, 0.0])[:, None] ** 2
    own = Population("RA", Neuron(), feels, OnAndOff(gain=5.0))
    trace = {"time_s": time, "sed_kPa": sed, "population": np.array(["RA"])}
    (spikes,) = fire_all([own], trace).spikes
    on, hold, off = (((spikes > a) & (spikes <= a + 0.5)).sum() for a in (0.0, 0.5, 1.0))
    assert on > 2 and hold == 0 and off == pytest.approx(on, abs=1)


@pytest.mark.parametrize("kind", ["RA", "PC"])
def test_no_gain_makes_fast_afferents_fire_faster_than_recorded_ones(kind):
    (one,) = Study.model_validate({"afferents": [{"name": kind, "kind": kind}]}).populations
    time_s = np.linspace(0.0, 0.1, 501)
    felt = np.sin(2 * np.pi * 100 * time_s)[:, None] * np.geomspace(0.1, 1000.0, 60)
    strong = Drive("Felt", "1", lambda h: h["felt"])
    fired = Population(kind, one.neuron, strong).fire({"time_s": time_s, "felt": felt})
    assert 200 < 1 / min(gaps.min() for gaps in fired.intervals() if len(gaps)) < 334


def test_a_warning_says_that_fast_afferents_fire_because_the_body_starts_at_once(caplog):
    from tactile_fem.simulation.run import _log_start

    (one,) = Study.model_validate({"afferents": [{"name": "PC", "kind": "PC"}]}).populations
    trace = SimpleNamespace(population=["PC"] * 4)
    for late_s in (0.004, 0.02):  # most of them only in the first case
        times = [np.array([t]) for t in (-0.098, -0.1 + late_s, -0.1 + late_s, 0.0)]
        _log_start([one.population()], trace, Response(times, -0.1, 0.5))
    (said,) = [record.getMessage() for record in caplog.records]
    assert said.startswith("3 of 4 PC afferents fire in the first 10 ms, because the body starts")


# --- studies --------------------------------------------------------------------------------------


def read(tmp_path, text, *overrides):
    path = tmp_path / "study.toml"
    path.write_text(text)
    return load_study(path, overrides)


def test_populations_take_what_they_lack_from_the_study(tmp_path):
    study = read(tmp_path, TWO, "afferents.RA.neuron.seed=7", "neuron.threshold_noise=0.1")
    sa1, ra = study.populations
    assert sa1 == Afferents(name="SA1", receptors=study.receptors, neuron=study.neuron)
    assert ra.feels == "largest_stretch_rate" and ra.receptors.side == "dermis"
    assert ra.receptors == study.receptors.model_copy(update={"side": "dermis"})
    own = {"threshold_mV": 20.0, "seed": 7}
    assert ra.neuron == study.neuron.model_copy(update=own)
    assert study.neuron.threshold_noise == 0.1
    resolved = tmp_path / "resolved.toml"
    resolved.write_text(dump_study(study))
    assert load_study(resolved) == study == Study.model_validate(study.model_dump())
    made = Study(
        receptors=study.receptors,
        neuron=study.neuron,
        afferents=(
            Afferents(name="SA1"),
            Afferents(
                name="RA",
                feels="largest_stretch_rate",
                receptors=Receptors(side="dermis"),
                neuron=Neuron(threshold_mV=20.0, seed=7, intercept_pA=None),
            ),
        ),
    )
    assert made == study


def test_without_afferents_there_is_one_population_and_no_word_of_it():
    study = Study(neuron=NOISY)
    (one,) = study.populations
    assert (one.name, one.feels, one.neuron) == ("SA1", "sed", NOISY)
    assert "afferents" not in study.model_dump() and "[[" not in dump_study(study)
    assert one.population() == Population("SA1", NOISY, "sed")


def test_drives_and_places_are_checked_before_a_scan(tmp_path):
    check(read(tmp_path, TWO))
    with pytest.raises(StudyError, match=r'afferents.RA.feels: There is no drive "strain"'):
        check(read(tmp_path, TWO, "afferents.RA.feels=strain"))
    with pytest.raises(StudyError, match=r"afferents.RA.receptors: .* X 30, Y 0 mm lies outside"):
        check(read(tmp_path, TWO, "afferents.RA.receptors.extra_mm=[[30.0, 0.0]]"))
    with pytest.raises(ValidationError, match='There is no drive "speed"'):
        Study(afferents=[Afferents(name="RA", feels="speed")])
    with pytest.raises(StudyError, match='no afferents "PC", only SA1, RA'):
        replaced([Population("SA1"), Population("RA")], [Population("PC")])


def test_a_registered_drive_can_be_named_in_a_study(tmp_path, monkeypatch):
    with monkeypatch.context() as script:
        script.setitem(DRIVES, "squeeze", Drive("Squeeze", "1", lambda h: h["sed_kPa"]))
        study = read(tmp_path, TWO, "afferents.RA.feels=squeeze_rate")
        check(study)
        assert study.populations[1].population().drive.unit == "1/s"
    # Elsewhere its results can be read, though it cannot be scanned.
    results = make_results(tmp_path / "r", study)
    assert Results.open(results.folder).study == study
    with pytest.raises(StudyError, match=r"afferents.RA.feels: .* no drive"):
        check(study)


@pytest.mark.parametrize(
    ("tables", "sentence"),
    [
        (
            {"receptors": {"placement": "papillae"}},
            'receptors.placement = "papillae" needs a section with papillae',
        ),
        (
            {"finger": {"kind": "section"}, "receptors": {"end_organs": 3}},
            "receptors.end_organs = 3 do not lie in the plane of a section",
        ),
        (
            {"afferents": [{"name": "a"}, {"name": "b", "receptors": {"placement": "papillae"}}]},
            'afferents.b.receptors.placement = "papillae" needs a section',
        ),
        (
            {"afferents": [{"name": "a", "receptors": {"spacing_mm": 1e-9}}]},
            "afferents (entry 1).receptors: 1e+10 receptors are more than 100,000; choose",
        ),
    ],
)
def test_receptors_that_no_such_finger_has_are_refused_when_the_study_is_made(tables, sentence):
    with pytest.raises(ValidationError) as caught:
        Study.model_validate(tables)
    assert in_words(caught.value).startswith(sentence) and "\n" not in in_words(caught.value)


# --- results --------------------------------------------------------------------------------------


def two_kinds(folder, study):
    """Write results of SA1 at 7 places and RA at 5 others, the RA firing as the study says."""
    sa1, ra = make_trace(np.arange(-3.0, 4.0)), make_trace(np.arange(-2.0, 3.0) * 0.5)
    stretch = 1 + np.hypot(*np.meshgrid(0.3 * ra["sed_kPa"][:, 0], np.arange(12), indexing="ij"))
    trace = {
        **sa1,
        "receptors_mm": np.concatenate([sa1["receptors_mm"], ra["receptors_mm"]]),
        "population": np.repeat(["SA1", "RA"], [7, 5]),
        "moved_mm": np.hstack([sa1["moved_mm"], ra["moved_mm"]]),
        "sed_kPa": np.hstack([sa1["sed_kPa"], 2 * ra["sed_kPa"]]),
        "stretches": np.stack([1 / stretch, stretch**0, stretch], axis=-1),
    }
    results = make_results(folder, study, trace)
    populations = [afferents.population() for afferents in study.populations]
    spikes = fire_all(populations, results.trace).spikes
    results.save_spikes(spikes, SimpleNamespace(**results.trace))
    return results


def test_spikes_and_trace_know_their_population(tmp_path):
    results = two_kinds(tmp_path / "r", read(tmp_path, TWO, "afferents.RA.feels=sed"))
    again = Results.open(results.folder)
    assert again.trace["population"].tolist() == ["SA1"] * 7 + ["RA"] * 5
    names = again.trace["population"][again.spikes.receptor]
    assert set(names) == {"SA1", "RA"} and again.spikes.population.tolist() == names.tolist()
    assert again.receptors_of("RA").tolist() == [7, 8, 9, 10, 11]
    with pytest.raises(StudyError, match="has no afferents PC, only SA1, RA"):
        again.receptors_of("PC")
    with pytest.raises(ValueError, match="population"):
        again.save_trace(**{**again.trace, "population": np.array(["SA1"])})
    numbers = numbers_of(again)
    assert numbers["spikes_SA1"] + numbers["spikes_RA"] == numbers["spikes"]
    assert numbers["spikes_RA"] > 0


def test_older_folders_have_one_population(tmp_path):
    results = make_results(tmp_path / "r")
    path = results.folder / "spikes.csv"
    old = [line.rsplit(",", 1)[0] for line in path.read_text().splitlines()]
    path.write_text("\n".join(old) + "\n")
    again = Results.open(results.folder)
    with np.load(results.folder / "trace.npz") as kept:
        assert "population" not in kept
    assert set(again.trace["population"]) == set(again.spikes.population) == {"SA1"}
    assert len(again.spikes.time_s) == 21 * 5
    assert "spikes_SA1" not in numbers_of(again)


def test_figures_show_all_populations_and_are_removed_with_them(tmp_path, caplog, monkeypatch):
    with monkeypatch.context() as script:
        script.setitem(DRIVES, "unheard_of", Drive("", "", lambda h: h["sed_kPa"]))
        study = read(tmp_path, TWO, "afferents.RA.feels=unheard_of")
    with pytest.raises(StudyError, match="unheard_of"):
        _ = study.populations[1].population().drive
    results = two_kinds(tmp_path / "r", read(tmp_path, TWO, "afferents.RA.feels=sed"))
    wanted = {"force.png", "felt.png", "raster.png", "firing.png"}
    assert {path.name for path in draw_plots(results)} == wanted
    results.save_study(study)
    assert {path.name for path in draw_plots(results)} == wanted
    Results.create(results.folder, overwrite=True)
    assert not list(results.folder.rglob("*.png"))


def test_spike_trains_of_neo_know_kind_population_and_place(tmp_path):
    pytest.importorskip("neo")
    results = two_kinds(tmp_path / "r", read(tmp_path, TWO, "afferents.RA.kind=RA"))
    trains = results.to_neo().spiketrains
    names, places = results.trace["population"], results.trace["receptors_mm"]
    assert len(trains) == len(names) > 2
    for number, train in enumerate(trains):
        assert train.annotations["population"] == names[number]
        assert train.annotations["kind"] == names[number]  # they are called after it
        np.testing.assert_array_equal(train.annotations["receptor_mm"], places[number])
        assert len(train) == np.sum(results.spikes.receptor == number)


def test_passes_over_one_receptor_of_each_population(tmp_path):
    study = read(tmp_path, TWO, "afferents.RA.feels=sed", "afferents.RA.neuron.threshold_mV=25")
    members = single_fibre(study, spacing_mm=1.0, half_width_mm=1.0)
    passes = []
    for member in members:
        assert all(a.receptors.half_width_mm == 0 for a in member.study.populations)
        x = -member.study.stimulus.shift_mm[0]
        one = make_trace(np.array([0.0, 0.0]))
        one["sed_kPa"] = one["sed_kPa"] * [1.0, 2.0] * np.exp(-(x**2))
        one["population"] = np.array(["SA1", "RA"])
        passes.append(make_results(tmp_path / member.name, member.study, one))
    ra = fibre_image(passes, population="RA")
    trace = passes[1].trace
    alone = Population("RA", study.populations[1].neuron).fire(trace).spikes[0]
    np.testing.assert_allclose(ra.response.spikes[1], alone[alone >= 0], atol=1e-9)
    assert ra.response.counts()[1] > fibre_image(passes).response.counts()[1] > 0

"""Scripts that compare with people and with recorded afferents, at small size."""

from __future__ import annotations

import csv
import re
from itertools import pairwise

import numpy as np
import pytest
from blocks import block_mesh
from needs import needs_gmsh
from scripts import DEMOS, SMALL, beside, imports, number, run

from tactile_fem.study import Neuron, Study


@pytest.mark.parametrize("path", sorted(DEMOS.glob("validation/*.py")), ids=lambda path: path.stem)
def test_what_a_script_imports_exists(path):
    imports(path)


def table(path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


# --- the finger ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_predictions(tmp_path):
    way = ["--depth", "0.3", "--forces", "0.02", "0.05", "--distance", "0.2", "--deepest", "0.5"]
    way += ["--drag", "0.05", "--stiffness-forces", "0.02", "--stiffness-forces", "0.05", *SMALL]
    output = run("validation/predictions.py", str(tmp_path), *way)
    assert len(output.splitlines()) == len(table(tmp_path / "predictions.csv")) == 11
    assert number(r"plate, 0\.5 mm .* N, ([+-][\d.]+) sd", output) == pytest.approx(0, abs=1)
    assert number(r"letters at 0\.3 mm, 20 mm/s \|.*\| ([\d.]+) N", output) > 0
    assert 0 < number(r"compression of epidermis, 0\.05 N \| > 20 % \| ([\d.]+)%", output) < 20
    assert 0 < number(r"volume lost, plate at 0\.05 N \| at most 5% \| ([\d.]+)%", output) < 5


@pytest.mark.slow
def test_slip_spreads_from_the_rim():
    from tactile_fem.study import Finger

    with beside(DEMOS / "validation" / "slip.py"):
        from slip import drag, full_slip

        steps = list(drag(Finger(pad_size_mm=3.0, far_size_mm=6.0), 0.05, 0.3, 1.0))
        end = full_slip(steps)
    assert steps[0].stuck > steps[-1].stuck
    assert steps[-1].tangential_N == pytest.approx(0.3 * 0.05, rel=0.02)  # all of it slips
    assert end.skin_mm < 1


def test_skin_that_turns_with_the_plate_sticks():
    """Skin within 3 mm of the axis turns with the plate, that from there to 5 mm stays."""
    from tactile_fem.finger.mesh_data import SURFACES
    from tactile_fem.path.rotations import matrix

    line = np.linspace(-6, 6, 41)
    mesh = block_mesh(line, line, np.array([0.0, 1.0]), ["dermis"])
    middles = np.unique(mesh.facets[mesh.surface == SURFACES["skin"], 3:])
    distance, turn = np.hypot(*mesh.nodes[:, :2].T), np.array([0.0, 0.0, 0.02])
    bound = np.zeros_like(mesh.nodes)
    bound[middles, 2] = distance[middles] < 5
    before = mesh.nodes @ matrix(5 * turn).T - mesh.nodes
    with_plate = mesh.nodes @ matrix(6 * turn).T - mesh.nodes
    now = np.where(distance[:, None] < 3, with_plate, before)
    with beside(DEMOS / "validation" / "torsion.py"):
        from torsion import slip_of

        sliding, *rim = slip_of(mesh, before, now, bound, turn)
        assert slip_of(mesh, before, before, bound, turn)[1] == 1
        assert slip_of(mesh, before, with_plate, bound, turn)[1] == 0
    assert sliding == pytest.approx(bound[:, 2] @ distance, rel=1e-12)
    assert rim == pytest.approx([1 - 9 / 25, 2 / 3 * (125 - 27) / (25 - 9), 2], rel=0.02)


@pytest.mark.slow
def test_torsion(tmp_path):
    output = run("validation/torsion.py", str(tmp_path / "new"), "--forces", "0.05", *SMALL)
    assert number(r"0\.05 N: 95% of the torque at ([\d.]+) deg", output) < 10
    last = table(tmp_path / "new" / "torsion.csv")[-1]
    assert float(last["torque_Nmm"]) == pytest.approx(float(last["sliding_Nmm"]), rel=0.06)
    assert (tmp_path / "new" / "torsion.png").stat().st_size > 10_000


@pytest.mark.slow
@needs_gmsh
def test_relaxation(tmp_path):
    way = ["--press", "0.4", "--depth", "0.3", "--pad-size", "4", "--far-size", "8"]
    output = run("validation/relaxation.py", str(tmp_path), *way, "--outputs", "2")
    rows = output.splitlines()
    assert len(table(tmp_path / "relaxation.csv")) == len(rows) == 8
    assert 0 < number(r"fall of 0\.05 N.*\| ([\d.]+)% \|", output) < 30
    fast, slow = (number(rf"tap of {ms} ms.*\| ([\d.]+)% \|", output) for ms in (110, 220))
    assert 30 < fast < 90 and 30 < slow < 90
    assert "| faster is stiffer | " in output and rows[4].endswith("| yes |")
    relaxes, creeps = re.search(r"([\d.]+) and ([\d.]+) s, [\d.]+ times", output).groups()
    assert float(creeps) > float(relaxes) > 0


@pytest.mark.slow
def test_impedance(tmp_path):
    way = [
        "--forces",
        "0.05",
        "--forces",
        "0.1",
        "--frequencies",
        "20",
        "--viscous-time",
        "0.004",
        *SMALL,
    ]
    output = run("validation/impedance.py", str(tmp_path), *way)
    low, high = table(tmp_path / "impedance.csv")
    assert 0 < float(low["k"]) < float(high["k"]) < float(high["law_k"])
    assert float(low["law_b"]) == pytest.approx(1.78 * 0.05**0.35, rel=1e-4)
    assert 0 < number(r"20 Hz: k as P\^([\d.]+)", output) < 1


@pytest.mark.slow
def test_tangential_energy():
    output = run("validation/tangential_energy.py", "--forces", "0.05", "--distance", "0.5", *SMALL)
    assert 0 < number(r"in all: tissue [\d.]+ mJ, ([\d.]+) % outside", output) < 100


@pytest.mark.slow
@needs_gmsh
def test_fit_of_relaxation(tmp_path):
    way = ["--fit", "--evaluations", "1", "--pad-size", "4", "--far-size", "8", "--outputs", "1"]
    output = run("validation/relaxation.py", str(tmp_path), *way)
    tried = table(tmp_path / "fit.csv")
    assert len(tried) == 4  # the start, and one for the derivative by each share
    falls = [float(row["fall of 0.2 N"]) for row in tried]
    assert falls[3] > falls[0]  # a larger share of the longest time
    assert number(r"g of 1\.4 s: ([\d.]+) ±", output) == pytest.approx(0.15, abs=1e-3)


@pytest.mark.slow
def test_sensitivity(tmp_path):
    way = ["--plate-depth", "0.5", "--depth", "0.2", "--distance", "0.1", *SMALL]
    output = run("validation/sensitivity.py", str(tmp_path), *way)
    change = re.search(r"epidermis\.C10_MPa +([+-][\d.]+) +([+-][\d.]+)", output)
    assert change and 0 < float(change[1]) < 10 and 0 < float(change[2]) < 10
    assert -10 < number(r"subcutaneous\.D1_per_MPa +([+-][\d.]+)", output) < 0


# --- afferents -----------------------------------------------------------------------------------


@pytest.mark.slow
@needs_gmsh
def test_histories(tmp_path):
    stimuli = "bar", "periodic_4_edge", "sphere_521"
    named = [part for name in stimuli for part in ("--stimuli", name)]
    command = "validation/histories.py", str(tmp_path), "--pad-size", "0.9", "--step", "0.1", *named
    output = run(*command)
    assert number(r"sphere_521: ([\d.]+) N", output) == pytest.approx(0.196, abs=1e-3)
    assert number(r"periodic_4_edge: .* at ([\d.]+) mm", output) == pytest.approx(0.325)
    bar, ball = (np.load(tmp_path / f"{name}.npz") for name in ("bar", "sphere_521"))
    assert sorted(bar["y_mm"]) == pytest.approx([0.1 * k - 3.2 for k in range(65)])
    assert not bar["x_mm"].any()
    assert bar["time_s"][-1] == pytest.approx(0.1)
    kept = np.load(DEMOS / "validation" / "histories" / "bar.npz")
    assert bar["force_N"][-1] == pytest.approx(kept["force_N"][-1], rel=0.1)
    for name in ("sed_kPa", "stretch", "compression_kPa", "area", "cluster_sed_kPa"):
        assert bar[name].shape == (len(bar["time_s"]), 65)
        assert np.corrcoef(bar[name][-1], kept[name][-1])[0, 1] > 0.8
    for force in (0.098, 0.147):
        assert np.abs(ball["force_N"] - force).min() < 1e-3
    assert run(*command) == ""  # what exists is not computed again


def test_calibrate(tmp_path):
    output = run("validation/calibrate.py", str(tmp_path))
    n = Neuron()
    for name in ("static_gain_pA_per_kPa", "power", "fast_adaptation", "adaptation"):
        assert getattr(n, name) == pytest.approx(
            number(rf"(?m)^{name} +([\d.e+]+)", output), rel=0.01
        )
    assert number(r"spheres \(21\) \| .* \| R² ([\d.]+)", output) > 0.85
    assert number(r"textures \(8\) \| .* \| R² ([\d.]+)", output) > 0.45
    assert 0.5 < number(r"left after 12 s, 1.3 mm \| 0.64 \| ([\d.]+)", output) < 0.75
    assert output.count("| grating of ") == 6
    assert len(table(tmp_path / "rates.csv")) == output.count("\n| ") - 2  # but for the heading


def test_a_law_is_fitted_to_all_experiments_and_to_all_but_each(tmp_path):
    way = "--felt", "sed", "--how", "power", "--slow", "60"
    run("validation/laws.py", str(tmp_path), *way)
    (row,) = table(tmp_path / "laws.csv")
    assert (row["felt"], row["how"], row["constants"]) == ("sed", "power", "4")
    for name in ("bar", "spheres", "decline", "textures"):
        own, others = float(row[name]), float(row[f"{name}_predicted"])
        assert others <= own + 0.05 and own > 0.45


def test_rates_are_drawn(tmp_path):
    run("validation/rates_figure.py", str(tmp_path / "rates.png"))
    assert (tmp_path / "rates.png").stat().st_size > 10_000


def test_recorded_rates_on_textures_agree_with_all_that_is_asked_of_the_model():
    with beside(DEMOS / "validation" / "textures.py"):
        from textures import CLAIMS, recorded

        rates = recorded()
    for claim in CLAIMS:
        value = claim.of(rates[claim.kind], rates["SA1"])
        assert claim.holds(value, value), claim.text
        if claim.agrees == "order":
            assert not claim.holds(claim.of(np.full(8, 50.0), rates["SA1"]), value)


def test_a_kept_period_is_repeated():
    with beside(DEMOS / "validation" / "texture_firing.py"):
        from felt_quantities import FELT
        from recordings import SURFACES, Kept
        from texture_firing import mean_rates

        at = np.linspace(0, 3, 31)
        wave = 3 + 2 * np.sin(2 * np.pi * at / 3)
        drift = wave + 0.1 * at / 3
        felt = np.column_stack([wave, drift, 0 * at])
        kept = Kept("one", {"dots_3.slide_mm": at, "dots_3.sed_kPa": felt})
        replayed = kept.felt("dots_3", FELT["sed"], np.array([0.75, 3.75, 30.75]))
        assert replayed[:, 0] == pytest.approx([5.0] * 3, abs=1e-2)
        assert replayed[:, 1] == pytest.approx([5.1] * 3, abs=1e-2)  # as it is at the end
        rates = mean_rates([kept], "SA1", 80.0, duration_s=1.5)
    assert np.isfinite(rates).tolist() == [[name == "dots_3" for name in SURFACES]]
    assert 1 < np.nanmean(rates) < 200


def test_the_default_sa1_tells_fine_from_coarse_textures(tmp_path):
    output = run("validation/textures.py", str(tmp_path), "--speeds", "80")
    rows = [row for row in table(tmp_path / "rates.csv") if row["kind"] == "SA1"]
    model = {row["surface"]: float(row["model_Hz"]) for row in rows if "0.74" in row["histories"]}
    assert len(model) == 8 and max(model, key=model.get) == "dots_3"
    assert min(model, key=model.get) == "grating_3"
    assert number(r"SA1: 2 mm dots over 3 mm grating \(ratio\) \| 6\.50 \| ([\d.]+)", output) > 1.5
    assert (tmp_path / "textures.png").stat().st_size > 10_000


@pytest.mark.slow
@needs_gmsh
def test_what_textures_are_felt_as(tmp_path):
    way = ["--pad-size", "0.9", "--surfaces", "grating_3", "--output", "0.3"]
    command = "validation/texture_histories.py", str(tmp_path), *way, "--conditions", "0.2,0.05"
    output = run(*command)
    assert number(r"grating_3: force ([\d.]+) N", output) == pytest.approx(0.05, rel=0.05)
    kept = np.load(tmp_path / "0.2mm_0.05N.npz")
    sed = kept["grating_3.sed_kPa"]
    assert kept["grating_3.slide_mm"][[0, -1]] == pytest.approx([0, 3], abs=1e-5)
    assert sed[0] == pytest.approx(sed[-1], rel=0.15, abs=0.15 * float(sed.std()))
    assert kept["grating_3.cluster_sed_kPa"].shape == sed.shape
    assert run(*command) == ""  # what exists is not computed again


@pytest.mark.slow
@needs_gmsh
def test_strains(tmp_path):
    options = "--forces", "0.005", "--edge-force", "0.005", "--pad-size", "0.1175"
    output = run("validation/strains.py", str(tmp_path), *options)
    assert 50 < number(r"plate, ridged, 0.*; (\d+) % of the ridges", output) < 100
    proximal, distal = re.search(r"corneum: shear (\S+) and (\S+),", output).groups()
    assert float(proximal) * float(distal) < 0


def vibrating(kind):
    """Return a site that feels 1 kPa, 0.5 of compression, or 1 mm per mm of a probe."""
    from vibration_firing import Site

    from tactile_fem.vibration import Spectrum

    rest, of_one = np.zeros((1, 3)), np.ones((2, 1, 3), dtype=complex)
    spectrum = Spectrum(
        frequency_Hz=np.array([20.0, 50.0]),
        motion=np.array([0.0, 0.0, 1.0]),
        receptors_mm=rest,
        population=np.array([kind]),
        moved=of_one,
        sed_kPa=of_one[:, :, 0],
        stretches=-0.5 * of_one,
        force_N=of_one[:, 0],
        still_moved_mm=rest,
        still_sed_kPa=np.ones(1),
        still_stretches=rest + 1.0,
    )
    return Site(spectrum, kind)


def test_cycles_of_afferents_are_means_over_gains_of_whole_cycles():
    with beside(DEMOS / "validation" / "vibration.py"):
        from vibration_firing import quantiles

        site = vibrating("RA")
        ra = Study.model_validate({"afferents": [{"name": "RA", "kind": "RA"}]}).afferents[0].neuron
        each = [
            site.cycles_of_one(ra, 20.0, [100.0 * gain])[0]
            for gain in quantiles(ra.gain_spread, 11)
        ]
        assert site.cycles(ra, 20.0, [100.0]) == pytest.approx(np.mean(each), abs=0.02)
        assert site.cycles(ra, 20.0, [0.0, 1e4])[1] > 1 > site.cycles(ra, 20.0, [0.0])[0]


@pytest.mark.parametrize("kind", ["RA", "PC"])
def test_the_threshold_of_a_vibration_is_where_an_afferent_begins_to_fire(kind):
    with beside(DEMOS / "validation" / "vibration.py"):
        from vibration_fit import thresholds_of

        site, afferents = vibrating(kind), {"afferents": [{"name": kind, "kind": kind}]}
        n = Study.model_validate(afferents).afferents[0].neuron
        unit_um = 1000 * n.threshold_mV / n.resistance_GOhm / n.filter_gain_pA
        for f, level in zip((20.0, 50.0), unit_um * thresholds_of(site, n), strict=True):
            below, above = site.cycles_of_one(n, f, [0.97 * level, 1.05 * level])
            assert below == 0 < above


@pytest.mark.slow
def test_vibration(tmp_path):
    way = ["--depth", "0.3", "--human-depth", "0.2", "--ramp", "0.3", "--hold", "0.05", *SMALL]
    output = run("validation/vibration.py", str(tmp_path), *way, "--rounds", "0")
    assert 10 <= number(r"RA best frequency: (\d+) Hz", output) <= 100
    assert 100 <= number(r"PC best frequency: (\d+) Hz", output) <= 500
    assert number(r"RA 50 Hz, fitted: .*rms (\d+)", output) < 25
    assert number(r"RA entrainment .* 66 µm 1 ([\d.]+)", output) == pytest.approx(1, abs=0.2)
    assert number(r"SA1 humans, radius 3 mm, amplitude, predicted: 1 Hz 2.1 ([\d.]+)", output) >= 0
    assert len(table(tmp_path / "responses.csv")) > 80


def pushed(folder, order):
    """Write what six afferents would feel: each SA1 and SA2 feels the force in one direction."""
    from manipulation_firing import BACKGROUND_N, COUNTED_S, LOAD_S, LOADS, RISE_S, SETTLING_S
    from manipulation_firing import sequence as loads_of

    time, force = [-SETTLING_S], [(0.0, 0.0, BACKGROUND_N)]
    for k, load in enumerate(loads_of(order)):
        x, y = LOADS[load]
        for after, share in ((0, 0), (RISE_S, 1), (COUNTED_S, 1), (LOAD_S - 0.25, 0)):
            time.append(k * LOAD_S + after + 1e-9)
            force.append((share * x, share * y, BACKGROUND_N + share * 3.8))
    time.append(len(loads_of(order)) * LOAD_S)
    force = np.array([*force, force[0]])
    x, y, z = force.T
    # The second SA2 feels more in the other order, as if the load before had stretched it.
    more = 0.1 * z if order == "two" else 0 * z
    felt = np.column_stack([0.2 * z, 0 * z, np.maximum(y, 0), 0 * z, -0.1 * y, more])
    np.savez(
        folder / f"{order}.npz",
        time_s=time,
        force_N=force,
        stimulator_mm=force * [1, 1, 0.5] + (0.1 if order == "two" else 0.0),
        receptors_mm=np.arange(18.0).reshape(6, 3) - 9,
        population=np.repeat(["RA", "SA1", "SA2"], 2),
        felt=felt,
    )


def test_manipulation_draws_what_the_load_before_changes(tmp_path):
    with beside(DEMOS / "validation" / "manipulation_firing.py"):
        for order in ("one", "two"):
            pushed(tmp_path, order)
    output = run("validation/manipulation.py", str(tmp_path))
    shares = {
        kind: [float(share) for share in re.findall(r"(\d+) %", row)]
        for kind, row in re.findall(r"^\| (RA|SA1|SA2) \|(.*)$", output, re.M)
    }
    assert shares["SA1"] == [100, 0, 0, 0, 0, 0]  # of the directions, and of what changes
    assert shares["SA2"][1] > 0 and shares["SA2"][4] >= 50 and shares["SA2"][5] >= 50
    assert re.search(r"\| distal \| 0.00, 1.40; 0.00, 1.40 \| 0.0; 0.0 \| 0.141 \|", output)
    assert number(r"without a load: (\d) of 2", output) <= 2
    rows = table(tmp_path / "afferents.csv")
    assert [row["kind"] for row in rows] == ["RA", "RA", "SA1", "SA1", "SA2", "SA2"]
    assert int(rows[2]["distal_one"]) > 0 == int(rows[2]["proximal_one"])
    for picture in ("way", "rates", "directions", "pairs"):
        assert (tmp_path / f"{picture}.png").stat().st_size > 10_000


def test_each_load_of_manipulation_follows_another_one_in_the_other_order():
    imports_mechanics = DEMOS / "validation" / "manipulation_histories.py"
    with beside(imports_mechanics):
        from manipulation_firing import COUNTS, LOAD_S, LOADS, SETTLING_S, sequence
        from manipulation_histories import study

        studies = [study(order, {}) for order in ("one", "two")]
        pairs = [{*pairwise(sequence(order))} for order in ("one", "two")]
    assert len(pairs[0] | pairs[1]) == 2 * len(LOADS)
    for one in studies:
        pieces = one.protocol.pieces[1:]
        assert sum(piece.time_s for piece in pieces) == pytest.approx(SETTLING_S + 6 * LOAD_S)
        assert max(piece.normal_N for piece in pieces) == 4.0
        assert [each.receptors.count for each in one.populations] == list(COUNTS.values())


def test_spread_of_few_people():
    """Of many people whose forces are log-normal the variation is known; few scatter about it."""
    with beside(DEMOS / "validation" / "people.py"):
        from people import measured, rows_of, spread_of_few, variation
    force = np.exp(0.4 * np.random.default_rng(0).standard_normal((4000, 4)))
    assert variation(force) == pytest.approx(np.sqrt(np.exp(0.4**2) - 1), rel=0.1)
    few = spread_of_few(force, 4)
    assert few.shape[1] == 4 and np.quantile(few, 0.05) < 0.3 < np.quantile(few, 0.95)
    plate = measured()["plate"]
    assert plate.mean[-1] == 0.769
    assert {row["met"] for row in rows_of("plate", plate, force)} == {"yes"}
    nearly_equal = 1 + 1e-3 * force
    assert {row["met"] for row in rows_of("plate", plate, nearly_equal)} == {"**missed**"}


@pytest.mark.slow
@needs_gmsh
def test_people(tmp_path):
    output = run("validation/people.py", str(tmp_path), "--number", "2", "--deepest", "0.5", *SMALL)
    assert len(re.findall(r"^\| (?:plate|probe|sphere) \| 0\.\d+ \|", output, re.M)) == 4

"""Vibration of a scanned finger: what receptors feel, states that were kept, bad input."""

from __future__ import annotations

import csv
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from needs import needs_graphics
from PIL import Image

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from tactile_fem.cli.app import main
from tactile_fem.errors import StoppedError, StudyError
from tactile_fem.finger import TISSUES
from tactile_fem.output.film import Film
from tactile_fem.output.pictures import frames_of
from tactile_fem.results.results import Results
from tactile_fem.simulation.run import scan
from tactile_fem.study import Joint, Study
from tactile_fem.vibration import Modes, Spectrum, few_of, frequencies_of, nearest
from tactile_fem.vibration.vibrate import ModeKeeper, vibrate

KINDS = [
    {"name": kind, "kind": kind, "receptors": {"half_width_mm": 1.0, "spacing_mm": 1.0}}
    for kind in ("SA1", "RA", "PC")
]
STUDY = Study.model_validate(
    {
        "finger": {"pad_size_mm": 3.0, "far_size_mm": 6.0},
        "stimulus": {"kind": "plate", "friction": 0.0},
        "protocol": {"depth_mm": 0.4, "distance_mm": 0.2, "output_mm": 0.1},
        "afferents": KINDS,
        "output": {"pictures": False, "restarts": True, "states_mm": 0.2},
    }
)
SLOW_HZ = 0.01


@pytest.fixture(scope="module")
def scanned(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("scanned")
    scan(STUDY, folder, comm=MPI.COMM_SELF)
    return folder


@pytest.fixture(scope="module")
def vibrations(scanned) -> dict[str, tuple[Spectrum, Modes]]:
    """Vibrations of the body and of the bone, with the finger's shape at the lowest frequency."""
    found = {}
    for moves in ("body", "bone"):
        keeper = ModeKeeper([SLOW_HZ])
        frequencies = [SLOW_HZ, 30.0, 300.0]
        options = {"moves": moves, "observers": [keeper], "comm": MPI.COMM_SELF}
        found[moves] = vibrate(scanned, frequencies, **options), keeper.modes()
    return found


@pytest.fixture(scope="module")
def spectrum(vibrations) -> Spectrum:
    return vibrations["body"][0]


@pytest.fixture(scope="module")
def modes(vibrations) -> Modes:
    return vibrations["body"][1]


def pressed(depth_mm: float, folder: Path | None = None, joint: Joint | None = None):
    """Return the history of a slow press: tissue has no memory but milliseconds of viscosity."""
    path = [{"kind": "press", "depth_mm": depth_mm, "speed_mm_s": 0.2}]
    changed = {"protocol": {"path": path}, "output": {"pictures": False}, "joint": joint}
    study = Study.model_validate({**STUDY.model_dump(), **changed})
    return scan(study, folder, comm=MPI.COMM_SELF).trace


@pytest.mark.parametrize("joint", [None, Joint(stiffness_Nmm_rad=20.0)])
def test_slowly_it_is_the_slope_of_the_press(joint, tmp_path):
    depth, step = STUDY.protocol.depth_mm, 0.002
    low, high = pressed(depth - step, joint=joint), pressed(depth + step, joint=joint)
    pressed(depth, tmp_path / "middle", joint)
    found = vibrate(tmp_path / "middle", [SLOW_HZ], comm=MPI.COMM_SELF)
    force = (high.force_N[-1, 2] - low.force_N[-1, 2]) / (2 * step)
    assert found.force_N[0, 2].real == pytest.approx(force, rel=0.01)
    sed = (high.sed_kPa[-1] - low.sed_kPa[-1]) / (2 * step)
    np.testing.assert_allclose(found.sed_kPa[0].real, sed, atol=0.01 * sed.max())
    moved = (high.moved_mm[-1] - low.moved_mm[-1]) / (2 * step)
    # A scan's motion is as seen from the bone, that of a vibration is in space.
    arms = (joint or Joint()).arms(found.receptors_mm + found.still_moved_mm)
    of_bone = found.moved[0].real - moved
    turn = np.sum(arms * of_bone) / np.sum(arms**2)
    np.testing.assert_allclose(of_bone, turn * arms, atol=0.01)
    assert (abs(turn) > 0.02) == (joint is not None)


def test_all_kinds_feel_it_and_inertia_counts_at_high_frequencies(spectrum):
    assert list(spectrum.population) == ["SA1"] * 3 + ["RA"] * 3 + ["PC"] * 3
    slow, middle, fast = np.abs(spectrum.moved[:, 7, 2])
    assert 0.2 < slow < 1 and slow == pytest.approx(middle, rel=0.05)
    assert fast != pytest.approx(slow, rel=0.05)
    assert np.abs(spectrum.sed_kPa).min() > 0


def test_the_body_and_the_bone_are_the_same_to_slow_tissue(vibrations, spectrum):
    of_bone, _ = vibrations["bone"]
    np.testing.assert_allclose(of_bone.force_N[0], -spectrum.force_N[0], rtol=1e-6)
    np.testing.assert_allclose(of_bone.moved[0], [0, 0, 1] - spectrum.moved[0], atol=1e-6)


def test_every_node_moves_with_the_body_or_with_the_bone(vibrations, modes):
    assert modes.frequency_Hz.tolist() == [SLOW_HZ]
    assert modes.moved.shape == (1, *modes.nodes_mm.shape) and modes.moved.dtype == np.complex64
    hard = np.unique(modes.tets[modes.tissue == TISSUES["bone"]])
    np.testing.assert_array_equal(modes.moved[0, hard], 0)
    lowest = (modes.nodes_mm + modes.still_mm)[:, 2].argmin()
    assert modes.moved[0, lowest, 2] == pytest.approx(1, abs=0.05)
    _, of_bone = vibrations["bone"]
    np.testing.assert_allclose(of_bone.moved[0], [0, 0, 1] - modes.moved[0], atol=1e-5)
    assert of_bone.body.tolist() == [0, 0, 0] and modes.body.tolist() == [0, 0, 1]
    assert modes.stimulator_mm[2] == pytest.approx(STUDY.protocol.depth_mm, abs=1e-9)


def test_shapes_are_kept_at_few_frequencies():
    assert few_of([1, 1000, 30, 10]).tolist() == [1, 30, 1000]
    assert few_of([5]).tolist() == [5]
    assert nearest([1, 10, 100], [30, 40, 2]).tolist() == [0, 1, 2]


def test_the_largest_phase_is_that_of_the_largest_displacement(modes):
    turned = replace(modes, moved=modes.moved * np.exp(-0.7j).astype(np.complex64))
    swing = np.exp(1j * turned.largest_phase(0))
    largest = np.linalg.norm(np.real(turned.moved[0] * swing))
    assert largest == pytest.approx(np.linalg.norm(turned.moved[0]), rel=1e-3)


@needs_graphics
def test_a_vibration_is_drawn_as_much_larger_as_it_says(scanned, modes):
    film = Film.of_vibration(modes, 0, 0.01)
    factor = film.weights[:, 1].max() / 0.01
    assert 0.5 < 0.01 * factor * np.linalg.norm(modes.moved[0], axis=1).max() < 0.7
    assert film.titles[film.strongest] == f"0.01 Hz, 10 µm, drawn {factor:g} times larger, at 0°"
    scene = frames_of(Results.open(scanned), film, "vibration")
    shown = []
    for k in (0, len(film) // 2):
        scene.show(k)
        names = "stimulator", "stratum_corneum shell", "bone face"
        actors = scene.plotter.actors
        shown.append([actors[name].mapper.dataset.points.copy() for name in names])
    (up, skin_up, bone_up), (down, skin_down, bone_down) = shown
    rise = (up - down)[:, 2]
    np.testing.assert_allclose(rise, 2 * factor * 0.01, atol=1e-4)
    lowest = skin_down[:, 2].argmin()
    assert skin_up[lowest, 2] - skin_down[lowest, 2] == pytest.approx(rise.mean(), rel=0.1)
    np.testing.assert_array_equal(bone_up, bone_down)


@needs_graphics
def test_a_vibration_is_viewed_without_a_solve(scanned, modes, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    folder = Results.open(scanned).vibration
    folder.mkdir(exist_ok=True)
    modes.save(folder / "modes.npz")
    path = tmp_path / "shape.gif"
    assert main(["view", str(scanned), "--vibration", "50", "--save", str(path)]) == 0
    with Image.open(path) as gif:
        assert gif.n_frames == 24


def test_a_signal_stops_between_frequencies(scanned):
    seen = []

    def observe(about, response):
        seen.append(response)
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(StoppedError, match="SIGINT: nothing of the vibration is saved"):
        vibrate(scanned, [1.0, 2.0], observers=[observe], comm=MPI.COMM_SELF)
    assert len(seen) == 1


def test_the_spectrum_fires_and_can_be_read_again(spectrum, tmp_path):
    spectrum.save(tmp_path / "spectrum.npz")
    again = Spectrum.load(tmp_path / "spectrum.npz")
    np.testing.assert_array_equal(again.sed_kPa, spectrum.sed_kPa)
    ra, pc = (afferents.population() for afferents in STUDY.populations[1:])
    weak, strong = (again.rates_Hz(1, amplitude, ra).max() for amplitude in (1e-6, 0.5))
    assert weak == 0 and strong >= 30 - 1
    assert again.rates_Hz(2, 0.1, pc).max() > 0


def test_the_command_writes_table_and_figure(scanned, capsys):
    assert main(["vibrate", str(scanned), "--frequencies", "10,40", "--at-mm", "0.2"]) == 0
    folder = scanned / "vibration"
    rows = list(csv.DictReader((folder / "spectrum.csv").open()))
    assert {row["amplitude_mm"] for row in rows} == {"0.01"}
    assert len(rows) == 2 * 9 and {row["population"] for row in rows} == {"SA1", "RA", "PC"}
    assert (folder / "spectrum.png").stat().st_size > 10_000
    assert Modes.load(folder / "modes.npz").frequency_Hz.tolist() == [10, 40]
    assert "spectrum.csv" in capsys.readouterr().out


def test_a_kept_state_is_that_of_its_time(scanned, capsys):
    assert main(["vibrate", str(scanned), "--frequencies", "10", "--at-s", "0"]) == 0
    assert "spectrum.png" in capsys.readouterr().out
    found, trace = Spectrum.load(scanned / "vibration" / "spectrum.npz"), Results(scanned).trace
    row = int(np.flatnonzero(trace["displacement_mm"] == 0.0)[-1])
    np.testing.assert_allclose(found.still_sed_kPa, trace["sed_kPa"][row], rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--frequencies", "0:10:3"], '--frequencies is "0:10:3" but must be low:high:count'),
        (["--frequencies", "-5"], '--frequencies is "-5" but must be low:high:count'),
        (["--frequencies", "fast"], '--frequencies is "fast" but must be low:high:count'),
        (["--shapes", "high"], '--shapes is "high" but must be low:high:count'),
        (["--at-mm", "3"], "has no state at 3 mm: states were kept at 0, 0.2 mm."),
        (["--direction", "0", "0", "0"], "direction is (0.0, 0.0, 0.0) but must be three numbers"),
    ],
)
def test_bad_input_gets_one_sentence(scanned, options, sentence, capsys):
    assert main(["vibrate", str(scanned), *options]) == 2
    told = capsys.readouterr().err
    assert sentence in " ".join(told.split()) and "Traceback" not in told


@needs_graphics
def test_a_view_of_no_vibration_says_what_to_run(scanned, tmp_path, capsys):
    assert main(["view", str(scanned), "--vibration", "50", "--at-mm", "1"]) == 2
    study = Results.create(tmp_path / "other")
    study.save_study(STUDY)
    study.save_trace(**Results.open(scanned).trace)
    path = str(tmp_path / "shape.gif")
    assert main(["view", str(study.folder), "--vibration", "50", "--save", path]) == 2
    assert "modes.npz is missing: run tactile-fem vibrate" in capsys.readouterr().err


def test_a_folder_without_states_says_how_to_keep_them(scanned, tmp_path):
    study = Results.create(tmp_path / "other")
    study.save_study(STUDY)
    study.save_trace(**Results.open(scanned).trace)
    with pytest.raises(StudyError, match=r"no state at 1 mm: set output\.restarts"):
        study.load_state(1.0)


def test_no_density_is_refused():
    with pytest.raises(ValueError, match="greater than 0"):
        Study.model_validate({"tissue": {"density_kg_m3": 0}})


def test_frequencies_are_even_in_their_logarithm():
    np.testing.assert_allclose(frequencies_of("1:100:3"), [1, 10, 100])
    np.testing.assert_allclose(frequencies_of("5,2.5"), [5, 2.5])


@pytest.mark.ranks
def test_several_ranks_find_what_one_does(tmp_path):
    short = {"protocol": {"depth_mm": 0.3, "distance_mm": 0.05, "output_mm": 0.05}}
    study = Study.model_validate({**STUDY.model_dump(), **short})
    scan(study, tmp_path, comm=MPI.COMM_WORLD)
    keepers = ModeKeeper([40.0]), ModeKeeper([40.0])
    together = vibrate(tmp_path, [40.0], comm=MPI.COMM_WORLD, observers=keepers[:1])
    alone = vibrate(tmp_path, [40.0], comm=MPI.COMM_SELF, observers=keepers[1:])
    shape = keepers[0].modes()
    assert (shape is None) == (MPI.COMM_WORLD.rank > 0)
    if shape is not None:
        np.testing.assert_allclose(shape.moved, keepers[1].modes().moved, atol=1e-5)
    for name in ("moved", "sed_kPa", "stretches", "force_N"):
        one, several = getattr(alone, name), getattr(together, name)
        np.testing.assert_allclose(several, one, atol=1e-6 * np.abs(one).max())


@pytest.mark.slow
def test_a_vibration_in_time_is_that_in_frequency(tmp_path):
    """Without inertia, for elastic tissue: what is felt follows the body's sine."""
    wave = {"frequency_Hz": 20.0, "amplitude_mm": 0.002}
    press = {"kind": "press", "depth_mm": 0.3}
    path = [press, {"kind": "hold", "time_s": 0.05, "output_s": 0.05, "vibration": wave}]
    changed = {"protocol": {"path": path}, "tissue": {"viscous_time_s": 0.0}}
    study = Study.model_validate({**STUDY.model_dump(), **changed})
    trace = scan(study, tmp_path, comm=MPI.COMM_SELF).trace
    held = trace.time_s > 0
    assert held.sum() == 24  # steps of one period
    sine = np.sin(2 * np.pi * 20.0 * trace.time_s[held])
    np.testing.assert_allclose(trace.stimulator_mm[held, 2], 0.3 + 0.002 * sine, atol=1e-9)
    spectrum = vibrate(tmp_path, [20.0], density_kg_m3=0.0, comm=MPI.COMM_SELF)
    for name, found in (("sed_kPa", spectrum.sed_kPa), ("moved_mm", spectrum.moved)):
        felt = getattr(trace, name)[held]
        amplitudes = 2 * np.tensordot(sine, felt, 1) / len(sine) / 0.002
        largest = np.abs(found).max()
        np.testing.assert_allclose(found[0].real, amplitudes, atol=0.01 * largest)


def test_a_bone_on_its_joint_gives_way(vibrations, tmp_path):
    pressed(STUDY.protocol.depth_mm, tmp_path, Joint())
    keeper = ModeKeeper([SLOW_HZ])
    found = vibrate(tmp_path, [SLOW_HZ], observers=[keeper], comm=MPI.COMM_SELF)
    (spectrum, _), shape = vibrations["body"], keeper.modes()
    assert 0 < found.force_N[0, 2].real < 0.95 * spectrum.force_N[0, 2].real
    bone = np.unique(shape.tets[shape.tissue == TISSUES["bone"]])
    arms = Joint().arms(shape.nodes_mm[bone])
    turn = np.sum(arms * shape.moved[0, bone]) / np.sum(arms**2)
    np.testing.assert_allclose(shape.moved[0, bone], turn * arms, atol=1e-6)
    assert turn.real > 0
    with pytest.raises(StudyError, match='moves is "bone" but must be "body"'):
        vibrate(tmp_path, [SLOW_HZ], moves="bone", comm=MPI.COMM_SELF)

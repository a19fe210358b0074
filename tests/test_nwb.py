"""Spikes as NWB files, and what other packages read from them and from neo objects."""

import importlib
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from synthetic import make_results

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response, to_nwb
from tactile_fem.study import Study

TIMES = [np.array([-0.05, 0.1]), np.empty(0), np.array([0.1, 0.3, 0.4])]
FIRED = Response(TIMES, -0.1, 0.5)
TWO = {"afferents": [{"name": "index", "kind": "SA1"}, {"name": "RA", "kind": "RA"}]}


def needs(package):
    """Import a package that `make test-all` installs, and say so where it is missing."""
    assert find_spec(package), f'{package} is missing: pip install "tactile-fem[neo,nwb,readers]"'
    return importlib.import_module(package)


def test_an_nwb_file_has_every_spike_and_column(tmp_path):
    path = tmp_path / "spikes.nwb"
    if not find_spec("pynwb"):
        with pytest.raises(StudyError, match="pynwb is not installed"):
            to_nwb(FIRED, path)
        return
    import pynwb

    to_nwb(FIRED, path, kind=["SA1", "RA", "RA"], x_mm=[1.0, 2.0, 3.0])
    with pynwb.NWBHDF5IO(path, "r") as stream:
        file = stream.read()
        assert [file.units["spike_times"][k].tolist() for k in range(3)] == [
            times.tolist() for times in TIMES
        ]
        assert file.units["kind"][:].tolist() == ["SA1", "RA", "RA"]
        assert file.units["x_mm"][:].tolist() == [1.0, 2.0, 3.0]
        assert file.units["obs_intervals"][1].tolist() == [[-0.1, 0.5]]
        zero = file.timestamps_reference_time - file.session_start_time
        assert zero.total_seconds() == pytest.approx(0.1)
    assert [one.name for one in tmp_path.iterdir()] == ["spikes.nwb"]


def test_bad_input_is_told_before_a_file_is_written(tmp_path):
    with pytest.raises(StudyError, match="kind has 1 values; it needs 3, one a receptor"):
        to_nwb(FIRED, tmp_path / "spikes.nwb", kind=["SA1"])
    with pytest.raises(StudyError, match=r"spikes\.h5: the name of an NWB file ends in \.nwb"):
        to_nwb(FIRED, tmp_path / "spikes.h5")
    assert not list(tmp_path.iterdir())


def two_classes(folder):
    results = make_results(folder, Study.model_validate(TWO))
    population = np.array(["index", "RA"] * 11)[: len(results.trace["receptors_mm"])]
    results.save_trace(**{**results.trace, "population": population})
    return results


@pytest.mark.slow
def test_pynapple_reads_classes_and_places(tmp_path):
    nap, results = needs("pynapple"), two_classes(tmp_path / "r")
    results.to_nwb(tmp_path / "scan.nwb")
    units = nap.load_file(str(tmp_path / "scan.nwb"))["units"]
    assert [len(units[k]) for k in range(len(units))] == results.response.counts().tolist()
    assert set(units.getby_category("kind")) == {"SA1", "RA"}
    assert units["population"].tolist() == results.trace["population"].tolist()
    assert np.array(units["x_mm"]) == pytest.approx(results.trace["receptors_mm"][:, 0])


@pytest.mark.slow
def test_elephant_takes_neo_objects(tmp_path):
    needs("elephant")
    statistics, pq = importlib.import_module("elephant.statistics"), needs("quantities")
    results = two_classes(tmp_path / "r")
    trains = results.to_neo().spiketrains
    start, end = results.response.start_s, results.response.end_s
    rates = [float(statistics.mean_firing_rate(train).rescale("1/s")) for train in trains]
    assert rates == pytest.approx(results.response.counts() / (end - start))
    binned = statistics.time_histogram(trains, (end - start) / 10 * pq.s)
    assert binned.magnitude.sum() == results.response.counts().sum()


@pytest.mark.skipif(not find_spec("h5py"), reason="there is no other HDF5 than that of PETSc")
def test_an_nwb_file_can_be_written_after_a_scan():
    code = "import tactile_fem.simulation.run, h5py"  # once: Not a datatype
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr

"""What scans of a series share changes results by rounding only. Also run on two ranks."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from tactile_fem import Results, scan
from tactile_fem.runtime.ranks import on_root
from tactile_fem.series.worker import Worker
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.study import Neuron, Protocol, Receptors, Study
from tactile_fem.study.file import dump_study

pytestmark = pytest.mark.ranks
COMM = MPI.COMM_WORLD


def with_body(study: Study, **stimulus) -> Study:
    return study.model_copy(update={"stimulus": study.stimulus.model_copy(update=stimulus)})


def test_scans_of_a_worker_are_those_of_each_alone(study, tmp_path, monkeypatch):
    one = study.model_copy(
        update={
            "protocol": Protocol(depth_mm=0.2, distance_mm=0.1, output_mm=0.1),
            "receptors": Receptors(spacing_mm=2.5),
        }
    )
    beside = with_body(one, shift_mm=(0.2, 0.0))
    protocol = one.protocol.model_copy(update={"distance_mm": 0.2})
    longer = beside.model_copy(update={"protocol": protocol})
    gain = Neuron(model="hamasaki2020", static_gain_pA_per_kPa=3e6)
    other_neuron = longer.model_copy(update={"neuron": gain})
    studies = {
        "one": one,
        "beside": beside,
        "longer": longer,
        "wrong": with_body(one, friction=0.2),
        "neuron": other_neuron,
    }

    def prepare() -> None:
        for name, each in studies.items():
            (tmp_path / f"{name}.toml").write_text(dump_study(each))
        (tmp_path / "wrong").mkdir()
        (tmp_path / "wrong" / "notes").touch()

    on_root(COMM, prepare)
    worker = Worker(tmp_path, COMM)
    problems = {name: worker.run(name, same=[name], keep=True) for name in list(studies)[:-1]}
    assert "is not empty" in problems.pop("wrong")
    assert not any(problems.values())
    for name in problems:
        alone, here = scan(studies[name], comm=COMM).trace, Results(tmp_path / name).trace
        iterations = alone.newton_iterations.sum(), here["newton_iterations"].sum()
        if name == "one":  # on several ranks MUMPS does not round alike twice
            atol = COMM.size - 1
            there = alone.newton_iterations
            np.testing.assert_allclose(here["newton_iterations"], there, rtol=0, atol=atol)
        else:
            assert iterations[1] < 0.9 * iterations[0]
        np.testing.assert_allclose(here["time_s"], alone.time_s, atol=1e-12)
        for column in ("force_N", "sed_kPa"):
            values = getattr(alone, column)
            error = np.abs(here[column] - values).max()
            assert error < 1e-8 * np.abs(values).max(), (name, column)

    def steps(simulation: Simulation):
        yield from ()

    monkeypatch.setattr(Simulation, "steps", steps)  # none is left
    assert not worker.run("neuron", same=["wrong", "longer", "neuron"])
    before, after = Results(tmp_path / "longer"), Results(tmp_path / "neuron")
    assert after.complete and after.study == other_neuron
    for name, column in before.trace.items():
        np.testing.assert_array_equal(after.trace[name], column)
    assert len(after.spikes.time_s) > len(before.spikes.time_s)
    assert (after.fields / "deformation.pvd").exists()

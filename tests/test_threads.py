"""Products of the fast finger and of afferents stay on one core."""

from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from tactile_fem.neuron import Population
from tactile_fem.neuron.transduction import BandPass
from tactile_fem.runtime import threads
from tactile_fem.surrogate import FastFinger, HeightMap
from tactile_fem.surrogate.networks import Network

SHIPPED = Path(__file__).parents[1] / "meshes/fast_finger.npz"


def step() -> None:
    plate = HeightMap.of_array(np.zeros((2, 2)), 1.0)
    FastFinger.read(SHIPPED).loop(plate, receptors_mm=[(0.0, 0.0)]).step((0.0, 0.0, 0.5), 0.1)


def fire() -> None:
    histories = {"time_s": np.linspace(0, 0.1, 11), "sed_kPa": np.ones((11, 2))}
    population = Population()
    Population(transduction=BandPass(population.neuron)).fire(histories)


@pytest.mark.parametrize(
    ("work", "where"), [(step, (Network, "__call__")), (fire, (BandPass, "segments"))]
)
def test_products_take_one_thread_and_leave_the_others_as_they_were(monkeypatch, work, where):
    threads._controller.cache_clear()  # libraries may have been loaded since
    blas = ThreadpoolController().select(user_api="blas")  # as it is now, too
    owner, name = where
    own, seen = getattr(owner, name), []

    def counts() -> set[int]:
        able = [each for each in blas.info() if each["threading_layer"] != "disabled"]  # PETSc's
        return {each["num_threads"] for each in able}

    def watched(*given):
        seen.append(counts())
        return own(*given)

    monkeypatch.setattr(owner, name, watched)
    with blas.limit(limits=2):
        assert counts() == {2}
        work()
        assert counts() == {2}
    assert seen and all(each == {1} for each in seen)

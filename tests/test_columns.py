"""The table of columns is that of a trace, of its spikes and of what a step has."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_fem.neuron.fields import STANDARD
from tactile_fem.results.columns import FELT, SPIKES, TRACE, table
from tactile_fem.results.results import Spikes
from tactile_fem.results.trace import Trace

RECEPTORS = 4


def test_a_trace_has_the_columns_of_the_table():
    arrays = Trace(np.zeros((RECEPTORS, 3)), np.full(RECEPTORS, "SA1")).arrays()
    assert set(arrays) == {column.name for column in TRACE}
    for column in TRACE:
        assert arrays[column.name].shape == column.sizes(steps=1, receptors=RECEPTORS), column.name
    assert [column.name for column in FELT] == [field.name for field in STANDARD]


def test_a_step_has_what_the_table_says():
    pytest.importorskip("tactile_fem.runtime.backend")
    from dataclasses import fields

    from tactile_fem.mechanics.load import Load
    from tactile_fem.results.columns import OF_STEP
    from tactile_fem.simulation.step import Step

    of_step = {field.name for kind in (Step, Load) for field in fields(kind)} | {"depth_mm"}
    assert {column.name for column in OF_STEP} <= of_step


def test_spikes_have_the_columns_of_the_table():
    assert Spikes._fields == tuple(column.name for column in SPIKES)


@pytest.mark.parametrize("name", ["trace", "spikes", "summary"])
def test_names_state_the_units(name):
    rows = table(name)
    assert len({row[0] for row in rows}) == len(rows)
    units = {name: unit for name, _, unit, _ in rows}
    assert all(meaning for *_, meaning in rows)
    if name == "trace":
        assert (units["moment_Nmm"], units["contact_area_mm2"]) == ("Nmm", "mm2")
        assert units["stretches"] == units["newton_iterations"] == ""

"""The paper's table, on a coarser finger and over half a millimetre."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hamasaki2020_readings import WINDOWS_MM, Middle

from tactile_fem.neuron import Response

SCRIPT = Path(__file__).parents[1] / "demos" / "validation" / "hamasaki2020.py"


def test_rates_in_the_windows_are_spikes_over_time():
    spikes = np.array([-0.5, 1.6, 1.8, 2.0, 5.5])
    seen = Middle(np.array([0.0, 10.0]), np.zeros(2), Response([spikes], 0.0, 10.0))
    rates = np.array(seen.rates_Hz(20.0))
    np.testing.assert_allclose(rates * np.diff(WINDOWS_MM) / 20.0, [0, 3, 0, 1, 0, 0, 0])
    assert seen.bundles() == ["1.6 to 2.0"]


@pytest.mark.slow
@pytest.mark.needs_gmsh
def test_every_row_of_the_table_is_computed(tmp_path):
    small = ["finger.pad_size_mm=3.0", "finger.far_size_mm=6.0", "solver.max_press_step_mm=0.5"]
    words = [sys.executable, SCRIPT, tmp_path, "--distance", "0.4", "--depth", "0.5"]
    words += ["--set", *small]
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    with (tmp_path / "hamasaki2020.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    by_figure = {row["figure"]: row for row in rows}
    assert {"3a", "3b", "5, 6", "8a", "8b", "9a", "9b"} <= by_figure.keys()
    assert all(row["reproduction"] and row["default"] for row in rows)
    assert printed.count("in the study") == 2
    assert by_figure["9a"]["reproduction"].startswith("31 rows")
    assert by_figure["9b"]["default"].startswith("30 rows")  # X from -2.8 to 3 mm
    pictures = {path.name for path in tmp_path.glob("paper_*.png")}
    assert pictures >= {"paper_presses.png", "paper_middle.png", "paper_rasters.png"}

"""The paper's statements of one neuron; its table, on a coarser finger and half a millimetre."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hamasaki2020_readings import (
    BETWEEN_MM,
    BUNDLES_MM,
    CURVATURES,
    FREE,
    HELD_HZ,
    RAMP_HZ,
    WHEN,
    Finger,
    Middle,
    first_high_mm,
    middle_of,
    rows_of,
)

from tactile_fem import load_study
from tactile_fem.neuron import Recording, Response, Window, fit
from tactile_fem.series import RateImage

DEMOS = Path(__file__).parents[1] / "demos"
SCRIPT = DEMOS / "validation" / "hamasaki2020.py"
PAGE = DEMOS / "pages" / "how" / "paper.md"
STUDY = load_study("hamasaki2020")


@pytest.fixture(scope="module")
def kept():
    with np.load(DEMOS / "validation" / "histories" / "hamasaki2020.npz") as stored:
        return {name: stored[name].astype(float) for name in stored.files}


@pytest.mark.parametrize("size", ["coarse", "full_size"])
def test_the_reproduction_fires_in_three_bundles_each_until_sed_has_its_maximum(kept, size):
    seen = middle_of(*kept[size].T, STUDY)
    maxima = seen.along_mm[seen.maxima()]
    ends = [one.end_s for one in seen.bundles()]
    assert len(ends) == len(maxima) == 3
    np.testing.assert_allclose(ends, maxima, atol=0.25)
    for (start, end), bundle in zip(BUNDLES_MM, seen.bundles(), strict=True):
        assert bundle.start_s < end and bundle.end_s > start  # each meets one of the paper's


def test_a_slow_decay_merges_two_bundles(kept):
    slow = {"adaptation_time_s": 0.2, "static_gain_pA_per_kPa": 120.0, "adaptation": 0.91}
    study = STUDY.model_copy(update={"neuron": STUDY.neuron.model_copy(update=slow)})
    assert len(middle_of(*kept["coarse"].T, study).bundles()) == 2


def test_gain_and_adaptation_of_the_study_are_those_that_the_cylinders_give(kept):
    recordings = [
        Recording(
            kept[f"cylinder_{curvature}"][:, 0],
            kept[f"cylinder_{curvature}"][:, 1:],
            [Window(*when, [rate]) for when, rate in zip(WHEN, rates, strict=True)],
        )
        for curvature, *rates in zip(CURVATURES, RAMP_HZ, HELD_HZ, strict=True)
    ]
    for name, found in fit(recordings, STUDY.neuron, FREE).estimates.items():
        assert getattr(STUDY.neuron, name) == pytest.approx(found.value, rel=0.01)


def test_the_page_says_not_stated_where_the_paper_says_nothing():
    page = PAGE.read_text()
    assert "not stated" in page
    assert "silen" not in page


def test_rates_in_windows_are_spikes_over_time():
    spikes = np.array([-0.5, 1.6, 1.8, 2.0, 5.5])
    seen = Middle(np.array([0.0, 10.0]), np.zeros(2), Response([spikes], 0.0, 10.0))
    for windows, counts in ((BUNDLES_MM, [3, 1, 0]), (BETWEEN_MM, [0, 0, 0, 0])):
        rates = np.array(seen.rates_Hz(20.0, windows))
        np.testing.assert_allclose(rates * np.diff(windows).ravel() / 20.0, counts)
    (only,) = seen.bundles()
    assert (only.start_s, only.end_s, only.spikes) == (1.6, 2.0, 3)


def test_rates_beside_a_maximum_are_those_before_and_after_it():
    along = np.linspace(0.0, 10.0, 101)
    sed = 1.0 - 0.1 * np.abs(along - 4.0)
    seen = Middle(along, sed, Response([np.array([3.3, 3.5, 3.9, 4.5])], 0.0, 10.0))
    np.testing.assert_allclose(seen.beside_maxima_Hz(20.0), [[75.0], [25.0]])


def image(rows: dict[float, list[float]]) -> RateImage:
    """Return an image of spikes at places, mm, by X."""
    along = np.arange(0.0, 10.1, 0.2)
    fired = Response([np.array(places) / 20.0 for places in rows.values()], 0.0, 0.5)
    return RateImage(np.array(list(rows)), along, fired.rate(along / 20.0, 0.01).T, fired)


def test_first_high_rates_are_found_in_central_and_outer_rows():
    seen = image({-3.0: [6.0, 6.1], 0.0: [1.0, 2.0, 2.1, 6.5, 6.6], 4.5: [7.0, 7.1]})
    np.testing.assert_allclose(first_high_mm(seen, 20.0, (0.0, 5.0)), [np.nan, 2.0, np.nan])
    np.testing.assert_allclose(first_high_mm(seen, 20.0, (5.0, 10.0)), [6.0, 6.5, 7.0])
    assert rows_of(seen, (0.0, 1.0)).tolist() == [1]
    assert rows_of(seen, (2.0, 4.0)).tolist() == [0]


def test_the_gap_is_the_opening_at_the_right_of_the_g():
    finger = Finger(STUDY, {})
    open_, closed = -1.2, 1.5
    for fires, expected in ((open_, (True, False)), (closed, (False, True))):
        seen = image({x: [8.0, 8.1, 8.2] if x == fires else [] for x in (open_, closed)})
        assert tuple(rate > 0 for rate in finger.gap_Hz(seen)) == expected
    assert finger.to_edge_mm(1.75) == pytest.approx(0.0, abs=0.01)  # the left of the G


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
    assert all(row["reproduction"] and row["full size"] and row["default"] for row in rows)
    assert printed.count("in the study") == 2
    assert by_figure["9a"]["full size"].startswith("31 rows")
    assert by_figure["9b"]["default"].startswith("30 rows")  # X from -2.8 to 3 mm
    pictures = {path.name for path in tmp_path.glob("paper_*.png")}
    assert pictures >= {"paper_presses.png", "paper_middle.png", "paper_rasters.png"}

"""Rows of a running scan: read while they are written, whatever cuts a write off."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tactile_fem.errors import StudyError
from tactile_fem.results.columns import FELT, OF_STEP
from tactile_fem.results.results import Results
from tactile_fem.results.store import ROWS as NAME
from tactile_fem.results.trace import Trace

RECEPTORS = 3


class Scan:
    """A trace and its folder, as the recorder writes it."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        self.results = Results(folder)
        self.file = self.results.folder / NAME
        self.trace = Trace(np.zeros((RECEPTORS, 3)), np.array(["SA1"] * RECEPTORS))
        self.save()

    def save(self) -> None:
        self.results.save_trace(**self.trace.arrays())

    def step(self, phase: str = "press", **own) -> None:
        number = len(self.trace)
        of_step = {column.name: column.rest for column in OF_STEP}
        vectors = {name: np.full(3, 0.1 * number) for name in ("force_N", "stimulator_mm")}
        step = of_step | vectors | {"clock_s": 0.1 * number, "phase": phase}
        felt = {column.name for column in FELT}
        columns = {name: self.trace.at(name, [-1])[0] + number for name in felt} | own
        step["indenting"] = phase == "press"
        self.trace(SimpleNamespace(step=SimpleNamespace(**step), columns=columns))

    def keep(self) -> bool:
        """Write the last row; return whether it was appended."""
        return self.results.append_row(self.trace)

    def go(self, *phases: str) -> list[bool]:
        appended = []
        for phase in phases:
            self.step(phase)
            appended.append(self.keep())
        return appended

    def assert_read(self, rows: int | None = None) -> None:
        """Hold what is read against the first rows of the trace, by default all."""
        read, trace = Results(self.results.folder).trace, self.trace.arrays()
        assert read.keys() == trace.keys()
        for name, expected in trace.items():
            if name not in ("receptors_mm", "population"):
                expected = expected[:rows]
            np.testing.assert_array_equal(read[name], expected, err_msg=name)


@pytest.fixture
def scan(tmp_path) -> Scan:
    return Scan(tmp_path / "r")


def test_rows_are_read_while_they_are_written(scan):
    scan.assert_read()
    for phase in ("press", "press", "press", "slide", "slide", "a long way", "lift", "lift"):
        scan.go(phase)
        scan.assert_read()
    assert scan.file.is_file()
    scan.save()
    assert not scan.file.exists()
    scan.assert_read()


def test_only_new_columns_and_longer_names_write_all_again(scan):
    assert scan.go(*["press"] * 3, *["hold"] * 2, *["long slide"] * 2, "hold") == [
        *(False, True, True, True, True),
        *(False, True, True),
    ]
    scan.step("hold", mine_N=1.0)
    assert not scan.keep()
    scan.step("hold", mine_N=2.0)
    assert scan.keep()
    assert scan.go("hold") == [True]  # the observer is silent
    read = Results(scan.results.folder).trace["mine_N"]
    np.testing.assert_array_equal(read[-4:], [np.nan, 1.0, 2.0, np.nan])
    scan.assert_read()


def test_a_row_takes_the_same_space_however_many_there_are(scan):
    scan.go(*["press"] * 2)
    sizes = []
    for _ in range(20):
        scan.go("press")
        sizes.append(scan.file.stat().st_size)
    assert len(set(np.diff(sizes))) == 1
    values = sum(array.nbytes for array in scan.trace.last()[2].values())
    assert np.diff(sizes)[0] == values + 16


def test_a_name_may_have_any_letters(scan, recwarn):
    scan.step(stärke_N=1.0)
    scan.keep()
    scan.step(stärke_N=2.0)
    scan.keep()
    scan.assert_read()
    assert not recwarn


def test_a_row_cut_off_at_any_byte_does_not_count(scan):
    scan.go(*["slide"] * 3)
    before = scan.file.stat().st_size
    scan.go("slide")
    whole = scan.file.read_bytes()
    for left in range(before, len(whole)):
        scan.file.write_bytes(whole[:left])
        scan.assert_read(4)
    # A power cut may leave zeros where rows were to be.
    scan.file.write_bytes(whole + bytes(3 * (len(whole) - before)))
    scan.assert_read(5)


def test_killed_between_both_files_no_row_is_there_twice(scan):
    scan.go(*["press"] * 4)
    before = scan.file.read_bytes()
    scan.save()
    scan.file.write_bytes(before)
    scan.assert_read()


def test_rows_that_do_not_follow_the_trace_do_not_count(scan):
    """As those of an earlier run, whose trace had fewer columns, or one that was replaced."""
    scan.go(*["slide"] * 4)
    before = scan.file.read_bytes()
    scan.step(mine_N=1.0)
    scan.save()
    scan.file.write_bytes(before)
    scan.assert_read()
    shorter = Scan(scan.results.folder)  # at rest
    shorter.file.write_bytes(before)
    assert len(Results(scan.results.folder).trace["time_s"]) == 1


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY", b"1,2,3", "objects"])
def test_a_damaged_file_is_a_study_error(scan, content):
    scan.go(*["press"] * 3)
    if content == "objects":
        none = np.empty(0, [("number", int), ("columns", object)])
        np.save(scan.file.with_suffix(".npy"), none, allow_pickle=True)
        scan.file.with_suffix(".npy").replace(scan.file)
    else:
        scan.file.write_bytes(content)
    with pytest.raises(StudyError, match=rf"{NAME} cannot be read"):
        _ = Results(scan.results.folder).trace


def test_a_scan_whose_folder_was_removed_ends(scan):
    scan.go(*["press"] * 2)
    scan.file.unlink()
    with pytest.raises(FileNotFoundError, match=NAME):
        scan.go("press")

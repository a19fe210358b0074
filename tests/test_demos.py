"""Every demo runs at small size and prints its numbers."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

DEMOS = Path(__file__).resolve().parents[1] / "demos"


def run(name: str, *arguments: str) -> str:
    command = [sys.executable, str(DEMOS / name), *arguments]
    finished = subprocess.run(command, check=True, capture_output=True, text=True)
    return finished.stdout


def number(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


@pytest.mark.slow
def test_letters(tmp_path):
    told = run("letters.py", str(tmp_path / "out"), "--depth", "0.3", "--distance", "0.2")
    assert number(r"normal force at 0.30 mm +([\d.]+) N", told) == pytest.approx(0.0125, rel=0.2)
    assert number(r"minus reaction +([\d.e+-]+) N", told) < 1e-5
    assert (tmp_path / "out" / "figures" / "raster.png").is_file()


@pytest.mark.slow
def test_flat_plate(tmp_path):
    told = run("flat_plate.py", str(tmp_path / "plate.png"), "--depth", "0.5")
    force = number(r"0\.5 +([\d.]+) +0\.037", told)
    # Within two standard deviations of the measured mean.
    assert force == pytest.approx(0.037, abs=0.020)
    assert (tmp_path / "plate.png").is_file()


def test_every_demo_is_tested():
    tested = set(re.findall(r'run\("(\w+\.py)"', Path(__file__).read_text()))
    assert tested == {path.name for path in DEMOS.glob("**/*.py")}

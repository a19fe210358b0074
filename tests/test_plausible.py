"""What no finger can touch is refused, what may be wrong is told."""

import logging
import re

import numpy as np
import pytest
from needs import needs_graphics

from tactile_fem.cli.app import main
from tactile_fem.errors import StudyError
from tactile_fem.study import Surface

ROUGH = np.random.default_rng(1).normal(0, 20, (30, 40))  # micrometres


def read(tmp_path, values, **keys):
    np.save(tmp_path / "f.npy", values)
    sizes = {"spacing_mm": 0.1, "unit_mm": 1e-3, **keys}
    return Surface(file=tmp_path / "f.npy", **sizes).relief()


def with_hole(value, kind=float):
    values = ROUGH.astype(kind)
    values[3, 5] = value
    return values


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        *[(-9999, float), (-32768, np.int16), (-99999, float), (-999, int), (9999, float)],
        *[(1.70141e38, float), (-3.4028235e38, np.float32), (-(2**31), np.int32), (1e10, float)],
    ],
)
def test_a_number_for_nothing_measured_is_no_height(value, kind, tmp_path):
    values = with_hole(value, kind)
    sentence = (
        rf"has the height {value:g} at 1 of its points, the first in row 3, column 5, .* missing"
    )
    for unit in (1e-3, 1e-6):
        with pytest.raises(StudyError, match=sentence.replace("+", r"\+")):
            read(tmp_path, values, unit_mm=unit)
    read(tmp_path, values, crop_mm=(1.0, 1.0, 2.9, 3.9))


@pytest.mark.parametrize(
    "values",
    [
        with_hole(0) + 5000 * (with_hole(0) != 0),
        with_hole(-4000.5),
        np.where(ROUGH < -40, 65535, 300 + ROUGH).astype(np.uint16),
    ],
)
def test_numbers_that_may_mean_nothing_are_told(values, tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        read(tmp_path, values, unit_mm=1e-4)
    assert "do they mark missing heights?" in caplog.text


DOTS = np.zeros((30, 40))
DOTS[5:9, 5:9] = DOTS[15:19, 20:24] = 200


@pytest.mark.parametrize("values", [ROUGH, DOTS, DOTS.astype(np.uint8) + 55, -DOTS])
def test_real_surfaces_raise_no_doubt(values, tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        read(tmp_path, values, low_pass_mm=1.0)
    assert "missing" not in caplog.text and "right?" not in caplog.text


def test_lengths_that_no_finger_touches_are_refused(tmp_path):
    with pytest.raises(StudyError, match=r"spacing_mm = 312 .* must not exceed 10.* is it in mm\?"):
        read(tmp_path, ROUGH, spacing_mm=312)
    with pytest.raises(StudyError, match=r"a surface of 90 x 2997 mm, but .* at most 1000 mm"):
        read(tmp_path, np.resize(ROUGH, (31, 1000)), spacing_mm=3.0)
    with pytest.raises(StudyError, match=r"stimulus\.unit_mm: .* rms 19\.\d mm, but at most 20 mm"):
        read(tmp_path, ROUGH, unit_mm=1.0)


def test_lengths_that_a_finger_hardly_touches_are_told(tmp_path, caplog):
    for keys, words in {
        (("spacing_mm", 3.0),): "spacing_mm = 3 .* is coarse for a finger: is it in mm",
        (("spacing_mm", 1e-4),): "a surface of 0.0029 x 0.0039 mm, repeated without end",
        (("unit_mm", 0.06),): "more than a finger can follow; is the unit right",
        (("unit_mm", 1e-9),): "less than a finger can feel; is the unit right",
    }.items():
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            read(tmp_path, ROUGH, **dict(keys))
        assert re.search(words, caplog.text)


def test_a_steep_plane_is_no_relief(tmp_path):
    ramp = np.linspace(0, 1e6, 30)[:, None] + ROUGH
    read(tmp_path, ramp)
    with pytest.raises(StudyError, match="differ by"):
        read(tmp_path, ramp, level="mean")


@needs_graphics
def test_the_command_line_refuses_it(tmp_path, capsys):
    np.savetxt(tmp_path / "f.csv", with_hole(-9999), delimiter=",")
    words = ["kind=surface", f"file={tmp_path}/f.csv", "spacing_mm=0.1", "unit_mm=0.001"]
    arguments = [part for word in words for part in ("--set", f"stimulus.{word}")]
    assert main(["preview", *arguments, "-o", str(tmp_path / "out.png")]) == 2
    assert "the height -9999 at 1 of its points" in capsys.readouterr().err

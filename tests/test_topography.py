"""Heights are read from each kind of file; what cannot be used is told in one sentence."""

import pickle
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from tactile_fem.cli.app import main
from tactile_fem.errors import StudyError
from tactile_fem.stimulus.topography import read_topography

HEIGHTS = np.arange(30).reshape(5, 6) ** 2 % 37


def read(file, **keys):
    return read_topography(file, **{"spacing_mm": 0.1, "unit_mm": 0.01, **keys})


def sdf(file, values, count=None):
    """Write the binary form of ISO 25178-71: lengths in m, columns along X."""
    rows, columns = values.shape
    with file.open("wb") as stream:
        stream.write(b"bISO-1.0" + b"tactile   " + b"010120260000" * 2)
        stream.write(struct.pack("<HH", columns, count or rows))
        stream.write(struct.pack("<dddd", 2e-5, 3e-5, 1e-6, -1.0) + struct.pack("<BBB", 0, 7, 0))
        stream.write(values.astype("<f8").tobytes())


WRITERS = {
    "f.npy": lambda file: np.save(file, HEIGHTS),
    "8.png": lambda file: Image.fromarray(HEIGHTS.astype(np.uint8)).save(file),
    "16.png": lambda file: Image.fromarray(HEIGHTS.astype(np.uint16)).save(file),
    "float.tif": lambda file: Image.fromarray(HEIGHTS.astype(np.float32)).save(
        file, compression="tiff_deflate"
    ),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_heights(name, tmp_path):
    file = tmp_path / name
    WRITERS[name](file)
    found = read(file)
    assert found.heights_mm == pytest.approx(0.01 * HEIGHTS)
    assert found.spacing_mm == (0.1, 0.1)


def test_an_instruments_file_states_spacing_and_unit(tmp_path):
    file = tmp_path / "instrument.sdf"
    sdf(file, HEIGHTS.T)
    found = read_topography(file)
    assert found.heights_mm == pytest.approx(1e-3 * HEIGHTS)
    assert found.spacing_mm == pytest.approx((0.02, 0.03))
    assert read_topography(file, spacing_mm=0.5).spacing_mm == (0.5, 0.5)


def test_small_values_may_be_high(tmp_path):
    file = tmp_path / "f.npy"
    np.save(file, HEIGHTS)
    assert read(file, unit_mm=-0.5).heights_mm == pytest.approx(-0.5 * HEIGHTS)


def test_a_part_is_cropped_by_lengths(tmp_path):
    file = tmp_path / "f.npy"
    np.save(file, np.arange(200.0).reshape(10, 20))
    found = read(file, unit_mm=1.0, crop_mm=(0.2, 0.5, 0.6, 1.9))
    assert found.heights_mm == pytest.approx(np.arange(200.0).reshape(10, 20)[2:7, 5:20])
    for crop in [(0.2, 0.5, 1.0, 1.9), (0.6, 0, 0.2, 1.0), (0.0, 0.0, 0.1, 1.0)]:
        with pytest.raises(StudyError, match=r"crop_mm|make no surface"):
            read(file, crop_mm=crop)


def bomb(file):
    """Write a PNG of 60,000 x 60,000 pixels, all the same, in a few bytes."""
    body = zlib.compress(bytes(60_001) * 100, 9)
    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    with file.open("wb") as stream:
        stream.write(b"\x89PNG\r\n\x1a\n")
        for chunk, data in ((b"IHDR", header), (b"IDAT", body), (b"IEND", b"")):
            PngImagePlugin.putchunk(stream, chunk, data)


def bomb_of_tiff(file):
    """Write a TIFF whose strip unpacks to 500 times what its size says."""
    Image.fromarray(np.zeros((20, 20), np.uint8)).save(file, compression="tiff_adobe_deflate")
    data = bytearray(file.read_bytes())
    strip = zlib.compress(bytes(200_000_000), 9)
    with Image.open(file) as image:
        offset, length = image.tag_v2[273][0], image.tag_v2[279][0]
    at = data.index(struct.pack("<HHI", 279, 4, 1) + struct.pack("<I", length))
    data[at + 8 : at + 12] = struct.pack("<I", len(strip))
    at = data.index(struct.pack("<HHI", 273, 4, 1) + struct.pack("<I", offset))
    data[at + 8 : at + 12] = struct.pack("<I", len(data))
    file.write_bytes(bytes(data) + strip)


def truncated(file):
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (99, 99), np.uint8)).save(file)
    file.write_bytes(file.read_bytes()[:2000])


def header_of_a_large_array(file):
    with file.open("wb") as stream:
        shape = {"descr": "<f8", "fortran_order": False, "shape": (100_000, 100_000)}
        np.lib.format.write_array_header_1_0(stream, shape)


class Evil:
    def __reduce__(self):
        return exec, ("raise SystemExit('code was run')",)


BAD = {
    "missing.npy": (lambda file: None, "there is no such file"),
    "empty.npy": (lambda file: file.write_bytes(b""), "cannot be read"),
    "empty.csv": (lambda file: file.write_bytes(b""), "make no surface|cannot be read"),
    "text.csv": (lambda file: file.write_text("height of\nthe skin\n"), "cannot be read"),
    "text.png": (lambda file: file.write_text("no image"), "cannot be read"),
    "ragged.txt": (lambda file: file.write_text("1 2 3 4\n1 2 3\n"), "cannot be read"),
    "binary.txt": (lambda file: file.write_bytes(bytes(range(256)) * 9), "cannot be read"),
    "truncated.png": (truncated, "cannot be read"),
    "truncated.tif": (truncated, "cannot be read"),
    "cut.npy": (
        lambda file: (np.save(file, HEIGHTS), file.write_bytes(file.read_bytes()[:200])),
        "cannot be read",
    ),
    "nan.npy": (
        lambda file: np.save(file, np.where(HEIGHTS == 16, np.nan, HEIGHTS)),
        "1 missing or infinite heights, the first in row 0, column 4",
    ),
    "inf.csv": (
        lambda file: np.savetxt(file, np.where(HEIGHTS == 16, np.inf, HEIGHTS)),
        "missing or infinite",
    ),
    "complex.npy": (lambda file: np.save(file, HEIGHTS + 1j), "2 dimensions of complex128"),
    "words.npy": (lambda file: np.save(file, HEIGHTS.astype(str)), "real numbers"),
    "cube.npy": (lambda file: np.save(file, np.zeros((5, 5, 5))), "3 dimensions"),
    "objects.npy": (
        lambda file: file.write_bytes(b"") or np.save(file, np.array([Evil()]), allow_pickle=True),
        "cannot be read|real numbers",
    ),
    "pickle.npy": (lambda file: file.write_bytes(pickle.dumps(Evil())), "cannot be read"),
    "colour.png": (
        lambda file: Image.fromarray(np.zeros((9, 9, 3), np.uint8)).save(file),
        "mode RGB but must be gray",
    ),
    "many.tif": (
        lambda file: Image.fromarray(np.zeros((9, 9), np.uint8)).save(
            file, save_all=True, append_images=[Image.fromarray(np.ones((9, 9), np.uint8))]
        ),
        "holds 2 images",
    ),
    "small.npy": (lambda file: np.save(file, np.zeros((3, 9))), "3 x 9 heights make no surface"),
    "large.npy": (header_of_a_large_array, "cannot be read|at most 16,000,000"),
    "wide.csv": (lambda file: file.write_text("1," * 20_000_000), "at most 16,000,000"),
    "bomb.png": (bomb, "at most 16,000,000|cannot be read"),
    "unknown.xyzw": (lambda file: file.write_text("1 2 3"), "SurfaceTopography|cannot be read"),
    "instrument.sdf": (lambda file: file.write_bytes(b"bISO-1.0 nothing"), "cannot be read|pip"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_told_in_one_sentence(name, tmp_path):
    write, message = BAD[name]
    file = tmp_path / name
    write(file)
    with pytest.raises(StudyError, match=message) as error:
        read(file)
    assert str(file) in str(error.value) or "make no surface" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_tiff_that_unpacks_to_more_than_it_says_stays_small(tmp_path):
    file = tmp_path / "bomb.tif"
    bomb_of_tiff(file)
    try:
        assert read(file).heights_mm.shape == (20, 20)
    except StudyError as error:
        assert "cannot be read" in str(error)


def test_a_table_without_spacing_or_unit_says_what_is_missing(tmp_path):
    file = tmp_path / "f.npy"
    np.save(file, HEIGHTS)
    with pytest.raises(StudyError, match=r"stimulus.spacing_mm must be given"):
        read_topography(file, unit_mm=0.01)
    with pytest.raises(StudyError, match=r"stimulus.unit_mm must be given"):
        read_topography(file, spacing_mm=0.01)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ([], "stimulus.file is missing"),
        (["file=f.npy", "unit_mm=0"], "stimulus.unit_mm"),
        (["file=f.npy", "level=cubic"], "stimulus.level is"),
        (["file=f.npy", "spacing_mm=-1"], "stimulus.spacing_mm is -1 but must be greater than 0"),
    ],
)
def test_the_command_line_says_what_is_wrong(settings, message, tmp_path, capsys):
    words = ["kind=surface", *settings]
    arguments = [part for word in words for part in ("--set", f"stimulus.{word}")]
    assert main(["scan", *arguments, "--results", str(tmp_path / "scan")]) == 2
    assert message in capsys.readouterr().err

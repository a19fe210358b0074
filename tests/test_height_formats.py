"""No format becomes a mirror image, wraps numbers or loses the sizes that it states."""

import codecs
import logging
import struct
import sys

import numpy as np
import pytest
from PIL import Image
from scipy.io import netcdf_file, savemat
from test_topography import sdf

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.topography import read_topography

# A letter F, seen from above; a little noise makes its values differ.
ROWS = np.random.default_rng(0).normal(0, 0.5, (12, 15)).round(2)
ROWS[2:10, 3:6] = ROWS[2:4, 3:12] = ROWS[5:7, 3:9] = 50
GRAY = np.where(ROWS > 25, 100, 0)
SIZES = {"spacing_mm": 0.2, "unit_mm": 1e-3}


def library():
    return pytest.importorskip("SurfaceTopography", reason="pip install SurfaceTopography")


def from_above(file, **keys):
    """Return what one sees from above: rows from large Y to small Y, columns along X."""
    return read_topography(file, **keys).heights_mm.T[::-1]


def tmd(file):
    """Write TrueMap's layout: rows of float32 in mm, the first on top."""
    ny, nx = ROWS.shape
    with file.open("wb") as stream:
        stream.write(b"Binary TrueMap Data File v2.0\r\n\0Created by TrueMap v6\r\n\0")
        stream.write(struct.pack("<2I4f", nx, ny, 0.2 * nx, 0.2 * ny, 0.0, 0.0))
        stream.write((1e-3 * ROWS).astype("<f4").tobytes())


def map_of(heights):
    sizes = tuple(0.2 * n for n in heights.shape)
    return library().Topography(heights, sizes, unit="mm")


def upwards(write):
    """Write heights (x, y) with Y upwards, as formats with coordinates hold them."""
    return lambda file: write(map_of(1e-3 * ROWS[::-1].T), file)


def xyz(file):
    j, i = np.indices(ROWS.shape)
    columns = 0.2 * i.ravel(), 0.2 * (len(ROWS) - 1 - j.ravel()), 1e-3 * ROWS.ravel()
    np.savetxt(file, np.column_stack(columns), header="x y z in mm")


def netcdf(order, dimensions):
    """Write a NetCDF file with its axes in some order, Y as it is or downwards."""

    def write(file):
        heights = {("y", "x"): 1e-3 * ROWS[::-1], ("x", "y"): 1e-3 * ROWS[::-1].T}[dimensions]
        if order < 0:
            heights = np.flip(heights, dimensions.index("y"))
        with netcdf_file(file, "w") as stream:
            for name, n in zip("xy", ROWS.shape[::-1], strict=True):
                stream.createDimension(name, n)
                variable = stream.createVariable(name, "d", (name,))
                variable[:] = 0.2 * np.arange(n)[:: order if name == "y" else 1]
                variable.length, variable.unit = 0.2 * n, "mm"
            stream.createVariable("heights", "d", dimensions)[:] = heights
            stream.variables["heights"].unit = "mm"

    return write


INSTRUMENTS = {
    "f.tmd": (tmd, {}),
    "f.gwy": (lambda file: map_of(1e-3 * ROWS.T).to_gwy(str(file)), {}),
    "f.sdf": (lambda file: sdf(file, 1e-3 * ROWS[::-1]), {"spacing_mm": 0.2, "unit_mm": 1.0}),
    "f.x3p": (upwards(lambda found, file: found.to_x3p(str(file))), {}),
    "f.nc": (upwards(lambda found, file: found.to_netcdf(str(file))), {}),
    "down.nc": (netcdf(-1, ("x", "y")), {}),
    "rows.nc": (netcdf(1, ("y", "x")), {}),
    "both.nc": (netcdf(-1, ("y", "x")), {}),
    "f.xyz": (xyz, {"spacing_mm": 0.2, "unit_mm": 1.0}),
}


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_an_instruments_map_is_seen_from_above_as_the_instrument_shows_it(name, tmp_path):
    library()
    write, keys = INSTRUMENTS[name]
    write(tmp_path / name)
    view = from_above(tmp_path / name, **keys)
    assert view == pytest.approx(1e-3 * ROWS, rel=1e-5, abs=1e-7)


def h5(file):
    with pytest.importorskip("h5py").File(file, "w") as stream:
        stream["heights"], stream["x"] = ROWS, np.arange(12.0)


def mat(file):
    savemat(file, {"heights": ROWS, "step": 0.2, "x": np.arange(12.0)})


ARRAYS = {
    "f.npy": lambda file: np.save(file, ROWS),
    "f.npz": lambda file: np.savez(file, heights=ROWS, step=0.2, x=np.arange(12.0)),
    "f.mat": mat,
    "f.h5": h5,
    "f.dat": lambda file: np.savetxt(file, ROWS),
    "f.unknown": lambda file: np.savetxt(file, ROWS),
    "f.txt": lambda file: np.savetxt(file, ROWS),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_without_sizes_lies_as_a_picture_turned_by_a_quarter(name, tmp_path):
    if name in ("f.npz", "f.mat", "f.h5", "f.unknown"):
        library()
    ARRAYS[name](tmp_path / name)
    assert from_above(tmp_path / name, **SIZES) == pytest.approx(np.rot90(1e-3 * ROWS))
    with pytest.raises(StudyError, match=r"stimulus\.spacing_mm must be given: .* states none"):
        read_topography(tmp_path / name)


def test_of_several_arrays_none_is_chosen(tmp_path):
    library()
    np.savez(tmp_path / "f.npz", left=ROWS, right=ROWS)
    with pytest.raises(StudyError, match=r"but holds 2 \(left, right\)"):
        read_topography(tmp_path / "f.npz", **SIZES)


def test_a_files_own_unit_is_that_of_its_values(tmp_path, caplog):
    library()
    tmd(tmp_path / "f.tmd")
    with caplog.at_level(logging.WARNING):
        same = from_above(tmp_path / "f.tmd", spacing_mm=0.2, unit_mm=1.0)
        assert not caplog.records
        lower = from_above(tmp_path / "f.tmd", spacing_mm=0.3, unit_mm=-0.5)
    assert lower == pytest.approx(-0.5 * same)
    assert "stimulus.spacing_mm = 0.3 replaces the 0.2 x 0.2 that" in caplog.text
    assert "stimulus.unit_mm = -0.5 replaces the 1 that" in caplog.text


# --- pictures --------------------------------------------------------------------------------


def tiff(file, values, sample_format, *, order="<", photometric=1, orientation=1):
    """Write an uncompressed TIFF; numbers of any type."""
    data, (ny, nx) = values.astype(values.dtype.newbyteorder(order)).tobytes(), values.shape
    tags = {256: nx, 257: ny, 258: 8 * values.itemsize, 259: 1, 262: photometric, 273: 8}
    tags |= {274: orientation, 277: 1, 278: ny, 279: len(data), 339: sample_format}
    entries = b"".join(struct.pack(order + "HHII", tag, 4, 1, n) for tag, n in tags.items())
    mark = b"II*\0" if order == "<" else b"MM\0*"
    head = mark + struct.pack(order + "I", 8 + len(data))
    file.write_bytes(head + data + struct.pack(order + "H", len(tags)) + entries + bytes(4))
    return file


TYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"]


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", TYPES)
def test_a_tiff_of_any_numbers_is_read_as_it_is(kind, order, tmp_path):
    if kind in ("i1", "u4", "u8", "i8", "f2", "f8"):
        pytest.importorskip("tifffile", reason="pip install tifffile")
    number = np.dtype(kind)
    values = GRAY.astype(number)
    if number.kind in "iu":  # of both halves of the range, where another type would wrap
        values[GRAY > 0] = np.iinfo(number).max
        values[0, :5] = np.iinfo(number).min // 2
    file = tiff(tmp_path / "f.tif", values, "uif".index(number.kind) + 1, order=order)
    unit = 1 / float(values.max())
    found = read_topography(file, spacing_mm=0.2, unit_mm=unit).heights_mm
    assert found == pytest.approx(unit * values.astype(float))


def test_compressed_doubles_are_read(tmp_path):
    tifffile = pytest.importorskip("tifffile", reason="pip install tifffile")
    tifffile.imwrite(tmp_path / "f.tif", ROWS, compression="zlib")
    assert from_above(tmp_path / "f.tif", **SIZES) == pytest.approx(np.rot90(1e-3 * ROWS))


@pytest.mark.parametrize("kind", ["u1", "f8"])
def test_a_tiff_that_counts_from_white_or_lies_mirrored_is_no_other_surface(kind, tmp_path):
    if kind == "f8":
        pytest.importorskip("tifffile", reason="pip install tifffile")
    values, form = GRAY.astype(kind), 1 if kind == "u1" else 3
    with pytest.raises(StudyError, match="WhiteIsZero"):
        from_above(tiff(tmp_path / "white.tif", values, form, photometric=0), **SIZES)
    mirrored = tiff(tmp_path / "mirrored.tif", values[:, ::-1], form, orientation=2)
    if kind == "u1":
        assert from_above(mirrored, **SIZES) == pytest.approx(np.rot90(1e-3 * GRAY))
    else:
        with pytest.raises(StudyError, match=r"turned or mirrored \(Orientation 2\)"):
            from_above(mirrored, **SIZES)


def test_a_png_that_says_it_is_mirrored_is_turned_back(tmp_path):
    said = Image.Exif()
    said[274] = 2
    Image.fromarray(GRAY.astype(np.uint8)[:, ::-1]).save(tmp_path / "f.png", exif=said)
    assert from_above(tmp_path / "f.png", **SIZES) == pytest.approx(np.rot90(1e-3 * GRAY))


def test_a_png_of_few_bits_is_refused_as_its_values_would_be_stretched(tmp_path):
    Image.fromarray((GRAY > 0).astype(np.uint8) * 15).save(tmp_path / "f.png", bits=4)
    with pytest.raises(StudyError, match="has 4 bits a value but must have 8 or 16"):
        from_above(tmp_path / "f.png", **SIZES)


@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_the_marker_of_a_geotiff_is_no_height(kind, tmp_path):
    tifffile = pytest.importorskip("tifffile", reason="pip install tifffile")
    values = ROWS.astype(kind)
    values[3, 4] = -7
    marker = (42113, "s", 0, "-7", True)
    tifffile.imwrite(tmp_path / "f.tif", values, extratags=[marker])
    with pytest.raises(StudyError, match="1 missing or infinite heights, the first in row 3"):
        from_above(tmp_path / "f.tif", **SIZES)


def test_a_transparent_gray_value_is_no_height(tmp_path):
    Image.fromarray(GRAY.astype(np.uint8)).save(tmp_path / "f.png", transparency=int(GRAY[0, 0]))
    with pytest.raises(StudyError, match="without colours, palette or transparency"):
        from_above(tmp_path / "f.png", **SIZES)


@pytest.mark.parametrize("name", ["_FillValue", "missing_value"])
def test_the_marker_of_an_hdf5_array_is_no_height(name, tmp_path):
    h5py = pytest.importorskip("h5py")
    values = ROWS.astype("f4")
    values[3, 4] = -7.1
    with h5py.File(tmp_path / "f.h5", "w") as stream:
        stream.create_dataset("heights", data=values).attrs[name] = np.float32(-7.1)
    with pytest.raises(StudyError, match="1 missing or infinite heights, the first in row 3"):
        from_above(tmp_path / "f.h5", **SIZES)


# --- tables ----------------------------------------------------------------------------------


def table(separator="\t", decimal="."):
    lines = [separator.join(f"{v:.2f}".replace(".", decimal) for v in row) for row in ROWS]
    return "\n".join(lines) + "\n"


def quoted():
    return "\n".join(";".join(f'"{v:.2f}"'.replace(".", ",") for v in row) for row in ROWS)


TABLES = {
    "a German spreadsheet": (table(";", ","), "utf-8"),
    "tabs and decimal commas": (table("\t", ","), "utf-8"),
    "blanks and decimal commas": (table("  ", ","), "utf-8"),
    "commas and blanks": (table(", "), "utf-8"),
    "quoted": (quoted(), "utf-8"),
    "a separator at the end": (table(";").replace("\n", ";\n"), "utf-8"),
    "an old Macintosh": (table(" ").replace("\n", "\r"), "utf-8"),
    "UTF-16": (table(" "), "utf-16"),
    "UTF-16 without a mark": (table(","), "utf-16-le"),
    "a mark": (table(","), "utf-8-sig"),
    "Windows-1252": ("# Breite: 1,4 µm\n" + table(), "cp1252"),
    "a heading": ("Höhe in µm;;;\n" + table(";", ","), "cp1252"),
    "a last line": (table(" ") + "# 12 rows\n", "utf-8"),
    "remarks": (table(" ").replace("\n", "\n# next\n"), "utf-8"),
}


@pytest.mark.parametrize("ending", ["csv", "txt", "asc", "dat"])
@pytest.mark.parametrize("name", TABLES)
def test_a_table_of_any_program_is_read(name, ending, tmp_path):
    text, encoding = TABLES[name]
    file = tmp_path / f"f.{ending}"
    file.write_bytes(text.encode(encoding))
    assert read_topography(file, **SIZES).heights_mm == pytest.approx(1e-3 * ROWS)


HEADERS = {
    "Gwyddion": "# Channel: Z\n# Width: 4.5 mm\n# Height: 2.4 mm\n# Value units: um\n",
    "in German": "# Kanal: Z\n# Breite: 4,5 mm\n# Höhe: 2,4 mm\n# Einheiten: µm\n",
    "in metres": "# Width: 0.0045 m\n# Height: 0.0024 m\n# Value units: um\n",
    "without marks": "Width: 4.5 mm\nHeight: 2.4 mm\nValue units: um\n",
    "SPIP": "# File Format = ASCII\n# x-pixels = 15\n# y-pixels = 12\n# x-length = 4.5e6\n"
    "# y-length = 2.4e6\n# z-unit = um\n",
}


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
@pytest.mark.parametrize("name", HEADERS)
def test_the_header_of_a_table_states_its_sizes(name, encoding, tmp_path):
    """Width is that of a row, along Y; the rows follow each other along X over the height."""
    library()
    (tmp_path / "f.txt").write_text(HEADERS[name] + table(), encoding=encoding)
    found = read_topography(tmp_path / "f.txt")
    assert found.heights_mm == pytest.approx(1e-3 * ROWS)
    assert found.spacing_mm == pytest.approx((0.2, 0.3))


def test_without_the_library_a_header_is_not_known(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "SurfaceTopography.IO", None)
    (tmp_path / "f.txt").write_text(HEADERS["Gwyddion"] + table())
    assert read_topography(tmp_path / "f.txt", **SIZES).spacing_mm == (0.2, 0.2)
    with pytest.raises(StudyError, match="a header is read by SurfaceTopography: pip install"):
        read_topography(tmp_path / "f.txt")


def test_a_header_may_state_less(tmp_path, caplog):
    library()
    file = tmp_path / "f.txt"
    file.write_text("# Width: 4.5 mm\n# Height: 2.4 mm\n" + table())
    assert read_topography(file, unit_mm=1.0).spacing_mm == pytest.approx((0.2, 0.3))
    with pytest.raises(StudyError, match=r"stimulus\.unit_mm must be given"):
        read_topography(file)
    file.write_text("# Width: 4.5 mm\n# Value units: um\n" + table())
    assert read_topography(file, spacing_mm=1.0).heights_mm[0, 0] == 1e-3 * ROWS[0, 0]
    with pytest.raises(StudyError, match=r"stimulus\.spacing_mm must be given"):
        read_topography(file)
    file.write_text("# x-pixels = 16\n" + table())
    read_topography(file, **SIZES)
    assert "f.txt is not used: The number of columns (=15)" in caplog.text


WRONG = {
    "a word": (table().replace("50.00", "abc", 1), r'"abc" in line 3 is no number'),
    "a shorter row": (table() + "1\t2\t3\n", "line 13 has 3 numbers, those before it 15"),
    "thousands": (table(";", ",").replace("50,00", "1.050,00"), r'"1\.050\.00" in line 3'),
    "two maps": (
        "# Channel: A\n" + table() + "# Channel: B\n" + table(),
        "several tables, the second from line 14",
    ),
    "an empty cell": (table(",").replace("50.00", "", 1), "1 missing or infinite heights"),
    "a marker": ("NODATA_value -9999\n" + table().replace("50.00", "-9999", 1), "1 missing"),
    "a word for it": (table().replace("50.00", "BAD", 2), "2 missing or infinite heights"),
    "no text": (codecs.BOM_UTF16_LE, "it is no text"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_table_with_a_mistake_says_where_it_is(name, tmp_path):
    text, sentence = WRONG[name]
    (tmp_path / "f.csv").write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(StudyError, match=sentence):
        read_topography(tmp_path / "f.csv", **SIZES)

"""Text is read in the encodings that editors and spreadsheets write; else one sentence says why."""

import codecs

import pytest

from tactile_fem.calibration.measurements import read_measurements
from tactile_fem.errors import StudyError
from tactile_fem.path.recording import PLACES, read_recording
from tactile_fem.runtime.text import read_rows, read_text
from tactile_fem.study.file import load_study

ENCODINGS = {
    "UTF-8": "utf-8",
    "with a mark": "utf-8-sig",
    "UTF-16": "utf-16",
    "UTF-16 of the other order": codecs.BOM_UTF16_BE,
    "UTF-16 without a mark": "utf-16-le",
    "the other order without a mark": "utf-16-be",
    "UTF-32": "utf-32",
}
STUDY = '[stimulus]\ntext = "FÜ"\n[protocol]\ndepth_mm = 0.3\n'
WAY = "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n1,0,-1.5,0.5\n"
FORCES = "indenter,speed_mm_s,depth_mm,force_N,sd_N\ncylinder radius_mm=1.5,0.2,0.5,0.037,0.01\n"


def write(file, text, encoding="utf-8"):
    if encoding == codecs.BOM_UTF16_BE:
        file.write_bytes(encoding + text.encode("utf-16-be"))
    else:
        file.write_text(text, encoding=encoding, newline="")
    return file


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("name", ENCODINGS)
def test_a_study_a_path_and_forces_are_read_in_each_encoding(name, end, tmp_path):
    def file(text):
        return write(tmp_path / "file", text.replace("\n", end), ENCODINGS[name])

    assert read_text(file(STUDY), "it") == STUDY
    study = load_study(file(STUDY))
    assert (study.stimulus.text, study.protocol.depth_mm) == ("FÜ", 0.3)
    way = read_recording(file(WAY))
    assert (way.time_s[1], way.of(PLACES)[1].tolist()) == (1.0, [0, -1.5, 0.5])
    (experiment,) = read_measurements([file(FORCES)])
    assert (experiment.indenter.radius_mm, experiment.mean[0]) == (1.5, 0.037)


def test_semicolons_and_decimal_commas_are_those_of_a_spreadsheet(tmp_path):
    file = write(tmp_path / "f.csv", WAY.replace(",", ";").replace(".", ","))
    assert read_recording(file).of(PLACES)[1].tolist() == [0, -1.5, 0.5]
    text = "indenter;speed_mm_s;depth_mm;force_N;sd_N\ncylinder radius_mm=1.5;0,2;0,5;0,037;0,01\n"
    (experiment,) = read_measurements([write(file, text)])
    assert (experiment.speed_mm_s, experiment.mean[0]) == (0.2, 0.037)
    assert read_rows(write(file, "a;b\n\n1,5;x,y\n"), "it") == [
        (1, ["a", "b"]),
        (3, ["1.5", "x,y"]),
    ]


def test_another_encoding_is_refused_with_what_helps(tmp_path):
    file = write(tmp_path / "s.toml", STUDY, "cp1252")
    sentence = (
        r"s\.toml cannot be read: not UTF-8 text \(byte 0xdc in line 2\)\. Save it with .*UTF-8"
    )
    with pytest.raises(StudyError, match=sentence):
        load_study(file)
    with pytest.raises(StudyError, match="Save it with the encoding UTF-8"):
        read_recording(write(file, WAY + "# ü\n", "cp1252"))
    assert read_text(file, "it", western=True).endswith("# ü\n")


@pytest.mark.parametrize("data", [b"\xff\xfe", b"\xff\xfea\0b", b"\x80\0\1\2", b"\xfe\xff"])
def test_what_is_no_text_is_told(data, tmp_path):
    (tmp_path / "f").write_bytes(data)
    with pytest.raises(StudyError, match=r"It cannot be read: not UTF-8 text\.$"):
        read_text(tmp_path / "f", "It")

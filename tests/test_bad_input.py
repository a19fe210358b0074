"""What a wrong study, command, mesh, font or results folder is answered with: one sentence."""

from __future__ import annotations

import logging
import shlex
from pathlib import Path

import numpy as np
import pytest
from synthetic import make_results

from tactile_fem.cli import app as cli
from tactile_fem.finger import write_msh
from tactile_fem.runtime import doctor, logs, ranks
from tactile_fem.study import Finger

# {here} stands for the folder; what follows ... is another library's.
SETTINGS = [
    ("finger.dermis_mm=-0.8", "finger.dermis_mm is -0.8 but must be greater than 0."),
    ('finger.dermis_mm="0.8 mm"', 'finger.dermis_mm is "0.8 mm" but must be a number.'),
    (
        "protocol.depth_mm=1970",
        "protocol.depth_mm is 1970 but must be less than 5.3, the finger's thickness from skin to "
        "bone over the contact point.",
    ),
    ("finger.dermis_mm=true", "finger.dermis_mm is true but must be a number."),
    ("finger.dermis_mm=nan", "finger.dermis_mm is nan but must be a finite number."),
    ("finger.preset=cors", 'finger.preset is "cors" but must be "coarse", "medium" or "paper".'),
    ("finger.epidermis_rows=2.5", "finger.epidermis_rows is 2.5 but must be a whole number."),
    ("finger.epidermis_rows=9", "finger.epidermis_rows is 9 but must be at most 8."),
    ("finger.dermis=1", "finger.dermis is not a key of [finger]; did you mean dermis_mm?"),
    ("fingr.dermis_mm=1", "fingr is not a section of the study; did you mean finger?"),
    ("finger.pad_size_mm=0.001", "finger.pad_size_mm is 0.001 but must be at least 0.02."),
    (
        "finger.far_size_mm=0.5",
        "finger.far_size_mm = 0.5 must not be smaller than the edge under the contact patch, 1.",
    ),
    (
        "finger.dermis_mm=6",
        "the layers of skin (6.82 mm) are too thick for a finger of half width 8 mm and dorsal "
        "height 5.5 mm.",
    ),
    (
        "finger.dermis_mm=1.6",
        "the bone comes to lie 1.74 mm below the skin at X -0.1, Y -15.0, Z 14.9 mm in the "
        "finger's axes, but the layers need 2.57 mm: use thinner layers, a smaller bone or a "
        "thicker finger.",
    ),
    (
        "finger.pad_radius_mm=1",
        "finger.pad_radius_mm = 1 is too small for a tip of 12 mm: it must exceed 10.5 mm.",
    ),
    (
        "finger.tip_length_mm=20",
        "finger.tip_length_mm = 20 is longer than contact_from_tip_mm = 12: the contact "
        "point must lie proximal of the rounded tip.",
    ),
    (
        "finger.bone_tip_gap_mm=30",
        "finger.bone_tip_gap_mm = 30 leaves no bone over the contact point: it must be at most 11.",
    ),
    (
        "finger.nail_width_mm=30",
        "the nail (30 mm wide, 12 mm long) does not fit on the back of the finger.",
    ),
    (
        "finger.nail_thickness_mm=5",
        "finger.nail_thickness_mm = 5 must be less than the layers of skin, 1.62 mm.",
    ),
    (
        "finger.straight_length_mm=0.1",
        "the finger is cut 0 mm proximal of the contact point; lengthen "
        "finger.straight_length_mm so that it is at least 3 mm.",
    ),
    ("finger.mesh_file=none.msh", "finger.mesh_file = {here}/none.msh does not exist."),
    (
        "finger.mesh_file=~nosuchuser/a.msh",
        "finger.mesh_file = {here}/~nosuchuser/a.msh does not exist.",
    ),
    ("finger.mesh_file=5", "finger.mesh_file is 5 but must be the path of a file."),
    (
        "finger.mesh_file=text.msh",
        "cannot read the mesh {here}/text.msh: it is no .msh file, or damaged (it has no section "
        "$MeshFormat).",
    ),
    (
        "finger.mesh_file=half.msh",
        "cannot read the mesh {here}/half.msh: it is no .msh file, or damaged ($Elements "
        "has no end).",
    ),
    (
        "finger.mesh_file=binary.msh",
        "cannot read the mesh {here}/binary.msh: it is no .msh file, or damaged (it has no section "
        "$MeshFormat).",
    ),
    (
        "finger.mesh_file=untagged.msh",
        "the mesh {here}/untagged.msh lacks the physical group dermis.",
    ),
    ("finger.mesh_file=nan.msh", "the mesh has nodes whose coordinates are no finite numbers."),
    ("finger.mesh_file=metres.msh", "the mesh is 0.027 mm long, which is no finger: is it in mm?"),
    (
        "finger.mesh_file=mirrored.msh",
        "8990 tetrahedra have a non-positive Jacobian, the first at (-5.49, 1.69, 11.00) mm.",
    ),
    (
        "tissue.set=maeno",
        'tissue.set is "maeno" but must be "fitted", "plate", "proposed", "maeno1998" or '
        '"gerling2014".',
    ),
    (
        "tissue.set=[1]",
        'tissue.set is [1] but must be "fitted", "plate", "proposed", "maeno1998" or '
        '"gerling2014".',
    ),
    ("tissue.bone.nu=0.5", "tissue.bone.nu is 0.5 but must be less than 0.5."),
    ("tissue.bone.E_MPa=inf", "tissue.bone.E_MPa is inf but must be a finite number."),
    ("tissue.dermis=5", "tissue.dermis is 5 but must be a table of values."),
    (
        "tissue.dermis.nu=0.3",
        "tissue.dermis.nu is not a key of [tissue.dermis]; allowed: g, tau_s, C10_MPa, C01_MPa, "
        "C20_MPa, C11_MPa, C02_MPa, C30_MPa, D1_per_MPa, D2_per_MPa.",
    ),
    (
        "tissue.dermis.C01_MPa=-1",
        "tissue.dermis: C10_MPa + C01_MPa is -0.995204 but must be greater than 0, being half "
        "the shear modulus.",
    ),
    (
        "tissue.muscle.C10_MPa=1",
        "tissue.muscle is not a key of [tissue]; allowed: set, viscous_time_s, relaxation, "
        "density_kg_m3, stratum_corneum, epidermis, dermis, subcutaneous, bone, nail.",
    ),
    (
        "stimulus.kind=sphare",
        'stimulus.kind is "sphare", which is no kind of stimulus; did you mean sphere?',
    ),
    (
        "stimulus.relief=1",
        'stimulus.relief is not a key of a stimulus of kind "text"; did you mean relief_mm?',
    ),
    (
        "stimulus.radius_mm=2",
        'stimulus.radius_mm is not a key of a stimulus of kind "text"; it goes with kind = '
        '"cylinder", "sphere", "edge" or "dots".',
    ),
    ("stimulus.friction=-1", "stimulus.friction is -1 but must be at least 0."),
    ("stimulus.shift_mm=[1]", "stimulus.shift_mm (entry 2) is missing: stimulus.shift_mm is [1]."),
    ("stimulus.text=", 'stimulus.text is "" but must be at least 1 character long.'),
    ('stimulus.text=" "', 'stimulus.text holds no letter; for a flat plate set kind = "plate".'),
    ("stimulus.text=F中", 'stimulus.text: the font "DejaVu Sans" has no glyph for "中".'),
    (
        "stimulus.text=FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFF",
        'stimulus.text is "FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFF" but must be at '
        "most 40 characters long.",
    ),
    (
        "stimulus.font=Nosuchfont",
        'stimulus.font = "Nosuchfont": no such font is installed; give a family name or the '
        "path of a .ttf file.",
    ),
    ("stimulus.font=none.ttf", 'stimulus.font = "{here}/none.ttf": there is no such file.'),
    ("stimulus.font=no.ttf", 'stimulus.font = "{here}/no.ttf" cannot be read as a font.'),
    (
        "stimulus.g_width_mm=0.5",
        'stimulus.corner_radius_mm = 0.3: strokes or gaps of "FGH" in "DejaVu Sans" are too '
        "thin for it, which must be less than half of each: corner_radius_mm and "
        "fillet_radius_mm must not exceed 0.031.",
    ),
    ("stimulus.g_width_mm=1e9", "stimulus.g_width_mm is 1000000000.0 but must be at most 100."),
    (
        "stimulus.fillet_radius_mm=0.5",
        "stimulus.fillet_radius_mm = 0.5 must not exceed corner_radius_mm (0.3).",
    ),
    ("protocol.depth_mm=0", "protocol.depth_mm is 0 but must be greater than 0."),
    ("protocol.depth_mm=", 'protocol.depth_mm is "" but must be a number.'),
    ("protocol.force_N=0", "protocol.force_N is 0 but must be greater than 0."),
    (
        "protocol.output_mm=1e-12",
        "protocol: piece 2 of its path (slide) has an output every 5e-14 s, more than 100,000 in "
        "all: raise output_mm or output_s.",
    ),
    (
        "protocol.speed_mm_s=1e-9",
        "protocol: its path lasts 1e+10 s but may last 100,000 s at most: shorten it or raise its "
        "speeds.",
    ),
    (
        "receptors.placement=circle",
        'receptors.placement is "circle" but must be "line", "grid", "random", "afferents", '
        '"intermediate_ridges" or "papillae".',
    ),
    (
        "receptors.half_width_mm=30",
        "receptors: the receptor at X -30, Y 0 mm lies outside the finger; choose a smaller "
        "extent or another place.",
    ),
    (
        "receptors.spacing_mm=1e-9",
        "receptors: 1e+10 receptors are more than 100,000; choose a smaller extent, a longer "
        "spacing_mm or a lower density_per_cm2.",
    ),
    (
        "receptors.extra_mm=[[100, 100]]",
        "receptors: the receptor at X 100, Y 100 mm lies outside the finger; choose a "
        "smaller extent or another place.",
    ),
    (
        "receptors.extra_mm=[[1, 2, 3]]",
        "receptors.extra_mm (entry 1) is [1, 2, 3] but must be a list of at most 2 entries.",
    ),
    ("receptors.seed=-1", "receptors.seed is -1 but must be at least 0."),
    ("neuron.adaptation=1.5", "neuron.adaptation is 1.5 but must be at most 1."),
    (
        "neuron.model=poisson",
        'neuron.model is "poisson" but must be "logarithmic", "hamasaki2020", "gerling2018" '
        'or "band_pass".',
    ),
    (
        "neuron.generator_times_s=[1, 2]",
        "neuron.generator_times_s (entry 3) is missing: neuron.generator_times_s is [1, 2].",
    ),
    ("solver.inertia=1", "solver.inertia is 1 but must be true or false."),
    ("solver.held=[bone]", 'solver.held is "[bone]" but must be a list.'),
    ("solver.held=[]", "solver.held is [] but must be a list of at least 1 entry."),
    (
        'solver.held=["bone", "skin"]',
        'solver.held (entry 2) is "skin" but must be "bone", "nail" or "cut".',
    ),
    ("solver.nitsche_theta=0.5", "solver.nitsche_theta is 0.5 but must be -1, 0 or 1."),
    ("solver.compiler_flags=-O3", 'solver.compiler_flags is "-O3" but must be a list.'),
    (
        "solver.petsc.ksp_type=[1]",
        "solver.petsc.ksp_type is [1] but must be text, a number, true or false.",
    ),
    ("output.pictures=yes", 'output.pictures is "yes" but must be true or false.'),
    (
        "output.video=true",
        "output.video is not a key of [output]; allowed: fields_mm, states, pictures.",
    ),
    ("tissue.density_kg_m3=0", "tissue.density_kg_m3 is 0 but must be greater than 0."),
    ("finger=3", '"finger=3" sets nothing: write section.key=value.'),
    ("finger.dermis_mm", '"finger.dermis_mm" sets nothing: write section.key=value.'),
    (
        "a.b.c.d=1",
        "a is not a section of the study; allowed: finger, tissue, stimulus, protocol, "
        "receptors, neuron, afferents, solver, output.",
    ),
    ("=5", '"=5" sets nothing: write section.key=value.'),
]

# What starts from a study, with what each needs besides.
_STARTS = {
    "scan": "",
    "preview": " -o new.png",
    "export": " --deck new.inp",
    "mesh": " -o new.msh",
    "sweep": " --over protocol.depth_mm=1,2",
    "fibre": "",
}
_SPEED = (
    'afferents.fast.feels: There is no drive "speed"; there are sed, von_mises, largest_stretch, '
    "smallest_stretch, largest_stress, smallest_stress, compression, indentation, pressure, and "
    'their "_rate".'
)
_GRID = (
    'receptors.placement = "grid" does not lie in a section: use "line", "intermediate_ridges" or '
    '"papillae".'
)

COMMANDS = [
    (
        "scan --set receptors.placement=afferents --set receptors.density_per_cm2=1e9",
        "receptors: 8e+08 receptors are more than 100,000; choose a smaller extent, a longer "
        "spacing_mm or a lower density_per_cm2.",
    ),
    (
        "scan --set finger.mesh_file=finger.msh --set finger.dermis_mm=1.5",
        "finger: dermis_mm = 1.5 would have no effect beside mesh_file: give one or the other.",
    ),
    (
        "mesh thick.toml --set finger.mesh_file=finger.msh",
        'finger: preset = "paper", dermis_mm = 1.5 would have no effect beside mesh_file: give one '
        "or the other.",
    ),
    (
        "scan --set protocol.force_N=0.6 --set protocol.depth_mm=1.5",
        "protocol: depth_mm = 1.5 would have no effect beside force_N: give one or the other.",
    ),
    (
        "scan --set stimulus.kind=dots --set stimulus.pitch_mm=5",
        'stimulus.pitch_mm is not a key of a stimulus of kind "dots"; it goes with kind = "text".',
    ),
    ("scan none.toml", "There is no study file none.toml."),
    (
        "scan twice.toml",
        "The study file twice.toml is not valid TOML: ...",
    ),
    (
        "scan comma.toml",
        "The study file comma.toml is not valid TOML: ...",
    ),
    ("scan flat.toml", "depth_mm is not a section of the study; did you mean protocol.depth_mm?"),
    ("scan value.toml", "protocol is 3 but must be a table of values."),
    ("scan list.toml", "finger is a list of tables but must be a table of values."),
    ("scan binary.toml", "The study file binary.toml cannot be read: not UTF-8 text."),
    ("scan full", "The study file full cannot be read: Is a directory."),
    (
        "scan --results full",
        "The results folder full is not empty: choose another one, or overwrite the scan in it.",
    ),
    (
        "scan --results done",
        "The results folder done is not empty: choose another one, or overwrite the scan in it.",
    ),
    ("scan --results no.ttf", "The results folder no.ttf is a file: choose another name."),
    (
        "scan --results no.ttf/below",
        "The results folder no.ttf/below cannot be made: {here}/no.ttf is a file.",
    ),
    ("scan --ranks 0", 'Invalid value "0" for --ranks. Must be >= 1.'),
    ("scan --ranks two", 'Invalid value for --ranks: unable to convert "two" into int.'),
    ("scan --unknown", "Unknown option: --unknown."),
    ("scan -tactile_", '"solver.petsc.=""" sets nothing: write section.key=value.'),
    ("walk", 'Unknown command "walk". ...'),
    ("plot", 'Command "plot" parameter RESULTS requires an argument.'),
    ("plot none", "none holds no results: there is no study.toml in it."),
    ("plot emptied", "There is no emptied/trace.npz: it has not been written yet."),
    (
        "plot pickled",
        "pickled/trace.npz cannot be read: Object arrays cannot be loaded when allow_pickle=False.",
    ),
    (
        "plot foreign",
        "foreign/trace.npz is no trace of a scan: it lacks time_s, displacement_mm, "
        "depth_mm, force_N, receptors_mm, sed_kPa.",
    ),
    ("plot cut", "cut/trace.npz cannot be read: File is not a zip file."),
    (
        "plot old",
        "The study of old cannot be used: finger.dermis is not a key of [finger]; did you "
        "mean dermis_mm?",
    ),
    (
        "plot spikes",
        "spikes/spikes.csv cannot be read: its columns must be "
        "receptor,time_s,displacement_mm,population.",
    ),
    ("resume none", "none holds no results: there is no study.toml in it."),
    (
        "resume old",
        "The study of old cannot be used: finger.dermis is not a key of [finger]; did you "
        "mean dermis_mm?",
    ),
    ("mesh -o finger.stl", '--output is "finger.stl" but must end in .msh.'),
    ("mesh -o none/finger.msh", '--output is "none/finger.msh" but there is no folder none.'),
    ("init no.ttf", "no.ttf exists already: choose another name."),
    ("init none/study.toml", 'FILE is "none/study.toml" but there is no folder none.'),
    ("export", 'Command "export" parameter --deck requires an argument.'),
    ("export --deck finger.stl", '--deck is "finger.stl" but must end in .inp.'),
    (
        "export --deck none/finger.inp",
        '--deck is "none/finger.inp" but there is no folder none.',
    ),
    (
        "export --deck new.inp --format ansys",
        'Invalid value "ansys" for --format. Choose from: "calculix", "abaqus".',
    ),
    ("export --deck new.inp --grid-mm 0", 'Invalid value "0.0" for --grid-mm. Must be > 0.'),
    (
        "export --deck new.inp --set protocol.force_N=0.5",
        "protocol.force_N is 0.5 but a deck knows no force: press to a depth_mm and hold the "
        "depth.",
    ),
    (
        "export --deck new.inp --set protocol.depth_mm=1970",
        "protocol.depth_mm is 1970 but must be less than 5.3, the finger's thickness from skin to "
        "bone over the contact point.",
    ),
    (
        "export --deck new.inp --set receptors.half_width_mm=30",
        "receptors: the receptor at X -30, Y 0 mm lies outside the finger; choose a smaller "
        "extent or another place.",
    ),
    *(
        (
            f"{command} --set receptors.side=subcutaneous",
            "receptors.average_radius_mm = 0.25: no subcutaneous within reach of the receptor at X "
            "-5, Y 0 mm.",
        )
        for command in ("scan", "export --deck new.inp", "sweep --over protocol.depth_mm=1,2")
    ),
    *((f"{command} speed.toml{options}", _SPEED) for command, options in _STARTS.items()),
    *(
        (f"{command}{options} --set finger.kind=section --set receptors.placement=grid", _GRID)
        for command, options in _STARTS.items()
    ),
    ("fit forces.csv --study speed.toml", _SPEED),
    ("sweep", 'Command "sweep" parameter --over requires an argument.'),
    ("sweep --over protocol.depth_mm=0,1", "protocol.depth_mm is 0 but must be greater than 0."),
    (
        "fibre --spacing-mm 0",
        "spacing 0 mm, half width 5 mm: the spacing must be positive and at most the half width.",
    ),
    ("report none", "none holds no results: there is no study.toml in it."),
    ("report cut", "cut/trace.npz cannot be read: File is not a zip file."),
    ("export --deck old.inp", "old.inp exists already: choose another name, or --overwrite."),
]


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    """A folder full of things that cannot be used."""
    folder = tmp_path_factory.mktemp("bad")
    _write_meshes(folder)
    (folder / "no.ttf").write_bytes(b"no font")
    (folder / "twice.toml").write_text("[protocol]\ndepth_mm = 1.0\ndepth_mm = 2.0\n")
    (folder / "comma.toml").write_text("[protocol]\ndepth_mm = 1,0\n")
    (folder / "thick.toml").write_text('[finger]\npreset = "paper"\ndermis_mm = 1.5\n')
    (folder / "flat.toml").write_text("depth_mm = 1.0\n")
    (folder / "value.toml").write_text("protocol = 3\n")
    (folder / "list.toml").write_text("[[finger]]\ndermis_mm = 1.0\n")
    (folder / "speed.toml").write_text('[[afferents]]\nname = "fast"\nfeels = "speed"\n')
    (folder / "forces.csv").write_text(
        "indenter,speed_mm_s,depth_mm,force_N,sd_N\nplate,0.2,1,0.2,0.1\n"
    )
    (folder / "binary.toml").write_bytes(b"\xff\xfe")
    (folder / "old.inp").write_text("mine")
    (folder / "full").mkdir()
    (folder / "full" / "notes.md").write_text("mine")
    for name in ("done", "emptied", "pickled", "foreign", "cut", "old", "spikes", "run"):
        make_results(folder / name)
    trace = "trace.npz"
    (folder / "emptied" / trace).unlink()
    np.savez(folder / "pickled" / trace, time_s=np.array([{}], dtype=object))
    np.savez(folder / "foreign" / trace, x=np.zeros(3))
    (folder / "cut" / trace).write_bytes((folder / "cut" / trace).read_bytes()[:500])
    (folder / "old" / "study.toml").write_text("[finger]\ndermis = 1.0\n")
    (folder / "spikes" / "spikes.csv").write_text("receptor,time_s\nx,y\n")
    return folder


def _write_meshes(folder: Path) -> None:
    write_msh(folder / "finger.msh", Finger().mesh())
    text = (folder / "finger.msh").read_text()
    lines = text.split("\n")
    first, last = lines.index("$Nodes") + 2, lines.index("$EndNodes")
    numbers, places = np.split(np.array([line.split() for line in lines[first:last]]), [1], axis=1)

    def moved(factors: list[float]) -> str:
        rows = np.hstack([numbers, (places.astype(float) * factors).astype(str)])
        return "\n".join([*lines[:first], *map(" ".join, rows), *lines[last:]])

    contents = {
        "text": "hello",
        "half": text[: len(text) // 2],
        "untagged": text.replace('"dermis"', '"derm"'),
        "nan": moved([1, 1, np.nan]),
        "metres": moved([1e-3, 1e-3, 1e-3]),
        "mirrored": moved([-1, 1, 1]),
    }
    for name, content in contents.items():
        (folder / f"{name}.msh").write_text(content)
    (folder / "binary.msh").write_bytes(bytes(range(256)) * 20)


@pytest.fixture
def answer(here, monkeypatch, capsys):
    """Return a function that runs a command and returns its one sentence."""
    monkeypatch.chdir(here)
    monkeypatch.setattr(logs, "set_up", lambda *args, **kwargs: None)
    monkeypatch.setattr(logging.getLogger(logs.PACKAGE), "handlers", [])
    for name in ranks._RANK_VARIABLES:
        monkeypatch.delenv(name, raising=False)

    def too_far():
        raise AssertionError("a bad study comes as far as the compiler")

    monkeypatch.setattr(doctor, "compiler_finding", too_far)
    before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}

    def run(arguments: list[str]) -> str:
        assert cli.main(arguments) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before
        return line.removeprefix("tactile-fem: ").replace(str(here), "{here}")

    return run


def assert_says(sentence: str, expected: str) -> None:
    if expected.endswith("..."):
        assert sentence.startswith(expected.removesuffix("..."))
    else:
        assert sentence == expected


@pytest.mark.parametrize("setting, sentence", SETTINGS)
def test_a_bad_value(answer, setting, sentence):
    assert_says(answer(["scan", "--set", setting]), sentence)


@pytest.mark.parametrize("command, sentence", COMMANDS)
def test_a_bad_command(answer, command, sentence):
    assert_says(answer(shlex.split(command)), sentence)

import inspect
import json
import re
import tomllib
from pathlib import Path

import pytest
from pydantic import ValidationError

from tactile_fem.errors import StudyError
from tactile_fem.study import (
    Afferents,
    Finger,
    Joint,
    People,
    Protocol,
    Stimulus,
    Study,
    Text,
)
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.template import commented_template


def test_no_file_and_an_empty_file_are_the_papers_study(tmp_path):
    (tmp_path / "empty.toml").write_text("")
    assert load_study() == Study() == load_study(tmp_path / "empty.toml")


def test_the_template_is_the_papers_study_as_it_is_and_with_every_line_in_force():
    template = commented_template()
    active = re.sub(r"^#(?=\w+ = )", "", template, flags=re.MULTILINE)
    assert Study.model_validate(tomllib.loads(template)) == Study()
    values = tomllib.loads(active)
    assert Study.model_validate(values) == Study()
    assert values["stimulus"]["text"] == "FGH"
    assert values["tissue"]["dermis"]["C10_MPa"] == Study().tissue.dermis.C10_MPa


def test_the_template_mentions_every_key():
    template = commented_template()
    sections = set(Study.model_fields) - {"afferents", "joint", "people"}
    models = [
        *(type(getattr(Study(), name)) for name in sections),
        Joint,
        People,
        *Stimulus.kinds.values(),
        Afferents,
    ]
    for model in models:
        for key, info in model.model_fields.items():
            assert re.search(rf"\b{key}\b", template), key
            words = " ".join(re.sub(r"\n# ", " ", template).split())
            assert " ".join((info.description or "").split()) in words, key
    assert max(map(len, template.splitlines())) <= 100


@pytest.mark.parametrize(
    "line",
    [
        "#     angle_deg = 60.0            # opening angle [> 0, < 180]",
        "#     count = 9                   # number of ridges [>= 1, <= 200]",
        '#     along = "x"                 # direction of the ridges ["x", "y"]',
        "#nu = 0.3                         # Poisson's ratio [> -1, < 0.5]",
        "#adaptation = 0.0958              # kappa; fitted, for hamasaki2020 proposed [>= 0, <= 1]",
        "#generator_times_s = [0.008, 0.2, 1.745]  # gerling2018: tau_i; Gerling 2018 [> 0]",
        '# parts that are fixed; the others deform ["bone", "nail", "cut"]',
        "# D2_per_MPa is not set: of (J - 1)^4 / D2; default: none [> 0]",
        "#C01_MPa = 0.0                    # of (I2bar - 3)",
        "#     time_s must be given: duration [> 0]",
        "#     output_s is not set: time between two outputs; not set: a tenth of time_s [> 0]",
    ],
)
def test_the_template_states_the_allowed_values(line):
    assert line in commented_template().splitlines()


@pytest.mark.parametrize("kind", [kind for kind in Stimulus.kinds if kind != "text"])
def test_a_kind_of_the_template_with_every_line_in_force_is_its_default(kind):
    blocks = commented_template().split("\n\n")
    (block,) = (b for b in blocks if b.startswith(f'# or kind = "{kind}"'))
    lines = re.findall(r"^#     (\w+ = .*)$", block, re.MULTILINE)
    given = {
        "kind": kind,
        **({"file": "a.stl"} if "file" in Stimulus.kinds[kind].model_fields else {}),
        **({"z": "a:b"} if "z" in Stimulus.kinds[kind].model_fields else {}),
    }
    values = tomllib.loads("\n".join(lines))
    defaults = Study.model_validate({"stimulus": given}).stimulus
    assert Study.model_validate({"stimulus": {**given, **values}}).stimulus == defaults
    kept = defaults.model_dump(
        exclude={"kind", "friction", "shift_mm", "file", "z"}, exclude_none=True
    )
    assert values.keys() == kept.keys()


def test_what_is_dumped_loads_to_the_same_study(tmp_path):
    overrides = [
        "tissue.set=maeno1998",
        "tissue.dermis.C10_MPa=0.0123456789",
        "stimulus.kind=grating",
        "receptors.extra_mm=[[0.5, 1.0], [1, 2]]",
        "solver.petsc.snes_rtol=1e-8",
        'solver.petsc.ksp_type="preonly"',
    ]
    study = load_study(None, overrides)
    (tmp_path / "study.toml").write_text(dump_study(study))
    assert load_study(tmp_path / "study.toml") == study
    assert study.solver.petsc == {"snes_rtol": 1e-8, "ksp_type": "preonly"}


def test_overrides_win_over_the_file_and_leave_the_rest(tmp_path):
    (tmp_path / "s.toml").write_text('[stimulus]\ntext = "EG"\nfriction = 0.5\n')
    study = load_study(tmp_path / "s.toml", ["stimulus.friction=0.1", "protocol.depth_mm = 1"])
    assert study.stimulus == Text(text="EG", friction=0.1)
    assert study.protocol.depth_mm == 1.0


@pytest.mark.parametrize(
    "text, expected",
    [("FG", "FG"), ('"F G"', "F G"), ("123", "123"), ("nan", "nan"), ("true", "true")],
)
def test_bare_words_and_anything_else_can_be_text(text, expected):
    assert load_study(None, [f"stimulus.text={text}"]).stimulus.text == expected


def test_paths_in_a_file_start_from_its_folder_and_paths_of_overrides_from_here(
    tmp_path, monkeypatch
):
    folder = tmp_path / "studies"
    folder.mkdir()
    study = '[finger]\nmesh_file = "mine.msh"\n[stimulus]\nfont = "../f.ttf"\n'
    (folder / "s.toml").write_text(study)
    monkeypatch.chdir(tmp_path)
    study = load_study(folder / "s.toml")
    assert study.finger.mesh_file == folder / "mine.msh"
    assert study.stimulus.font == str(tmp_path / "f.ttf")
    study = load_study(folder / "s.toml", ["finger.mesh_file=other.msh"])
    assert study.finger.mesh_file == tmp_path / "other.msh"
    assert load_study().stimulus.font == "DejaVu Sans"


def test_paths_of_a_study_made_in_python_start_from_here(tmp_path, monkeypatch):
    (tmp_path / "results").mkdir()
    monkeypatch.chdir(tmp_path)
    study = Study(finger=Finger(mesh_file="mine.msh"), stimulus=Text(font="f.ttf"))
    assert study.finger.mesh_file == tmp_path / "mine.msh"
    assert study.stimulus.font == str(tmp_path / "f.ttf")
    saved = tmp_path / "results" / "study.toml"
    saved.write_text(dump_study(study))
    assert load_study(saved) == study


def test_one_key_instead_of_others_is_kept_without_them(tmp_path):
    study = load_study(None, ["finger.mesh_file=mine.msh", "protocol.force_N=0.6"])
    (tmp_path / "study.toml").write_text(dump_study(study))
    saved = tomllib.loads((tmp_path / "study.toml").read_text())
    assert saved["finger"] == {"kind": "solid", "mesh_file": str(Path("mine.msh").absolute())}
    assert saved["protocol"]["force_N"] == 0.6 and "depth_mm" not in saved["protocol"]
    assert saved["protocol"]["distance_mm"] == 10.0
    assert load_study(tmp_path / "study.toml") == study == Study.model_validate(study.model_dump())
    fixed = json.loads(study.model_dump_json(exclude={"neuron": True, "finger": {"mesh_file"}}))
    assert fixed["finger"] == {"kind": "solid"} and "depth_mm" not in fixed["protocol"]
    whole = Study().model_dump()
    assert whole["finger"]["dermis_mm"] == 0.8 and whole["protocol"]["depth_mm"] == 1.97


@pytest.mark.parametrize(
    ("model", "values", "says"),
    [
        (Finger, {"mesh_file": "a.msh", "dermis_mm": 1.5}, "dermis_mm = 1.5 .* beside mesh_file"),
        (Finger, {"mesh_file": "a.msh", "dermis_mm": 0.8}, "dermis_mm = 0.8"),
        (Finger, {"mesh_file": "a.msh", "preset": "paper"}, 'preset = "paper"'),
        (Protocol, {"depth_mm": 1.97, "force_N": 0.6}, "depth_mm = 1.97 .* beside force_N"),
    ],
)
def test_a_key_that_another_one_replaces_is_refused(model, values, says):
    with pytest.raises(ValidationError, match=says):
        model(**values)
    for key, value in values.items():
        assert getattr(model(**{key: value}), key)


def test_several_problems_are_a_sentence_each():
    setting = 'protocol.path=[{kind="hold", time_s=1, vibration={frequency_Hz=9, amplitude=1}}]'
    with pytest.raises(StudyError) as caught:
        load_study(None, [setting])
    assert str(caught.value).splitlines() == [
        "protocol.path (entry 1).vibration.amplitude_mm is missing: "
        "protocol.path (entry 1).vibration is a table.",
        "protocol.path (entry 1).vibration.amplitude is not a key of "
        "[protocol.path (entry 1).vibration]; did you mean amplitude_mm?",
    ]


def test_help_says_what_each_key_means():
    told = inspect.getdoc(Protocol)
    assert told.startswith("Press, then slide")
    assert "\nspeed_mm_s : default 20.0\n    paper: speed of the slide\n" in told
    assert "\nprotocol : Protocol\n" in inspect.getdoc(Study)

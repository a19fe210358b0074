"""The version: one place, in every file that lasts; names of the version before."""

import json
import re
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
from synthetic import make_results

import tactile_fem
from tactile_fem import Friction, Piece, Results, Stimulus, Study, StudyError
from tactile_fem.calibration.parameters import Parameter
from tactile_fem.calibration.posterior import Posterior
from tactile_fem.cli.app import main
from tactile_fem.runtime import version
from tactile_fem.surrogate import FastFinger

ROOT = Path(__file__).parents[1]
THIS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
FAST = ROOT / "meshes" / "fast_finger.npz"


def test_the_version_is_that_of_pyproject_everywhere():
    assert tactile_fem.__version__ == THIS
    assert f"\nversion: {THIS}\n" in (ROOT / "CITATION.cff").read_text()
    newest = re.search(r"^## (\d\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest[1] == THIS


def with_about(file, **changes):
    """Write the shipped fast finger with another description."""
    with np.load(FAST) as arrays:
        arrays = dict(arrays)
    about = json.loads(str(arrays["about"])) | changes
    np.savez(file, **{**arrays, "about": np.array(json.dumps(about))})
    return file


def test_a_fast_finger_states_the_version_that_made_it(tmp_path):
    FastFinger.read(FAST).write(tmp_path / "again.npz")
    with np.load(tmp_path / "again.npz") as arrays:
        assert json.loads(str(arrays["about"]))["version"] == THIS
    file = with_about(tmp_path / "newer.npz", version="9.0", grids={})
    ours = re.escape(THIS)
    with pytest.raises(StudyError, match=rf"finger\. It was written by .* 9\.0; this is {ours}\.$"):
        FastFinger.read(file)
    with pytest.raises(StudyError, match=r"holds no reduced finger\.$"):
        FastFinger.read(with_about(tmp_path / "broken.npz", version=THIS, grids={}))
    with pytest.raises(StudyError, match=r"holds no reduced finger\.$"):
        FastFinger.read(ROOT / "README.md")


def test_a_fit_states_it_too(tmp_path):
    file = tmp_path / "posterior.json"
    file.write_text('{"version": "9.0", "parameters": {}}')
    with pytest.raises(StudyError, match=r"It was written by tactile-fem 9\.0"):
        Posterior.load(file, str(file))
    force = Parameter("stiffness", {("tissue", "dermis", "c10_MPa"): 1.0}, 2.0)
    fitted = Posterior((force,), dict.fromkeys(force.powers, 0.1), np.zeros(1), np.eye(1))
    fitted.save(file)
    saved = json.loads(file.read_text())
    assert saved.pop("version") == THIS
    file.write_text(json.dumps(saved))  # as 0.1 wrote it
    assert Posterior.load(file, str(file)).start == fitted.start


def test_results_that_cannot_be_read_state_who_wrote_them(tmp_path):
    results = make_results(tmp_path / "scan", Study())
    results.save_run({"versions": {"tactile_fem": "9.0"}})
    text = (tmp_path / "scan" / "study.toml").read_text()
    (tmp_path / "scan" / "study.toml").write_text(text + "\n[smell]\nof = 1\n")
    with pytest.raises(StudyError, match=r"smell.* It was written by tactile-fem 9\.0"):
        _ = Results.open(tmp_path / "scan").study


def test_former_keys_are_read_with_a_warning():
    with pytest.warns(FutureWarning, match=r"output\.fields_mm .* write output\.states_mm\."):
        assert Study.model_validate({"output": {"fields_mm": 0.7}}).output.states_mm == 0.7
    with pytest.warns(FutureWarning, match=r"output\.states .* write output\.restarts\."):
        assert Study.model_validate({"output": {"states": True}}).output.restarts
    with pytest.raises(ValueError, match="fields_mm is the former name of states_mm: give one"):
        Study.model_validate({"output": {"fields_mm": 0.7, "states_mm": 0.7}})


def test_former_keys_of_results_are_read_without(tmp_path):
    results = make_results(tmp_path / "scan", Study())
    text = (tmp_path / "scan" / "study.toml").read_text()
    assert "states_mm" in text
    (tmp_path / "scan" / "study.toml").write_text(text.replace("states_mm", "fields_mm"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Results.open(tmp_path / "scan").study == results.study


def test_former_names_warn():
    import tactile_fem.surrogate as surrogate

    with pytest.warns(FutureWarning, match=r"surrogate\.Moment .* write BodyState\."):
        assert surrogate.Moment is surrogate.BodyState


@pytest.mark.parametrize(
    ("family", "method", "instead"),
    [(Piece, "first_place", "first_pose"), (Friction, "moved", "placed")]
    + [(Stimulus, name, "leave it out") for name in ("hindrance", "resolution")],
)
def test_a_method_that_nobody_calls_any_more_warns(family, method, instead):
    with pytest.warns(FutureWarning, match=rf"Own\.{method} .*{instead}"):
        type("Own", (family,), {method: lambda self: None, "__module__": __name__})


@pytest.mark.parametrize("words", [["report", "results"], ["sweep", "--task", "1"], ["export"]])
def test_what_was_removed_names_what_to_use(words, capsys):
    assert main(words) == 2
    assert "was removed with version 0.2: " in capsys.readouterr().err


def test_an_option_may_have_the_name_of_a_former_command(tmp_path, capsys):
    assert main(["plot", str(tmp_path / "report")]) == 2
    assert "removed" not in capsys.readouterr().err


def test_an_uninstalled_package_says_so(monkeypatch):
    monkeypatch.setattr("importlib.metadata.version", version_of_nothing)
    version.this_version.cache_clear()
    try:
        assert version.this_version() == "unknown (not installed)"
    finally:
        version.this_version.cache_clear()


def version_of_nothing(name):
    from importlib.metadata import PackageNotFoundError

    raise PackageNotFoundError(name)

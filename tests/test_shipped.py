"""Studies that are shipped with the package."""

import re
import tomllib
from pathlib import Path

import pytest

from tactile_fem import Study, StudyError, load_study
from tactile_fem.cli.app import app, exit_code_of
from tactile_fem.runtime.differences import differences
from tactile_fem.study.file import shipped_studies

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", shipped_studies())
def test_each_value_of_a_shipped_study_states_its_source(name):
    keys = [line for line in shipped_studies()[name].read_text().splitlines() if "=" in line]
    values = [line for line in keys if not line.startswith("#")]
    assert values
    assert not [line for line in values if not re.search(r"  # \w+", line)]


def test_the_papers_study_has_its_values_and_differs_where_it_says():
    study = load_study("hamasaki2020")
    finger, protocol = study.finger, study.protocol
    assert (finger.stratum_corneum_mm, finger.epidermis_mm, finger.dermis_mm) == (0.17, 0.65, 0.8)
    assert (study.stimulus.text, study.stimulus.friction) == ("FGH", 0.3)
    assert (protocol.depth_mm, protocol.distance_mm, protocol.speed_mm_s) == (1.97, 10.0, 20.0)
    assert study.neuron.model == "hamasaki2020"
    changed = {difference.key.split(".")[0] for difference in differences(study, Study())}
    assert changed == {"finger", "tissue", "neuron"}


def test_the_monkeys_finger_is_the_default_one_made_smaller_and_stiffer():
    monkey, human = load_study("macaque"), Study()
    lengths = {key for (key, *_) in human.finger.size_keys()}
    for key in lengths:
        there, here = getattr(human.finger, key), getattr(monkey.finger, key)
        assert here == pytest.approx(9 / 16 * there, rel=0.005), key
    for layer in ("stratum_corneum", "epidermis", "dermis", "subcutaneous"):
        there, here = (getattr(study.tissue, layer) for study in (human, monkey))
        for name in ("C10_MPa", "C20_MPa", "C30_MPa"):
            assert getattr(here, name) == pytest.approx(10 / 3 * getattr(there, name), rel=0.001)
        assert here.D1_per_MPa == pytest.approx(0.3 * there.D1_per_MPa, rel=0.001)
    assert monkey.neuron == human.neuron and monkey.receptors.below_skin_mm is None


def test_a_shipped_study_takes_overrides_and_equals_its_copy():
    assert load_study("hamasaki2020", ["stimulus.text=EFG"]).stimulus.text == "EFG"
    assert exit_code_of(app, ["init", "mine.toml", "--study", "hamasaki2020"]) == 0
    assert load_study("mine.toml") == load_study("hamasaki2020")


def test_a_file_of_that_name_takes_precedence_and_a_folder_does_not():
    Path("hamasaki2020").mkdir()
    assert load_study("hamasaki2020").neuron.model == "hamasaki2020"
    Path("hamasaki2020").rmdir()
    Path("hamasaki2020").write_text("")
    assert load_study("hamasaki2020") == Study()


def test_an_unknown_name_is_answered_by_the_shipped_ones(capsys):
    with pytest.raises(
        StudyError, match=r"^There is no study file hamasaki; .* hamasaki2020, macaque\.$"
    ):
        load_study("hamasaki")
    assert exit_code_of(app, ["mesh", "hamasaki"]) == 2
    assert capsys.readouterr().err.count("hamasaki2020") == 1


def test_the_package_holds_the_shipped_studies():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["tactile_fem"]
    packed = {file for pattern in patterns for file in (ROOT / "tactile_fem").glob(pattern)}
    assert set(shipped_studies().values()) <= packed

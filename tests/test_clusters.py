"""Series that run elsewhere: their list, what is read of them, and Snakemake with the Snakefile."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from synthetic import make_results

from tactile_fem.cli.app import main
from tactile_fem.people import people
from tactile_fem.series import Member, collected, sweep, write_list, write_snakefile
from tactile_fem.study import Study

SNAKEMAKE = Path(sys.executable).with_name("snakemake")
AXIS = "stimulus.friction=0.1,0.2,0.3,0.4"


@pytest.fixture
def listed(tmp_path, monkeypatch, capsys):
    """The list of four scans, made by a command in another folder."""
    monkeypatch.chdir(tmp_path)
    words = ["sweep", "--over", AXIS, "--ranks", "2", "--results", "series"]
    assert main([*words, "--list"]) == 0
    assert "4 scans are listed in series/scans.csv" in capsys.readouterr().out
    return tmp_path / "series", words


def test_a_list_has_what_an_engine_asks_for_and_nothing_runs(listed):
    folder, words = listed
    rows = list(csv.DictReader((folder / "scans.csv").open()))
    names = [member.name for member in sweep([AXIS])]
    assert [row["name"] for row in rows] == names
    for row in rows:
        assert (folder / row["study"]).is_file() and not (folder / row["name"]).exists()
        assert row["ranks"] == "2"
        assert 1 <= int(row["minutes"]) <= 5 and 500 <= int(row["memory_MB"]) <= 2000
    assert json.loads((folder / "series.json").read_text()) == {
        "folder": str(folder.parent),
        "words": words,
    }


@pytest.mark.needs_gmsh
def test_a_larger_finger_is_listed_with_more_of_both(tmp_path):
    members = sweep(["finger.preset=coarse,paper"])
    rows = list(csv.DictReader(write_list(members, tmp_path).open()))
    for column in ("minutes", "memory_MB"):
        assert int(rows[1][column]) > 3 * int(rows[0][column])


def test_what_ran_elsewhere_is_collected(listed, capsys):
    folder, words = listed
    members = sweep([AXIS])
    for member in members[:2]:
        make_results(folder / member.name, member.study)
    (folder / f"{members[2].name}.failed.txt").write_text("it did not converge\n")
    problems = [outcome.problem for outcome in collected(members, folder)]
    assert problems == ["", "", "it did not converge", "it has not run"]
    assert main([*words, "--collect"]) == 1
    assert "2 of 4 scans failed" in capsys.readouterr().err
    rows = list(csv.DictReader((folder / "summary.csv").open()))
    assert [row["status"] for row in rows] == ["complete"] * 2 + ["not complete"] * 2
    assert rows[2]["failed"] == "it did not converge"


@pytest.mark.needs_gmsh
def test_a_list_of_people_leaves_out_who_is_impossible(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scans = people(Study(), 3)
    impossible = "tactile_fem.people.ensemble._problem"
    monkeypatch.setattr(impossible, lambda scan: "no" if scan.name == scans[1].name else "")
    assert main(["people", "--number", "3", "--list"]) == 0
    rows = list(csv.DictReader(Path("results/people/scans.csv").open()))
    assert [row["name"] for row in rows] == [scans[0].name, scans[2].name]
    assert Path(f"results/people/{scans[1].name}.failed.txt").read_text() == "no\n"
    assert Path("results/people/people.csv").is_file()


@pytest.mark.parametrize(
    ("words", "count"),
    [(["fibre", "--spacing-mm", "2.5"], 5), (["reduce", "--scans", "16"], 16)],
)
def test_passes_and_lessons_are_listed_too(words, count, tmp_path, monkeypatch):
    random_body = "tactile_fem.surrogate.reduce.random_scan"  # a second each
    monkeypatch.setattr(random_body, lambda s, k, kind="lesson": Member(f"{kind}-{k}", s, {}))
    assert main([*words, "--results", str(tmp_path / "series"), "--list"]) == 0
    rows = list(csv.DictReader((tmp_path / "series" / "scans.csv").open()))
    assert len({row["name"] for row in rows}) == count
    assert json.loads((tmp_path / "series" / "series.json").read_text())["words"][0] == words[0]


def test_a_snakefile_needs_a_list_and_replaces_none(listed, tmp_path, capsys):
    assert main(["cluster", str(tmp_path)]) == 2
    assert "holds no scans.csv" in capsys.readouterr().err
    file = write_snakefile(listed[0])
    file.write_text("mine")
    assert write_snakefile(listed[0]).read_text() == "mine"


@pytest.mark.skipif(not SNAKEMAKE.exists(), reason="Snakemake is missing: extra cluster")
def test_snakemake_runs_each_scan_once_and_retries_what_was_killed(listed, tmp_path, monkeypatch):
    """A stand-in takes the command's place: one scan diverges, one is killed at its first try."""
    folder, words = listed
    names = [member.name for member in sweep([AXIS])]
    told, command = tmp_path / "told", tmp_path / "bin" / "tactile-fem"
    command.parent.mkdir()
    command.write_text(
        f"""#!/bin/sh
echo "$PWD: $*" >> {told}
case "$*" in
  *--collect) echo scan,status > {folder}/summary.csv; exit 1 ;;
  *{names[1]}.toml*) echo step 3; echo "tactile-fem: it diverged." >&2; exit 3 ;;
  *{names[2]}.toml*) [ -e {tmp_path}/killed ] || {{ touch {tmp_path}/killed; kill -9 $$; }} ;;
  *{names[3]}.toml*) echo too much >&2; kill -9 $$ ;;
esac
"""
    )
    launcher = command.with_name("mpiexec")
    launcher.write_text('#!/bin/sh\nshift 2; exec "$@"\n')
    for file in (command, launcher):
        file.chmod(0o755)
    write_snakefile(folder)
    environment = {**os.environ, "PATH": f"{command.parent}:{os.environ['PATH']}"}
    run = [SNAKEMAKE, "--cores", "4"]
    for _ in range(2):  # the second time nothing is left
        done = subprocess.run(run, cwd=folder, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    scans = [
        line.split("scan ")[1].split(".toml")[0] for line in told.read_text().splitlines()[:-1]
    ]
    assert sorted(scans) == sorted([names[0], names[1], *2 * [names[2]], *3 * [names[3]]])
    assert told.read_text().splitlines()[-1] == f"{tmp_path}: {' '.join(words)} --collect"
    failed = {file.name: file.read_text() for file in folder.glob("*.failed.txt")}
    assert failed == {
        f"{names[1]}.failed.txt": "it diverged.\n",
        f"{names[3]}.failed.txt": "exit code 137; its last words: too much\n",
    }

import re
from pathlib import Path

import pytest

from tactile_fem import cli

README = Path(__file__).parents[1] / "README.md"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(), flags=re.DOTALL)


@pytest.mark.slow
def test_the_ten_lines_run_at_small_size(tmp_path, monkeypatch, capsys):
    pytest.importorskip("tactile_fem.backend")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tactile_fem.figures.draw_pictures", lambda results: [])
    script = blocks("python")[0]
    assert len([line for line in script.splitlines() if line.strip()]) <= 13
    small = script.replace("depth_mm=1.97, distance_mm=10.0", "depth_mm=0.2, distance_mm=0.2")
    assert small != script
    exec(compile(small, "README.md", "exec"), {})
    assert Path("results/letters/figures/raster.png").is_file()
    assert "[" in capsys.readouterr().out
    reading = blocks("python")[2].replace("results/scan", "results/letters")
    exec(compile(reading, "README.md", "exec"), {})


def test_neurons_run_on_their_own(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(blocks("python")[1], "README.md", "exec"), names)
    counts = names["response"].counts()
    assert counts[15] > counts[0] + 20 and counts.sum() == len(names["spike_s"])
    assert Path("spikes.npz").is_file() and Path("spikes.png").is_file()


def test_the_commands_exist(capsys):
    commands = re.findall(r"^tactile-fem (\w+)", "\n".join(blocks("sh")), flags=re.MULTILINE)
    assert set(commands) == {
        *("init", "scan", "resume", "plot", "view", "report"),
        *("sweep", "fibre", "mesh", "export", "doctor"),
    }
    for command in commands:
        assert cli.main([command, "--help"]) == 0


def test_the_files_of_the_results_folder_are_all_named():
    text = README.read_text()
    for name in ("study.toml", "run.json", "trace.npz", "spikes.csv", "checkpoint.npz", "log.txt"):
        assert f"`{name}`" in text

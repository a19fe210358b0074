import os
import re
import signal
import subprocess
import sys
import types
from pathlib import Path

import meshio
import pytest
from needs import needs_gmsh
from synthetic import make_fields, make_results

from tactile_fem.cli import app as cli
from tactile_fem.errors import ConvergenceError
from tactile_fem.finger import write_mesh
from tactile_fem.runtime import doctor, ranks
from tactile_fem.study import Finger, Study
from tactile_fem.study.file import load_study


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli.logs, "set_up", lambda *args, **kwargs: None)
    for name in ranks._RANK_VARIABLES:
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def scans(monkeypatch):
    """Replace the scan by one that keeps what it was asked and leaves made-up results."""
    calls = []

    def scan(study, folder, *, overwrite):
        calls.append((study, Path(folder), overwrite))
        make_results(folder, study)

    module = types.ModuleType("tactile_fem.simulation.run")
    module.scan = scan
    module.resume = lambda folder: calls.append(Path(folder))
    monkeypatch.setitem(sys.modules, "tactile_fem.simulation.run", module)
    return calls


def sentence_of(capsys, arguments, code=2):
    """Run, expect failure, and return the one sentence on stderr."""
    assert cli.main(arguments) == code
    captured = capsys.readouterr()
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    assert "Traceback" not in captured.err
    assert lines[0].startswith("tactile-fem: ")
    return lines[0].removeprefix("tactile-fem: ")


# --- bad input ---------------------------------------------------------------------------------


def test_an_unwritable_results_folder(capsys, scans, monkeypatch):
    monkeypatch.setattr("os.access", lambda *args, **kwargs: False)
    assert "not writable" in sentence_of(capsys, ["scan"])


@needs_gmsh
def test_a_mesh_without_a_tag(capsys, scans):
    write_mesh("finger.msh", Finger().mesh())
    text = Path("finger.msh").read_text()
    Path("finger.msh").write_text(text.replace('"interface"', '"interphase"'))
    sentence = sentence_of(capsys, ["scan", "--set", "finger.mesh_file=finger.msh"])
    assert "interface" in sentence


def test_several_problems_are_told_one_per_line(capsys):
    assert cli.main(["scan", "--set", "finger.dermis_mm=0", "--set", "stimulus.friction=-1"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 2


def test_no_compiler_is_told_before_the_scan(capsys, scans, monkeypatch):
    monkeypatch.setattr(doctor, "compiler", list)
    sentence = sentence_of(capsys, ["scan"], code=1)
    assert "C compiler" in sentence and "apt-get install gcc libc6-dev" in sentence


def test_divergence_has_its_own_code(capsys, scans, monkeypatch):
    def diverge(*args, **kwargs):
        raise ConvergenceError(
            "the slide stopped at 3.1 mm (too many iterations)", (0, 0, 3.1), "reason"
        )

    monkeypatch.setattr(sys.modules["tactile_fem.simulation.run"], "scan", diverge)
    assert "stopped at 3.1 mm" in sentence_of(capsys, ["scan"], code=3)


def test_other_ranks_keep_silent(capsys, monkeypatch):
    monkeypatch.setenv("PMI_RANK", "1")
    assert cli.main(["scan", "--set", "finger.dermis_mm=0"]) == 2
    assert capsys.readouterr().err == ""


# --- commands ----------------------------------------------------------------------------------


def test_scan_without_a_study_is_the_papers(capsys, scans):
    assert cli.main(["scan", "--set", "output.pictures=false"]) == 0
    study, folder, overwrite = scans[0]
    assert study == load_study(None, ["output.pictures=false"])
    assert folder == Path("results/scan") and not overwrite
    assert "results/scan" in capsys.readouterr().out


def test_scan_with_a_study_settings_and_petsc_options(scans):
    Path("s.toml").write_text("[protocol]\ndepth_mm = 1.0\n[output]\npictures = false\n")
    arguments = ["scan", "s.toml", "--set", "stimulus.text=EFG", "--set=stimulus.friction=0.1"]
    arguments += ["--results", "there", "-tactile_snes_rtol", "1e-8", "-tactile_snes_monitor"]
    assert cli.main(arguments) == 0
    study, folder, _ = scans[0]
    assert study.protocol.depth_mm == 1.0
    assert (study.stimulus.text, study.stimulus.friction) == ("EFG", 0.1)
    assert study.solver.petsc == {"snes_rtol": 1e-8, "snes_monitor": ""}
    assert folder == Path("there")


def test_overwrite_is_passed_on(scans):
    Path("there").mkdir()
    Path("there/notes.md").write_text("mine")
    settings = ["--set", "output.pictures=false"]
    with pytest.raises(Exception, match="not empty"):  # the made-up scan does not overwrite
        cli.app(["scan", "--results", "there", "--overwrite", *settings], exit_on_error=False)
    assert scans[0][2] is True


def test_scan_draws_its_figures(capsys, scans, monkeypatch):
    monkeypatch.setattr("tactile_fem.output.figures.draw_pictures", lambda results, **_: [])
    assert cli.main(["scan"]) == 0
    assert Path("results/scan/figures/raster.png").is_file()
    assert "raster.png" in capsys.readouterr().out


def test_petsc_options_become_settings():
    assert cli.petsc_settings(["scan", "-tactile_a", "-1.5", "-tactile_b", "--ranks", "2"]) == [
        "scan",
        "--set",
        "solver.petsc.a=-1.5",
        "--set",
        'solver.petsc.b=""',
        "--ranks",
        "2",
    ]


@pytest.mark.parametrize("count", [["--ranks", "2"], ["--ranks=2"]])
def test_ranks_restart_the_same_command_under_mpiexec(scans, monkeypatch, count):
    started = []

    def execve(path, command, environment):
        started.append((path, command, environment))
        raise SystemExit(0)

    monkeypatch.setattr(os, "execve", execve)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    Path("s.toml").write_text("")
    words = ["scan", "s.toml", "--set", "stimulus.text=E G", "--results", "r", "--overwrite"]
    with pytest.raises(SystemExit):
        cli.main([*words[:4], *count, *words[4:]])
    path, command, environment = started[0]
    assert command[:4] == [path, "-n", "2", sys.executable]
    assert command[4:] == ["-m", "tactile_fem", *words]
    assert environment["OMP_NUM_THREADS"] == "1"
    assert scans == []


def test_ranks_do_not_go_with_mpiexec(capsys, scans, monkeypatch):
    monkeypatch.setenv("PMI_RANK", "0")
    assert "--ranks does not go" in sentence_of(capsys, ["scan", "--ranks", "2"])


def test_a_missing_launcher_is_told(capsys, scans, monkeypatch):
    monkeypatch.setattr(ranks.sys, "executable", "/nowhere/python")
    monkeypatch.setattr(ranks.shutil, "which", lambda name, path=None: None)
    monkeypatch.setattr(doctor, "compiler_finding", lambda: None)
    assert "no mpiexec" in sentence_of(capsys, ["scan", "--ranks", "2"], code=1)


def test_mesh_prints_its_report_and_writes_the_file(capsys):
    assert cli.main(["mesh", "-o", "finger.msh"]) == 0
    out = capsys.readouterr().out
    for word in ("tetrahedra", "stratum_corneum", "gamma", "interface", "finger.msh"):
        assert word in out
    assert len(meshio.read("finger.msh").cells_dict["tetra10"]) > 1000


def test_fields_lists_the_kept_states_and_writes_them(capsys):
    results = make_results("r")
    make_fields(results)
    assert cli.main(["fields", "r"]) == 0
    head, *rows = capsys.readouterr().out.split()
    assert head == "time_s,displacement_mm,depth_mm,normal_N"
    assert [row.split(",")[1] for row in rows] == ["0", "2.4", "5"]  # the nearest rows
    interface = ["fields", "r", "--on", "interface", "--at-mm", "2.2"]
    assert cli.main([*interface, "-o", "fields.csv"]) == 0
    assert "points at 2.4 mm, 0.12 s" in capsys.readouterr().out
    assert Path("fields.csv").read_text().startswith("x_mm,y_mm,z_mm,displacement_x_mm")
    assert cli.main([*interface, "-o", "fields.txt"]) == 2
    assert "must end in .csv, .npz, .vtu, .png" in capsys.readouterr().err
    assert cli.main([*interface, "-o", "sed.png", "--show", "stretches_3"]) == 0
    assert Path("sed.png").stat().st_size > 5000
    assert cli.main([*interface, "-o", "sed.png", "--show", "heat"]) == 2
    assert "heat is no column of the surface: choose x_mm, y_mm" in capsys.readouterr().err
    assert cli.main(["fields", "r", "--at-mm", "9", "-o", "fields.csv"]) == 2
    assert "r has no state near 9 mm" in capsys.readouterr().err


def test_plot_draws_again(capsys, monkeypatch):
    monkeypatch.setattr("tactile_fem.output.figures.draw_pictures", lambda results, **_: [])
    make_results("r")
    assert cli.main(["plot", "r"]) == 0
    assert capsys.readouterr().out.split() == [
        f"r/figures/{name}.png" for name in ("force", "sed", "raster", "firing")
    ]


def test_resume_goes_on(scans, monkeypatch):
    monkeypatch.setattr("tactile_fem.output.figures.draw_pictures", lambda results, **_: [])
    make_results("r")
    assert cli.main(["resume", "r"]) == 0
    assert scans == [Path("r")]


def test_a_scan_started_again_goes_on_but_only_with_the_same_study(capsys, scans, monkeypatch):
    made = []
    monkeypatch.setattr(
        sys.modules["tactile_fem.simulation.run"], "scan", lambda *a, **k: made.append(a)
    )
    monkeypatch.setattr("tactile_fem.output.figures.draw", lambda results, **_: [])
    results = make_results("r")
    changed = ["scan", "--results", "r", "--set", "protocol.depth_mm=1"]
    for status in ("complete", "running"):
        results.save_run({"status": status})
        assert "protocol.depth_mm is 1.97 there and 1 here" in sentence_of(capsys, changed)
    assert made == []
    for status in ("complete", "running"):
        results.save_run({"status": status})
        assert cli.main(["scan", "--results", "r"]) == 0
    assert made == 2 * [(Study(), Path("r"))]


def test_a_file_that_cannot_be_written_is_one_sentence(capsys, scans, monkeypatch):
    def fail(*args, **kwargs):
        raise OSError(28, "No space left on device", "r/trace.npz")

    monkeypatch.setattr(sys.modules["tactile_fem.simulation.run"], "scan", fail)
    sentence = sentence_of(capsys, ["scan"], code=1)
    assert sentence == "r/trace.npz cannot be read or written: No space left on device."


def test_a_signal_has_its_own_code(capsys, scans, monkeypatch):
    @ranks.signal_handler(ranks.raise_stopped)  # as the scan has it
    def stop(*args, **kwargs):
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(sys.modules["tactile_fem.simulation.run"], "scan", stop)
    assert "stopped by SIGTERM" in sentence_of(capsys, ["scan"], code=143)


def test_init_writes_the_papers_study(capsys):
    assert cli.main(["init"]) == 0
    assert load_study("study.toml") == Study()
    assert "exists already" in sentence_of(capsys, ["init"])


def test_doctor_names_packages(capsys, monkeypatch):
    monkeypatch.setattr(doctor, "has_library", lambda name: False)
    assert cli.main(["doctor"]) == 0
    out = capsys.readouterr().out
    assert "apt-get install libglu1-mesa" in out and "libegl1" in out
    assert "DOLFINx" in out


SLOW_TO_IMPORT = {
    *("dolfinx", "gmsh", "igl", "matplotlib", "meshio", "mpi4py", "petsc4py", "pydantic"),
    *("pyvista", "scipy", "shapely", "trimesh", "ufl", "vtkmodules"),
}


@pytest.mark.parametrize("arguments", [["--help"], ["scan", "--help"], ["--version"], []])
def test_help_loads_nothing_that_takes_long(arguments):
    code = (
        f"import sys; from tactile_fem.cli.app import main; main({arguments}); "
        "print(*{name.partition('.')[0] for name in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *shown, modules = done.stdout.splitlines()
    assert shown and not SLOW_TO_IMPORT.intersection(modules.split())


def test_the_module_ends_with_the_code():
    command = [sys.executable, "-m", "tactile_fem", "scan", "none.toml"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "tactile-fem: There is no study file none.toml.\n"


def test_a_name_that_is_not_utf8_is_printed_as_far_as_possible():
    command = [sys.executable, "-m", "tactile_fem", "init", b"f\xfcr.toml"]
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8:strict"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.stdout, done.stderr) == ("Written to f\\udcfcr.toml\n", "")
    assert done.returncode == 0 and Path("f\udcfcr.toml").is_file()


def test_a_file_whose_name_is_not_utf8_is_refused_before_the_scan(capsys):
    said = sentence_of(capsys, ["scan", "--set", "finger.mesh_file=f\udcfcr.msh"])
    assert said.startswith("finger.mesh_file") and r"f\udcfcr.msh' is no path in UTF-8" in said


def test_an_output_that_nobody_reads_is_no_error():
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "tactile_fem", "init"]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, "")


def test_help_and_wrong_input_import_nothing_heavy(tmp_path):
    heavy = "scipy shapely meshio matplotlib ufl dolfinx mpi4py gmsh pyvista trimesh"
    code = (
        "import shlex, sys\n"
        "from tactile_fem.cli.app import main\n"
        "for line in sys.argv[2:]:\n"
        "    try:\n"
        "        code = main(shlex.split(line))\n"
        "    except SystemExit:\n"  # of help
        "        code = 0\n"
        "    print(code, *(set(sys.argv[1].split()) & sys.modules.keys()))"
    )
    Path("bad.toml").write_text("[protocol]\ndepth_mm = 'deep'\n")
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "notes").touch()
    wrong = [
        *("scan --wrong", "scan --set protocol.depth=1", "scan --set finger.dermis_mm=-1"),
        *("scan bad.toml", "scan none.toml", "scan --results used", "resume none"),
        *("sweep --over stimulus.friction=x", "sweep --over stimulus.friction"),
        "fibre --spacing-mm 9",
        *("fit none.csv", "vibrate none", "vibrate none --frequencies 0", "view none"),
        *("plot none", "fields none", "compare none no", "preview -o x.jpg"),
    ]
    expected = {"--help": "0", "scan --help": "0", **dict.fromkeys(wrong, "2")}
    # All else that may be wrong is looked for too: letters need their libraries.
    tried = ["scan --set protocol.depth_mm=9", "scan --set finger.dermis_mm=6"]
    tried += ["scan --set finger.mesh_file=none.msh"]
    done = subprocess.run(
        [sys.executable, "-c", code, heavy, *expected, *tried], capture_output=True, text=True
    )
    answers = [line for line in done.stdout.splitlines() if re.match(r"\d( |$)", line)]
    assert dict(zip(expected, answers, strict=False)) == expected, done.stderr
    for answer in answers[len(expected) :]:
        assert set(answer.split()) <= {"2", "scipy", "shapely", "matplotlib"}
    assert len(answers) == len(expected) + len(tried)


def test_without_dolfinx_a_scan_says_where_to_get_it(tmp_path):
    code = (
        "import sys\n"
        "for name in ('dolfinx', 'dolfinx_solver', 'mpi4py', 'petsc4py'):\n"
        "    sys.modules[name] = None\n"
        "from tactile_fem.cli.app import main\n"
        "sys.exit(main(['scan', '--results', sys.argv[1]]))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "none")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1 and not (tmp_path / "none").exists()
    assert 'pip install "tactile-fem[solver]"' in done.stderr


@pytest.mark.parametrize("backend", ["nonsense", "module://no_such_module.backend"])
def test_the_backend_of_a_notebook_is_not_used(backend):
    code = "from tactile_fem.cli.app import main; main(['--version']); import matplotlib; "
    code += "print(matplotlib.get_backend().lower())"
    environment = {**os.environ, "MPLBACKEND": backend}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "agg"


def test_the_help_ends_in_a_column_or_two(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "1")
    assert cli.main(["view", "--help"]) == 0
    assert "COLUMNS" not in os.environ and "--amplitude-um" in capsys.readouterr().out

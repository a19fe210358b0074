import io
import logging
import sys
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from tactile_fem.runtime import logs
from tactile_fem.simulation import step
from tactile_fem.simulation.progress import progress


@dataclass
class Step:
    index: int
    phase: str
    displacement_mm: float
    depth_mm: float
    fraction: float
    stimulator_rad: np.ndarray = field(default_factory=lambda: np.zeros(3))
    newton_iterations: int = 5
    force_unit: str = "N"
    stimulator_mm: np.ndarray = field(default_factory=lambda: np.array([1.0, 2.0, 0.5]))

    load = SimpleNamespace(
        force_N=np.array([0.03, -0.04, 0.5]), moment_Nmm=np.array([0.0, 0.0, 0.7])
    )
    torque_Nmm = step.Step.torque_Nmm
    __str__ = step.Step.__str__


STEPS = [
    Step(1, "press", 0.0, 0.5, 0.04),
    Step(2, "press", 0.0, 1.97, 0.16),
    Step(3, "slide", 10.0, 1.97, 1.0),
]


def run(console, rank=0, every_s=0.0):
    logs.set_up(console=console)
    with progress(rank, console=console, every_s=every_s) as show:
        for step in STEPS:
            show(SimpleNamespace(step=step))
        logging.getLogger("tactile_fem.simulation").info("something to say")
    return console.file.getvalue()


def test_plain_lines_tell_force_iterations_and_time_left():
    text = run(Console(file=io.StringIO()))
    lines = text.splitlines()
    assert len(lines) == 4
    assert (
        "press  0.000 mm  depth 1.970 mm  normal 0.5000 N  tangential 0.0500 N   5 iterations"
        in lines[1]
    )
    assert "16 %" in lines[1] and "left" in lines[1]
    assert "100 %" in lines[2] and "left" not in lines[2]
    assert "something to say" in lines[3]


def test_a_line_of_a_body_that_turns_tells_the_turn_and_a_twist_its_torque():
    """The moment about the origin, 0.7, less 1 x (-0.04) - 2 x 0.03."""
    twist = replace(STEPS[2], stimulator_rad=np.radians([0.0, 0.0, -30.0]))
    assert str(twist).endswith("0.0500 N  turned 30.0 deg  torque 0.800 Nmm   5 iterations")
    roll = replace(STEPS[2], stimulator_rad=np.radians([20.0, 0.0, 0.0]))
    assert str(roll).endswith("0.0500 N  turned 20.0 deg   5 iterations")


def test_a_resumed_scan_counts_the_time_left_from_where_it_went_on():
    """It begins at 30 % and takes a minute for each percent."""
    now = [0.0]
    console = Console(file=io.StringIO(), get_time=lambda: now[0])
    logs.set_up(console=console)
    with progress(console=console, every_s=0.0) as show:
        for percent in range(30, 51):
            now[0] += 60.0
            show(SimpleNamespace(step=Step(percent, "slide", 1.0, 1.97, percent / 100)))
    assert "50 %  50.0 min left" in console.file.getvalue().splitlines()[-1]


def test_lines_are_rare_between_first_and_last():
    text = run(Console(file=io.StringIO()), every_s=1e9)
    assert "step   1" in text and "step   3" in text and "step   2" not in text


def test_other_ranks_are_silent_but_for_errors(monkeypatch):
    monkeypatch.setenv("PMI_RANK", "1")
    console = Console(file=io.StringIO())
    assert run(console, rank=1) == ""
    logging.getLogger("tactile_fem.simulation").error("broken")
    assert "broken" in console.file.getvalue()


def test_a_terminal_gets_a_bar():
    console = Console(file=io.StringIO(), force_terminal=True, width=140)
    text = run(console)
    assert "100 %" in text and "something to say" in text


def test_a_notebook_gets_one_line_of_its_cell(monkeypatch):
    lines = []

    def display(line, *, display_id):
        assert display_id
        lines.append(line)
        return SimpleNamespace(update=lines.append)

    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=display))
    text = run(Console(file=io.StringIO(), force_jupyter=True))
    assert len(text.splitlines()) == 1 and "something to say" in text
    assert len(lines) == 1 + len(STEPS) and "press" in str(lines[1])
    assert str(lines[-1]).endswith("100 %")
    assert '<progress max="1" value="0.1600">' in lines[2]._repr_html_()


def configure_nothing(monkeypatch):
    """Take away the handlers with which pytest captures the log of the test that calls."""
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    monkeypatch.setattr(logging.getLogger(logs.PACKAGE), "handlers", [])
    monkeypatch.setattr(logging.getLogger(logs.PACKAGE), "propagate", True)


@logs.shown()
def long_work():
    package = logging.getLogger(logs.PACKAGE)
    with progress(every_s=0.0) as show:
        for step in STEPS:
            show(SimpleNamespace(step=step))
        with progress() as inner:  # a script's own: the steps are told once
            inner(SimpleNamespace(step=STEPS[0]))
    logging.getLogger("tactile_fem.simulation").info("something to say")
    return len(package.handlers)


def test_without_configured_logging_long_work_is_shown(monkeypatch, capsys):
    configure_nothing(monkeypatch)
    package = logging.getLogger(logs.PACKAGE)
    before = package.level
    for _ in range(2):  # it leaves nothing behind
        assert long_work() == 1
        captured = capsys.readouterr()
        assert captured.err.count("step ") == 3 and "something to say" in captured.err
        assert captured.out == ""
        assert (package.handlers, package.level, package.propagate) == ([], before, True)


@pytest.mark.parametrize("name", ["", logs.PACKAGE])
def test_where_logging_is_configured_it_alone_decides(monkeypatch, capsys, name):
    configure_nothing(monkeypatch)
    text = io.StringIO()
    configured = logging.getLogger(name)
    configured.addHandler(logging.StreamHandler(text))
    logging.getLogger(logs.PACKAGE).setLevel(logging.INFO)
    assert long_work() == len(logging.getLogger(logs.PACKAGE).handlers)
    assert text.getvalue().count("step ") == 3 and "something to say" in text.getvalue()
    configured.handlers[:] = [logging.NullHandler()]
    long_work()
    assert capsys.readouterr() == ("", "")


def test_counting_tells_how_far_it_is():
    plain, terminal = (
        Console(file=io.StringIO(), force_terminal=is_terminal, width=100)
        for is_terminal in (False, True)
    )
    for console in (plain, terminal):
        logs.set_up(console=console)
        assert list(logs.counted("abc", "letters to draw", every_s=0.0)) == ["a", "b", "c"]
    assert "3 letters to draw" in plain.file.getvalue()
    assert "2 of 3 letters to draw, 0 s left" in plain.file.getvalue()
    assert "100%" in terminal.file.getvalue()


def test_the_log_file_has_every_step(tmp_path):
    console = Console(file=io.StringIO())
    logs.set_up(console=console)
    with logs.log_to(tmp_path / "log.txt"), progress(console=console) as show:
        for step in STEPS:
            show(SimpleNamespace(step=step))
        logging.getLogger("tactile_fem.simulation").info("something to say")
    text = (tmp_path / "log.txt").read_text()
    assert text.count("step ") == 3 and "something to say" in text
    logging.getLogger("tactile_fem.simulation").info("afterwards")
    assert "afterwards" not in (tmp_path / "log.txt").read_text()


def test_a_log_file_shows_others_no_more_than_before(tmp_path, monkeypatch):
    """As `logging.basicConfig` configures it: the level is the root logger's, not a handler's."""
    configure_nothing(monkeypatch)
    text, root = io.StringIO(), logging.getLogger()
    monkeypatch.setattr(root, "handlers", [logging.StreamHandler(text)])
    monkeypatch.setattr(root, "level", logging.INFO)
    with logs.log_to(tmp_path / "log.txt"):
        for package in (logs.PACKAGE, "other"):
            logging.getLogger(package).debug("a detail of %s", package)
            logging.getLogger(package).info("news of %s", package)
    assert text.getvalue().split("\n") == ["news of tactile_fem", "news of other", ""]
    assert (tmp_path / "log.txt").read_text().count("of tactile_fem") == 2


def test_the_log_file_is_the_first_ranks(tmp_path):
    with logs.log_to(tmp_path / "log.txt", rank=1):
        pass
    assert not (tmp_path / "log.txt").exists()

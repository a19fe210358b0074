import io
import logging
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
from rich.console import Console

from tactile_fem.runtime import logs
from tactile_fem.scan.progress import progress


@dataclass
class Step:
    index: int
    phase: str
    displacement_mm: float
    depth_mm: float
    fraction: float
    force_N: np.ndarray = field(default_factory=lambda: np.array([0.03, -0.04, 0.5]))
    newton_iterations: int = 5
    force_unit: str = "N"


STEPS = [
    Step(1, "press", 0.0, 0.5, 0.04),
    Step(2, "press", 0.0, 1.97, 0.16),
    Step(3, "slide", 10.0, 1.97, 1.0),
]


def run(console, rank=0, every_s=0.0):
    logs.set_up(rank, console=console)
    with progress(rank, console=console, every_s=every_s) as show:
        for step in STEPS:
            show(SimpleNamespace(step=step))
        logging.getLogger("tactile_fem.scan").info("something to say")
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


def test_other_ranks_are_silent_but_for_errors():
    console = Console(file=io.StringIO())
    assert run(console, rank=1) == ""
    logging.getLogger("tactile_fem.scan").error("broken")
    assert "broken" in console.file.getvalue()


def test_a_terminal_gets_a_bar():
    console = Console(file=io.StringIO(), force_terminal=True, width=140)
    text = run(console)
    assert "100 %" in text and "something to say" in text


def test_the_log_file_has_every_step(tmp_path):
    console = Console(file=io.StringIO())
    logs.set_up(console=console)
    with logs.log_to(tmp_path / "log.txt"), progress(console=console) as show:
        for step in STEPS:
            show(SimpleNamespace(step=step))
        logging.getLogger("tactile_fem.scan").info("something to say")
    text = (tmp_path / "log.txt").read_text()
    assert text.count("step ") == 3 and "something to say" in text
    logging.getLogger("tactile_fem.scan").info("afterwards")
    assert "afterwards" not in (tmp_path / "log.txt").read_text()


def test_the_log_file_is_the_first_ranks(tmp_path):
    with logs.log_to(tmp_path / "log.txt", rank=1):
        pass
    assert not (tmp_path / "log.txt").exists()

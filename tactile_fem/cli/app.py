"""The command line, and how a program starts and ends.

The commands' modules import what is needed to compute or draw only when a command runs.
"""

from __future__ import annotations

import io
import os
import re
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy: ranks share the cores

from cyclopts import App, CycloptsError, Parameter

import tactile_fem
from tactile_fem import companions
from tactile_fem.cli import compute, outputs, view
from tactile_fem.cli.options import command_line
from tactile_fem.errors import TactileError
from tactile_fem.runtime import logs, ranks
from tactile_fem.runtime.jobs import ERROR

HELP = """Press a surface against a layered fingertip, slide it across the skin,
and predict the spikes of the afferents.

Without a study file, the letters F G H of the paper are pressed 1.97 mm deep and slid 10 mm.

    tactile-fem scan
    tactile-fem scan study.toml --set stimulus.text=EFG --ranks 2
"""

# What an earlier version had, and what to use instead.
_REMOVED = {
    "report": "compare prints the numbers of scans, plot draws them",
    "export": "demos/verification/deck.py writes input decks",
    "--task": "run the command with --list, then: tactile-fem cluster",
}
_LEAST_COLUMNS = 20  # the help is laid out for ever if there are only a few

app = App(
    name="tactile-fem",
    help=HELP,
    version=lambda: tactile_fem.__version__,
    help_format="plaintext",
    default_parameter=Parameter(negative="", consume_multiple=False),
)
_commands: list[Callable[..., Any]] = [
    *compute.COMMANDS,
    *outputs.COMMANDS,
    *view.COMMANDS,
    *companions.commands(),
]
for _command in _commands:
    app.command(_command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code, see `exit_code_of`."""
    # Only files are drawn; a notebook's backend, inherited, may be missing here.
    os.environ["MPLBACKEND"] = "agg"
    if os.environ.get("COLUMNS", "").isdigit() and int(os.environ["COLUMNS"]) < _LEAST_COLUMNS:
        del os.environ["COLUMNS"]
    words = petsc_settings(sys.argv[1:] if arguments is None else arguments)
    for word in words[:1] + words[1:].count("--task") * ["--task"]:
        if word in _REMOVED:
            return _report(f"{word} was removed with version 0.2: {_REMOVED[word]}", 2)
    return exit_code_of(app, words)


def run_script(main: Callable[..., object]) -> NoReturn:
    """Call a script's `main` with the arguments of the command line, and exit.

    Its parameters become arguments and options, its docstring the help text. The log is shown on
    stderr; an error of the package ends the script with one sentence and an exit code.

    Parameters
    ----------
    main
        The function; what it returns is the exit code if it is an integer.
    """
    script = App()
    script.default(main)
    sys.exit(exit_code_of(script, sys.argv[1:]))


def petsc_settings(arguments: Sequence[str]) -> list[str]:
    """Turn ``-tactile_snes_rtol 1e-8`` into ``--set solver.petsc.snes_rtol=1e-8``."""
    tokens = list(arguments)
    turned: list[str] = []
    while tokens:
        token = tokens.pop(0)
        if not token.startswith("-tactile_"):
            turned.append(token)
            continue
        has_value = tokens and not re.match(r"-[-A-Za-z]", tokens[0])
        value = tokens.pop(0) if has_value else '""'
        turned += ["--set", f"solver.petsc.{token.removeprefix('-tactile_')}={value}"]
    return turned


def exit_code_of(program: App, words: Sequence[str]) -> int:
    """Run a program and return its exit code; rank 0 prints errors.

    The code is 0 on success, 2 for bad input, 3 for divergence, 130 and 143 after SIGINT and
    SIGTERM, 141 if nobody reads the output, 1 otherwise.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):  # names that the terminal cannot show
        sys.stdout.reconfigure(errors="backslashreplace")
    command_line.set(words)
    try:
        command, bound, _ = program.parse_args(words, exit_on_error=False, print_error=False)
        logs.set_up()
        code = command(*bound.args, **bound.kwargs)
        print(end="", flush=True)  # what is printed may fail only now
    except CycloptsError as error:
        return _report(str(error), 2)
    except TactileError as error:
        return _report(str(error), error.exit_code)
    except BrokenPipeError:  # nobody reads on, as behind `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # or Python would complain at its end
        return 128 + signal.SIGPIPE
    except OSError as error:
        what = error.filename or "A file"
        return _report(f"{what} cannot be read or written: {error.strerror or error}.", 1)
    except KeyboardInterrupt:
        return _report("interrupted", 130)
    except Exception as error:
        return _report_other(error)
    return code if isinstance(code, int) else 0


def _report_other(error: Exception) -> int:
    """Report a part of a study that a script makes and that is not valid, or a bug."""
    from pydantic import ValidationError

    from tactile_fem.study.explain import in_words

    if isinstance(error, ValidationError):
        return _report(in_words(error), 2)
    if ranks.is_first():
        traceback.print_exception(error)
    return 1


def _report(message: str, code: int) -> int:
    if ranks.is_first():
        for line in message.strip().splitlines():
            stop = "" if line.endswith((".", "?", "!")) else "."
            print(f"{ERROR}{line}{stop}", file=sys.stderr)
    return code

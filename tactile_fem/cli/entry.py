"""Runs a program and turns its errors into one sentence and an exit code."""

from __future__ import annotations

import io
import os
import signal
import sys
import traceback
from collections.abc import Callable
from typing import NoReturn

from cyclopts import App, CycloptsError
from pydantic import ValidationError

from tactile_fem.errors import TactileError
from tactile_fem.runtime import ranks
from tactile_fem.study.explain import explain


def run(main: Callable[..., object]) -> NoReturn:
    """Call a demo's `main` with the arguments of the command line, and exit.

    Its parameters become arguments and options, its docstring the help text.
    """
    app = App()
    app.default(main)
    sys.exit(exit_code_of(app, None))


def exit_code_of(app: App, tokens: list[str] | None) -> int:
    """Run a program and return its exit code; rank 0 prints errors.

    The code is 0 on success, 2 for bad input, 3 for divergence, 130 and 143 after SIGINT and
    SIGTERM, 141 if nobody reads the output, 1 otherwise.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):  # names that the terminal cannot show
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        print(end="", flush=True)  # what is printed may fail only now
    except CycloptsError as error:
        return _report(str(error), 2)
    except ValidationError as error:  # a part of a study that a demo makes
        return _report(explain(error), 2)
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
    except Exception:  # a bug
        if ranks.launched_rank() in (None, 0):
            traceback.print_exc()
        return 1
    return code if isinstance(code, int) else 0


def _report(message: str, code: int) -> int:
    if ranks.launched_rank() in (None, 0):
        for line in message.strip().splitlines():
            stop = "" if line.endswith((".", "?", "!")) else "."
            print(f"tactile-fem: {line}{stop}", file=sys.stderr)
    return code

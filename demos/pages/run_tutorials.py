"""Runs the tutorials from scratch and keeps their outputs: `make tutorials`.

With names of tutorials as arguments only these are run.
"""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent / "tutorials"
_TIMEOUT_S = 900
_TIME = re.compile(r"^\d\d:\d\d:\d\d ")


def run(path: Path) -> None:
    """Run a notebook in an empty folder and write its outputs into it; no times, no machine."""
    notebook = nbformat.read(path, as_version=4)
    with TemporaryDirectory() as folder:
        NotebookClient(
            notebook,
            timeout=_TIMEOUT_S,
            record_timing=False,
            resources={"metadata": {"path": folder}},
        ).execute()
    for cell in notebook.cells:
        cell.get("outputs", [])[:] = filter(_tidied, cell.get("outputs", []))
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    nbformat.validate(notebook)
    nbformat.write(notebook, path)


def _tidied(output: nbformat.NotebookNode) -> bool:
    """Keep only warnings of a log, without times, and HTML; return whether anything is left."""
    if output.output_type == "stream" and output.name == "stderr":
        lines = [line for line in output.text.splitlines() if " INFO " not in line]
        output.text = "".join(f"{_TIME.sub('', line)}\n" for line in lines)
        return bool(lines)
    if "text/html" in output.get("data", {}):
        output.data["text/plain"] = ""  # the same without a layout
    return True


def main(names: list[str]) -> None:
    """Run the tutorials that are named, or all."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        if names and path.stem not in names:
            continue
        begun = time.perf_counter()
        run(path)
        print(f"{path.name}: {time.perf_counter() - begun:.0f} s, {path.stat().st_size} bytes")


if __name__ == "__main__":
    main(sys.argv[1:])

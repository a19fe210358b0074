"""The reference's own prose: the messages that it explains are in the code."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "demos" / "pages" / "reference"
MESSAGES = [
    message
    for row in re.findall(r"^(`.*?) \|", (REFERENCE / "messages.md").read_text(), re.MULTILINE)
    for message in re.findall(r"`([^`]+)`", row)
]


@pytest.fixture(scope="module")
def constants() -> str:
    """All texts of the package, pieces of formatted ones apart."""
    trees = [ast.parse(path.read_text()) for path in (ROOT / "tactile_fem").rglob("*.py")]
    return "\n".join(
        node.value
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


@pytest.mark.parametrize("message", MESSAGES)
def test_explained_messages_are_in_the_code(message, constants):
    pieces = [piece.strip(" .,;:()=") for piece in message.split("...")]
    longest = max(pieces, key=len)
    assert len(longest) >= 8 and longest in constants


def test_the_files_of_the_results_folder_are_all_named():
    text = (REFERENCE / "results.md").read_text()
    for name in ("study.toml", "run.json", "trace.npz", "spikes.csv", "checkpoint.npz", "log.txt"):
        assert f"`{name}`" in text


def test_the_code_of_the_results_page_runs(finished, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = "".join(re.findall(r"```python\n(.*?)```", (REFERENCE / "results.md").read_text(), re.S))
    for usual, here in {'"results/scan"': repr(str(finished.folder)), "=5.0": "=0.4"}.items():
        assert usual in code
        code = code.replace(usual, here)
    names = {}
    exec(code, names)
    assert names["force_N"] > 0 and Path("interface.csv").is_file()

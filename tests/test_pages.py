"""README and pages: their code runs, their commands exist, their links lead somewhere."""

from __future__ import annotations

import ast
import inspect
import json
import re
import shlex
import subprocess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tactile_fem
import tactile_fem.series
import tactile_fem.shapes
import tactile_fem.study
from tactile_fem import Piece, Stimulus, Study
from tactile_fem.cli import app as cli
from tactile_fem.series import sweep
from tactile_fem.simulation.checks import check
from tactile_fem.study import Protocol
from tactile_fem.study.explain import model_in
from tactile_fem.study.file import load_study

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = ROOT / "demos" / "pages"
MARKDOWN = [
    *ROOT.glob("*.md"),
    *(p for f in ("docker", "meshes", "demos") for p in (ROOT / f).rglob("*.md")),
]
NOTEBOOKS = sorted((PAGES / "tutorials").glob("*.ipynb"))
SCRIPTS = sorted((ROOT / "demos" / "gallery").glob("*.py"))
ARTICLE = ROOT / "demos" / "paper" / "paper.md"  # for reviewers
WORDS, CONTRIBUTORS_WORDS, ARTICLE_WORDS = 17_700, 800, 1_750


def prose(file: Path) -> str:
    """Return what a reader reads in a page, a notebook or a script of the gallery."""
    text = file.read_text()
    if file.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        return "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    if file.suffix == ".py":
        comments = re.findall(r"^# ?(.*)$", text, re.MULTILINE)
        return "\n".join([ast.get_docstring(ast.parse(text)) or "", *comments])
    return text


def blocks(file: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", prose(file), flags=re.DOTALL)


def commands() -> list[str]:
    """Return each call of the command line in a page, continued lines joined."""
    found = []
    for file in [*MARKDOWN, *NOTEBOOKS, *SCRIPTS]:
        text = "\n".join(blocks(file, "sh") + blocks(file, "bash")).replace("\\\n", " ")
        text += "\n" + "\n".join(re.findall(r"`(tactile-fem [^`\n]+)`", prose(file)))
        found += re.findall(r"^(?:exec )?(tactile-fem [a-z].*?)(?: &)?$", text, re.MULTILINE)
    return sorted(set(found))


def test_all_pages_together_are_short():
    words = {file: len(prose(file).split()) for file in [*MARKDOWN, *NOTEBOOKS, *SCRIPTS]}
    del words[ROOT / "CHANGELOG.md"]  # which grows
    assert words.pop(ROOT / "CONTRIBUTING.md") <= CONTRIBUTORS_WORDS
    assert 750 <= words.pop(ARTICLE) <= ARTICLE_WORDS
    assert sum(words.values()) <= WORDS, "who adds some words, cuts some"


def test_the_article_shows_nothing_that_the_pages_do_not():
    text = ARTICLE.read_text().split("---", 2)[2]
    pages = "\n".join(page.read_text() for page in [ROOT / "README.md", *PAGES.rglob("*.md")])
    numbers = {n.rstrip(".,") for n in re.findall(r"(?<![\w.,])\d[\d.,\u2013]*", text)}
    shown = set(re.findall(r"(?<![\w.])\d(?:[\d.,\u2013]*\d)?", pages))
    assert {number for number in numbers if len(number) > 1} <= shown
    keys = set(re.findall(r"@(\w+)", text))
    assert keys == set(re.findall(r"^@\w+\{(\w+),", ARTICLE.with_suffix(".bib").read_text(), re.M))
    for picture in re.findall(r"\]\((\S+\.png)\)", text):
        assert (ARTICLE.parent / picture).is_file()


@pytest.mark.parametrize("command", commands())
def test_a_command_of_the_pages_exists(command):
    _, name, *arguments = shlex.split(re.sub(r"\$[A-Z_]+", "2", command), comments=True)
    assert name in cli.app
    if not arguments or "..." in arguments:
        return
    function, bound, _ = cli.app.parse_args([name, *arguments], exit_on_error=False)
    changes = bound.arguments.get("changes")
    if changes and function.__name__ == "scan":
        check(load_study(None, changes))
    if over := bound.arguments.get("over"):
        for member in sweep(over, overrides=changes or []):
            check(member.study)


def test_shell_scripts_are_well_formed():
    scripts = blocks(PAGES / "reference" / "parallel.md", "bash")
    assert len(scripts) == 2
    for script in scripts:
        subprocess.run(["bash", "-n"], input=script, text=True, check=True)


def test_the_ten_lines_run_at_small_size(tmp_path, monkeypatch, capsys):
    pytest.importorskip("tactile_fem.runtime.backend")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tactile_fem.output.figures.draw_pictures", lambda results, **_: [])
    (script,) = blocks(README, "python")
    assert len([line for line in script.splitlines() if line.strip()]) <= 13
    usual = "depth_mm=1.97, distance_mm=10.0"
    assert usual in script
    exec(compile(script.replace(usual, "depth_mm=0.2, distance_mm=0.2"), "README", "exec"), {})
    assert Path("results/letters/figures/raster.png").is_file()
    assert "[" in capsys.readouterr().out


def test_the_code_of_the_fast_finger_runs():
    first, second = blocks(PAGES / "how" / "fast.md", "python")
    file = "meshes/fast_finger.npz"
    assert file in first
    names: dict = {}
    exec(first.replace(file, str(ROOT / file)), names)
    assert names["trace"].force_N[-1, 2] > 0

    taken = []
    simulator = SimpleNamespace(
        runs=lambda: len(taken) < 5,
        place_mm=lambda: (0.0, 0.0, 0.1 * len(taken)),
        dt_s=0.01,
        take=lambda force_N, sed_kPa: taken.append((force_N[0, 2], sed_kPa.max())),
    )
    exec(second, {**names, "simulator": simulator, "heights_mm": np.zeros((200, 200))})
    force_N, sed_kPa = np.transpose(taken)
    assert all(np.diff(force_N) > 0) and all(np.diff(sed_kPa) > 0)


@pytest.mark.parametrize("number", range(2))
def test_the_studies_of_the_reference_are_studies(number, tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(blocks(PAGES / "reference" / "study.md", "toml")[number])
    check(load_study(file))


def in_sentences(pattern: str) -> list[str]:
    """Return what is written as code in the sentences of the pages."""
    files = [*MARKDOWN, *NOTEBOOKS, *SCRIPTS]
    texts = "\n".join(prose(file) for file in files if file.name != "CHANGELOG.md")
    return sorted(set(re.findall(f"`({pattern})`", texts)))


PUBLIC = {
    name: getattr(module, name)
    for module in (tactile_fem, tactile_fem.study, tactile_fem.series, tactile_fem.shapes)
    for name in module.__all__
} | {"study": Study()}


CALLS = in_sentences(r"\w[\w.]*\([^`\n]*\)")


@pytest.mark.parametrize("text", [text for text in CALLS if re.split(r"\W", text)[0] in PUBLIC])
def test_a_call_in_a_sentence_can_be_made(text):
    """What it calls exists and takes its keywords; a value that is complete is made."""
    call = ast.parse(text, mode="eval").body
    while isinstance(called := getattr(call.func, "value", None), ast.Call):
        call = called  # of its result something is called
    function = eval(ast.unparse(call.func), dict(PUBLIC))
    assert {keyword.arg for keyword in call.keywords} <= set(inspect.signature(function).parameters)
    if function in vars(tactile_fem.study).values() and "..." not in text:
        eval(text, dict(PUBLIC))


@pytest.mark.parametrize("key", in_sentences(rf"(?:{'|'.join(Study.model_fields)})\.\w+[^`\n]*"))
def test_a_key_in_a_sentence_exists(key):
    section, name = re.match(r"(\w+)\.(\w+)", key).groups()
    if name in ("csv", "py"):
        return
    own = {"stimulus": Stimulus.kinds, "protocol": {"": Protocol, **Piece.kinds}}.get(section)
    models = own.values() if own else [model_in(Study.model_fields[section].annotation)]
    assert any(name in model.model_fields for model in models)


@pytest.mark.parametrize("file", MARKDOWN, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(file):
    """Those of the site are followed once more, with their anchors, where it is built."""
    for target in re.findall(r"\]\(([^)\s]+)\)", file.read_text()):
        path = target.partition("#")[0]
        if path and not re.match(r"https?:|mailto:", path) and path != "gallery/index":
            assert (file.parent / path).exists(), target


def test_citation_and_package_have_the_same_version():
    cited, packaged = (
        re.findall(pattern, (ROOT / name).read_text(), flags=re.MULTILINE)
        for name, pattern in (
            ("CITATION.cff", r"^version: (\S+)$"),
            ("pyproject.toml", r'^version = "(\S+)"$'),
        )
    )
    assert cited == packaged and len(cited) == 1


def test_pictures_are_small():
    for picture in (PAGES / "pictures").glob("*.png"):
        assert picture.stat().st_size < 150_000, picture.name

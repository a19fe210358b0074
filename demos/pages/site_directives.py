"""What the site takes from the code: keys of a study, columns of results, pages of the source."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective, SphinxRole

import tactile_fem
from tactile_fem.path import Piece
from tactile_fem.results.columns import table
from tactile_fem.runtime.settings import Kind
from tactile_fem.stimulus import Friction, Stimulus
from tactile_fem.study import Study
from tactile_fem.study.afferents import Afferents
from tactile_fem.study.explain import model_in, toml_value
from tactile_fem.study.template import notes

ROOT = Path(tactile_fem.__file__).parents[1]


# --- the study ---------------------------------------------------------------------------------


class StudyKeys(SphinxDirective):
    """Every table of a study with its keys, their defaults and what is allowed."""

    def run(self) -> list[nodes.Node]:
        """Return one section for each table."""
        return [
            part
            for heading, model, values in _tables()
            for part in self._table(heading, model, values)
        ]

    def _table(
        self, heading: str, model: type[BaseModel], values: BaseModel | None
    ) -> list[nodes.Node]:
        section = nodes.section(
            ids=[nodes.make_id(heading)], names=[nodes.fully_normalize_name(heading)]
        )
        section += nodes.title(text=heading)
        section += _markdown(self, [_first_line(model), "", *_rows(model, values)])
        return [section]


def _tables() -> Iterator[tuple[str, type[BaseModel], BaseModel | None]]:
    """Yield heading, model and default of each table, in the order of a study file."""
    default = Study()
    for name in Study.model_fields:
        if name == "afferents":
            yield "[[afferents]]", Afferents, None
        elif name == "stimulus":
            for kind, model in Stimulus.kinds.items():
                yield f'[stimulus] kind = "{kind}"', model, None
            for law, friction in Friction.kinds.items():
                yield f'[stimulus.friction] law = "{law}"', friction, None
        elif name == "protocol":
            yield "[protocol]", type(default.protocol), default.protocol
            for kind, piece in Piece.kinds.items():
                yield f'[[protocol.path]] kind = "{kind}"', piece, None
        elif (values := getattr(default, name)) is not None:
            yield from _nested(name, values)
        elif model := model_in(Study.model_fields[name].annotation):
            yield f"[{name}]", model, None


def _nested(
    name: str, values: BaseModel
) -> Iterator[tuple[str, type[BaseModel], BaseModel | None]]:
    yield f"[{name}]", type(values), values
    for key, value in values:
        if isinstance(value, BaseModel):
            yield from _nested(f"{name}.{key}", value)


def _rows(model: type[BaseModel], values: BaseModel | None) -> Iterator[str]:
    """Yield the keys of a table as rows of Markdown."""
    yield from ("| key | default | meaning |", "| --- | --- | --- |")
    for key, field, note in notes(model):
        value = getattr(values, key, None) if values is not None else field.get_default()
        if (issubclass(model, Kind) and key == model.tag) or isinstance(value, BaseModel):
            continue
        if not note and (nested := model_in(field.annotation)):
            note = f"keys as in `[{key}]`" if model is Afferents else _first_line(nested)
        shown = (
            "required" if field.is_required() else "" if value is None else f"`{toml_value(value)}`"
        )
        yield f"| `{key}` | {shown} | {_cell(note)} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;")


def _first_line(model: type[BaseModel]) -> str:
    return (model.__doc__ or "").strip().splitlines()[0]


# --- the results -------------------------------------------------------------------------------


class ResultsColumns(SphinxDirective):
    """The columns of a table in the results folder: trace, spikes or summary."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        rows = [
            f"| `{name}` | {shape} | {unit} | {_cell(meaning)} |"
            for name, shape, unit, meaning in table(self.arguments[0])
        ]
        return _markdown(
            self, ["| column | shape | unit | meaning |", "| --- | --- | --- | --- |", *rows]
        )


# --- Python ------------------------------------------------------------------------------------


class ApiCheck(SphinxDirective):
    """Fail where the page lists other names than the package exports."""

    def run(self) -> list[nodes.Node]:
        """Return nothing, or the error."""
        page = self.env.doc2path(self.env.docname).read_text()
        modules = {"study", "neuron", "series", "people", "surrogate"}
        named = set(re.findall(r"^   (\w+)$", page, re.MULTILINE)) - modules
        if missing := set(tactile_fem.__all__) ^ named:
            raise self.error(f"exported or listed, not both: {', '.join(sorted(missing))}")
        return []


def _signature(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str | None, returned: Any
) -> tuple[str, Any] | None:
    """Shorten the signature of a table of a study: its keys are listed below it."""
    is_table = what == "class" and issubclass(obj, BaseModel)
    return ("(**keys)", returned) if is_table else None


def _skipped(app: Sphinx, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what only pydantic reads."""
    return True if name == "model_config" else None


# --- the source --------------------------------------------------------------------------------


class Source(SphinxRole):
    """A link to a page with a file of the package (or of the demos)."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Return the link; the file must exist."""
        file = next(
            (
                path
                for path in (ROOT / "tactile_fem" / self.text, ROOT / self.text)
                if path.is_file()
            ),
            None,
        )
        if file is None:
            return [], [
                self.inliner.reporter.error(f"There is no file {self.text}.", line=self.lineno)
            ]
        page = "source/" + file.relative_to(ROOT).as_posix()
        _sources(self.env.app)[page] = file
        up = "../" * self.env.docname.count("/")
        link = nodes.reference(
            "", "", nodes.literal(text=self.text), refuri=f"{up}{page}.html", internal=True
        )
        return [link], []


def _sources(app: Sphinx) -> dict[str, Path]:
    if not hasattr(app.env, "source_pages"):
        app.env.source_pages = {}
    return app.env.source_pages


def _source_pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    for page, file in _sources(app).items():
        language = {".py": "python", ".toml": "toml", ".c": "c"}.get(file.suffix, "text")
        code = app.builder.highlighter.highlight_block(file.read_text(), language)
        title = file.relative_to(ROOT).as_posix()
        yield page, {"title": title, "body": f"<h1>{title}</h1>{code}", "parents": []}, "page.html"


# --- Markdown ----------------------------------------------------------------------------------


def _markdown(directive: SphinxDirective, lines: list[str]) -> list[nodes.Node]:
    """Parse lines with the page's own parser."""
    holder = nodes.container()
    directive.state.nested_parse(StringList(lines, "generated"), 0, holder)
    return holder.children


def setup(app: Sphinx) -> dict[str, bool]:
    """Register what this module offers."""
    app.add_directive("study-keys", StudyKeys)
    app.add_directive("results-columns", ResultsColumns)
    app.add_directive("api-check", ApiCheck)
    app.add_role("source", Source())
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-skip-member", _skipped)
    app.connect("html-collect-pages", _source_pages)
    return {"parallel_read_safe": False}  # pages of the source are collected in one process

"""Pieces of HTML for notebooks."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A notebook's own rules align numbers right and let images be as large as they are.
_STYLE = (
    ".tactile-fem td, .tactile-fem th { text-align: left; padding-right: 1em; } "
    ".tactile-fem img { width: 34em; max-width: 100%; } .tactile-fem figure { margin: 0; }"
)

# Shows results in a notebook. The package sets it, since figures, which it draws, import results.
shown_results: Callable[[Any], str]


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return a table with a heading, or without one if that is empty."""
    lines = [_row("th", head)] if head else []
    lines += [_row("td", row) for row in rows]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _row(tag: str, cells: Iterable[Any]) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"


def figure(drawn: Figure, caption: str) -> str:
    """Return a figure of matplotlib as an image in the page itself, with its caption."""
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="png")
    data, text = base64.b64encode(buffer.getvalue()).decode("ascii"), escape(caption)
    source = f'<img alt="{text}" src="data:image/png;base64,{data}">'
    return f"<figure>{source}<figcaption>{text}</figcaption></figure>"


def section(title: str, parts: Iterable[str], note: str = "") -> str:
    """Return parts of HTML under a title, as a notebook shows them, and a sentence below them."""
    below = [f"<p>{escape(note)}</p>"] if note else []
    head = f"<style scoped>{_STYLE}</style><strong>{escape(title)}</strong>"
    return "\n".join([f'<div class="tactile-fem">{head}', *parts, *below, "</div>"])

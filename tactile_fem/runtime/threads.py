"""Threads of BLAS: small products wait for them where other work has the cores."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@contextmanager
def on_one_core() -> Iterator[None]:
    """Keep products within on one core; entering takes some 10 us. Decorates functions too."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@cache
def _controller() -> ThreadpoolController:
    """Return what knows the BLAS that is loaded at first; to look for it takes milliseconds."""
    return ThreadpoolController()

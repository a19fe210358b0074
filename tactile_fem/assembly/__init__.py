"""Assembly of virtual works in several cells at once: `VirtualWork(form, u, v)`."""

from typing import TYPE_CHECKING

from tactile_fem.runtime import backend
from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.assembly.compile import Constant

__all__ = [
    "Constant",
    "backend",
]

__getattr__ = lazily(
    __name__,
    {
        "compile": ["Constant"],
    },
)

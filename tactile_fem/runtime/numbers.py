"""Numbers that follow each other in a file, as text or in binary form."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray


class Numbers:
    """Reads a sequence of numbers whose types the file's format states.

    Parameters
    ----------
    data
        The bytes; of text, numbers apart by white space.
    text
        Whether they are text.
    order
        "<" or ">": the order of bytes.

    Raises
    ------
    ValueError
        The text holds something else than numbers; or, in its methods, there are too few numbers.
    """

    def __init__(self, data: bytes, text: bool, order: str = "<") -> None:
        if text:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # NumPy warns of the first word that is no number
                try:
                    data = np.fromstring(data.decode("latin-1"), dtype="<f8", sep=" ").tobytes()
                except DeprecationWarning:
                    raise ValueError("a word in place of a number") from None
        self._data, self._text, self._order, self._at = data, text, order, 0

    def type_of(self, kind: str) -> str:
        """Return NumPy's name of the type in which numbers of a kind, such as "i4", are kept."""
        return "<f8" if self._text else self._order + kind

    def take(self, kind: str | np.dtype, count: int = 1) -> NDArray:
        """Return the next numbers (count,) of a kind, or the next records of a structured type."""
        dtype = np.dtype(self.type_of(kind) if isinstance(kind, str) else kind)
        if count == 0:
            return np.empty(0, dtype)
        found = np.frombuffer(self._data, dtype, count, self._at)
        self._at += found.nbytes
        return found

    def peek(self, kind: str | np.dtype, most: int) -> NDArray:
        """Return the next numbers or records without taking them: `most`, or what is left."""
        dtype = np.dtype(self.type_of(kind) if isinstance(kind, str) else kind)
        at, left = self._at, (len(self._data) - self._at) // dtype.itemsize
        found = self.take(dtype, min(left, most))
        self._at = at
        return found

    def alike(self, dtype: np.dtype, most: int, values: Mapping[str, int]) -> NDArray:
        """Return the next records that share the first one's `values`, at most so many."""
        ahead = 1
        while True:
            rows = self.peek(dtype, min(ahead, most))
            same = np.all([rows[name] == value for name, value in values.items()], axis=0)
            if not np.all(same) or len(rows) < ahead:
                run = len(rows) if np.all(same) else int(np.argmin(same))
                return self.take(dtype, max(run, 1))
            ahead *= 8

    def integers(self, kind: str, count: int = 1) -> NDArray[np.int64]:
        """Return the next integers (count,)."""
        return self.take(kind, count).astype(np.int64)

    def rows(self, kind: str, count: int, width: int) -> NDArray[np.int64]:
        """Return the next rows (count, width) of integers."""
        return self.integers(kind, count * width).reshape(count, width)

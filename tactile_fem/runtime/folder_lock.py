"""A lock, so that only one run at a time writes into a results folder."""

from __future__ import annotations

import fcntl
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tactile_fem.errors import StudyError

logger = logging.getLogger(__name__)

LOCK_FILE = ".lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a folder against other runs, and create it if needed.

    The operating system releases the lock when the process ends, however it ends; the file that
    remains has no meaning.

    Raises
    ------
    StudyError
        Another process holds the lock, or the folder is not writable.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stream = (folder / LOCK_FILE).open("a")
    except OSError as error:
        raise StudyError(
            f"The results folder {folder} is not writable: {error.strerror}."
        ) from None
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(
                f"Another run is writing into {folder}: wait for its end or choose another folder."
            ) from None
        except OSError as error:  # some network file systems
            logger.warning("%s: no guard against a second run (%s)", folder, error.strerror)
        yield

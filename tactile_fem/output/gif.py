"""Animations as GIF files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from tactile_fem.runtime.files import atomic_write

PER_SECOND = 20


def write_gif(images: Sequence[Image.Image], path: Path) -> None:
    """Write images of few colours as an endless animation, 20 frames a second."""
    with atomic_write(path) as part:
        images[0].save(
            part,
            format="GIF",
            save_all=True,
            append_images=images[1:],
            duration=1000 // PER_SECOND,
            loop=0,
        )

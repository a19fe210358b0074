"""What this companion adds to a study: files of a finger, kinds of stimulus, formats of heights."""

from tactile_fem.shapes import finger, height_formats, mesh  # noqa: F401

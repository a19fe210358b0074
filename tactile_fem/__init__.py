"""Finger mechanics and SA1 afferents: the response of a finger that strokes a surface.

What scripts use is here; names are imported when they are first used, DOLFINx only by those that
compute mechanics:

- ``Study``, ``load_study``: the input. Its tables (``Finger``, ``Text``, ``Protocol``, …) are in
  `tactile_fem.study`.
- ``scan``, ``resume``, ``completed``: computations; ``Simulation``: one, step by step.
- ``ScanResult``, ``Trace``: what they return; ``Observation``: what an observer of a scan is given.
- ``preview``: finger and stimulator before a scan; ``Results``, ``draw``: the results folder and
  its figures; ``draw_raster``, ``draw_psth``, ``draw_rates``: spikes by class; ``SurfaceFields``:
  fields on the skin.
- ``Parts``, your own parts of a scan: a ``FingerMesh`` (``Finger.mesh`` makes one), a ``Law`` of a
  tissue, a ``RigidBody`` (``Distance``, ``Embossed``), its ``Path`` (``Motion``), and a
  ``Population`` of afferents.
- ``Stimulus``, ``Friction`` and ``Piece``, base classes of your own kinds in a study; ``Term``, a
  term of the virtual work; ``FastSolver`` and ``PlainSolver``.
- ``StudyError``, ``MeshError``, ``ConvergenceError``, ``StoppedError``, and their base
  ``TactileError``.
- ``run_script``: the program around a script's ``main``; ``write_table``: a CSV file.

The lists of `tactile_fem.study`, `tactile_fem.neuron` and `tactile_fem.series` are public too, and
those of the companions, which add:

"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tactile_fem import companions
from tactile_fem.errors import (
    ConvergenceError,
    MeshError,
    StoppedError,
    StudyError,
    TactileError,
)
from tactile_fem.runtime import html
from tactile_fem.runtime.lazy import lazily
from tactile_fem.runtime.version import this_version

if TYPE_CHECKING:
    from tactile_fem.cli.app import run_script
    from tactile_fem.finger import FingerMesh
    from tactile_fem.mechanics.terms.term import Term
    from tactile_fem.neuron import Population
    from tactile_fem.output.figures import draw
    from tactile_fem.output.preview import preview
    from tactile_fem.output.rasters import draw_psth, draw_raster, draw_rates
    from tactile_fem.path import Motion, Path, Piece
    from tactile_fem.results.results import Results
    from tactile_fem.results.surfaces import SurfaceFields
    from tactile_fem.results.trace import Trace
    from tactile_fem.runtime.files import write_table
    from tactile_fem.simulation.parts import Parts
    from tactile_fem.simulation.run import completed, resume, scan
    from tactile_fem.simulation.scan_result import ScanResult
    from tactile_fem.simulation.simulation import Observation, Simulation
    from tactile_fem.solvers.fast import FastSolver
    from tactile_fem.solvers.plain import PlainSolver
    from tactile_fem.stimulus import Distance, Embossed, Friction, RigidBody, Stimulus
    from tactile_fem.study import Study
    from tactile_fem.study.file import load_study
    from tactile_fem.tissue.energies import Law

    __version__: str

__all__ = [
    "ConvergenceError",
    "Distance",
    "Embossed",
    "FastSolver",
    "FingerMesh",
    "Friction",
    "Law",
    "MeshError",
    "Motion",
    "Observation",
    "Parts",
    "Path",
    "Piece",
    "PlainSolver",
    "Population",
    "Results",
    "RigidBody",
    "ScanResult",
    "Simulation",
    "Stimulus",
    "StoppedError",
    "Study",
    "StudyError",
    "SurfaceFields",
    "TactileError",
    "Term",
    "Trace",
    "completed",
    "draw",
    "draw_psth",
    "draw_raster",
    "draw_rates",
    "load_study",
    "preview",
    "resume",
    "run_script",
    "scan",
    "write_table",
]

# Where the names are that are imported on demand.
_MODULES = {
    "cli.app": ("run_script",),
    "finger": ("FingerMesh",),
    "mechanics.terms.term": ("Term",),
    "neuron": ("Population",),
    "output.figures": ("draw",),
    "output.preview": ("preview",),
    "output.rasters": ("draw_psth", "draw_raster", "draw_rates"),
    "path": ("Motion", "Path", "Piece"),
    "runtime.files": ("write_table",),
    "simulation.parts": ("Parts",),
    "results.results": ("Results",),
    "simulation.run": ("completed", "resume", "scan"),
    "simulation.scan_result": ("ScanResult",),
    "simulation.simulation": ("Observation", "Simulation"),
    "results.surfaces": ("SurfaceFields",),
    "results.trace": ("Trace",),
    "solvers.fast": ("FastSolver",),
    "solvers.plain": ("PlainSolver",),
    "stimulus": ("Distance", "Embossed", "Friction", "RigidBody", "Stimulus"),
    "study": ("Study",),
    "study.file": ("load_study",),
    "tissue.energies": ("Law",),
}
_find = lazily(__name__, {**_MODULES, **companions.names()})
__all__ += [name for names in companions.names().values() for name in names]
__doc__ += "\n".join(f"- {summary}" for summary in companions.summaries())


def __getattr__(name: str) -> Any:
    """Import a public name, or read the version."""
    return this_version() if name == "__version__" else _find(name)


def _shown_results(results: Results) -> str:
    from tactile_fem.series.notebook import html_of

    return html_of(results)


html.shown_results = _shown_results


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

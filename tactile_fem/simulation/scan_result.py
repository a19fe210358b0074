"""What a scan returns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tactile_fem.neuron import Response
from tactile_fem.results.results import Results
from tactile_fem.results.trace import Trace
from tactile_fem.simulation.parts import NO_PARTS, Parts
from tactile_fem.stimulus.sampled import DistanceGrid
from tactile_fem.study import Study


@dataclass(frozen=True)
class ScanResult:
    """Result of a scan: histories, spikes of the receptors' afferents, and its folder, if any.

    Attributes
    ----------
    trace
        Histories, a row for each accepted step.
    response
        Spikes, an array per receptor; read from a folder, their times have seven digits.
    folder
        The results folder; None if the results are in memory only.
    study, parts
        What was scanned.
    """

    trace: Trace
    response: Response
    folder: Path | None
    study: Study
    parts: Parts = NO_PARTS

    def __repr__(self) -> str:
        """Return the main numbers, one a line."""
        trace, spikes = self.trace, sum(map(len, self.response.spikes))
        unit = self.study.finger.force_unit
        lines = {
            "folder": self.folder or "none, in memory",
            "path": f"{np.ptp(trace.time_s):.3g} s, {len(trace) - 1} steps",
            "largest normal force": f"{trace.force_N[:, 2].max():.3g} {unit}",
            "largest SED": f"{trace.sed_kPa.max():.3g} kPa",
            "spikes": f"{spikes} from {len(trace.receptors_mm)} receptors",
        }
        return "\n".join(["ScanResult", *(f"  {name}: {line}" for name, line in lines.items())])

    def _repr_html_(self) -> str:
        """Show numbers and rasters in a notebook, as `Results` do."""
        with TemporaryDirectory() as beside:
            return (Results(self.folder) if self.folder else self._saved(beside))._repr_html_()

    def _saved(self, folder: str) -> Results:
        """Save what is in memory."""
        results = Results.create(Path(folder) / "In memory")
        results.save_study(self.study)
        results.save_run({"status": "complete"})
        results.save_trace(**self.trace.arrays())
        results.save_spikes(self.response.spikes, self.trace)
        if self.parts.body is not None:
            poses = self.trace.stimulator_mm, self.trace.stimulator_rad
            results.save_stimulator(DistanceGrid.of(self.parts.body, *poses))
        return results

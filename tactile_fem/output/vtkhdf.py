"""All kept states of a scan in one file, which ParaView and PyVista read as a film."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyvista as pv
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkInformation, vtkInformationVector
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline
from vtkmodules.vtkIOHDF import vtkHDFWriter

from tactile_fem.errors import StudyError
from tactile_fem.results.fields import read_series
from tactile_fem.results.results import Results
from tactile_fem.runtime.files import atomic_write

logger = logging.getLogger(__name__)

_COMPRESSION = 4  # of 9: with the next ones it takes longer and hardly saves any


def write_states(results: Results, path: Path) -> int:
    """Write the fields of the whole finger in each kept state, and return their number.

    The undeformed mesh is written once. StudyError if the scan has kept no state.
    """
    times_s, files = read_series(results.fields)
    if not files:
        raise StudyError(f"{results.folder} has no fields: the scan has kept no state.")
    states = _States(times_s.tolist(), files)
    with atomic_write(path) as part:
        writer = vtkHDFWriter()
        writer.SetInputConnection(states.GetOutputPort())
        writer.SetFileName(str(part))
        writer.SetWriteAllTimeSteps(True)
        writer.SetCompressionLevel(_COMPRESSION)
        writer.Write()
    return len(files)


class _States(VTKPythonAlgorithmBase):
    """Source of the states for VTK; all share the first one's points and cells."""

    def __init__(self, times_s: Sequence[float], files: Sequence[Path]) -> None:
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkUnstructuredGrid")
        self._times_s, self._files = list(times_s), list(files)
        self._mesh = pv.read(files[0])

    def RequestInformation(
        self, request: vtkInformation, inputs: Any, outputs: vtkInformationVector
    ) -> int:
        """State the times."""
        info = outputs.GetInformationObject(0)
        info.Set(Pipeline.TIME_STEPS(), self._times_s, len(self._times_s))
        info.Set(Pipeline.TIME_RANGE(), [self._times_s[0], self._times_s[-1]], 2)
        return 1

    def RequestData(
        self, request: vtkInformation, inputs: Any, outputs: vtkInformationVector
    ) -> int:
        """Hand out the state of the requested time."""
        info = outputs.GetInformationObject(0)
        wanted = info.Get(Pipeline.UPDATE_TIME_STEP())
        k = min(range(len(self._times_s)), key=lambda k: abs(self._times_s[k] - wanted))
        state, shown = pv.read(self._files[k]), self.GetOutputData(outputs, 0)
        shown.ShallowCopy(self._mesh)
        shown.GetPointData().ShallowCopy(state.GetPointData())
        shown.GetCellData().ShallowCopy(state.GetCellData())
        return 1

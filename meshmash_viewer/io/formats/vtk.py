"""VTP and legacy VTK files, by VTK's own readers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.polygons import RawMesh, fan_triangles, strip_triangles
from meshmash_viewer.mesh import IntArray

__all__ = ["read_legacy_vtk", "read_vtp"]


def read_vtp(path: Path) -> RawMesh:
    """Read the polygons and triangle strips of a VTK XML PolyData file.

    Raises
    ------
    InputError
        If VTK cannot read the file.
    """
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    reader = vtkXMLPolyDataReader()
    if not reader.CanReadFile(str(path)):
        raise InputError("is not a VTK XML PolyData file")
    return _from_polydata(_output(reader, path))


def read_legacy_vtk(path: Path) -> RawMesh:
    """Read a legacy VTK file: PolyData, or the surface of an unstructured grid.

    Raises
    ------
    InputError
        If VTK cannot read the file, or it holds another kind of data.
    """
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader

    with path.open("rb") as file:
        if not file.read(30).startswith(b"# vtk DataFile"):
            raise InputError('does not begin with "# vtk DataFile"')
    output = _output(vtkGenericDataObjectReader(), path)
    if output is None:
        raise InputError("holds no data set that VTK can read")
    if output.IsA("vtkUnstructuredGrid"):
        from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

        surface = vtkGeometryFilter()
        surface.SetInputData(output)
        surface.Update()
        output = surface.GetOutput()
    if not output.IsA("vtkPolyData"):
        raise InputError(f"holds a {output.GetClassName()} where a surface should be")
    return _from_polydata(output)


def _output(reader: Any, path: Path) -> Any:
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    # VTK writes its errors to a log and a window of its own and goes on; they are collected.
    previous, collector = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(collector)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        reader.SetFileName(str(path))
        reader.Update()
        complaints = collector.GetOutput()
    finally:
        vtkOutputWindow.SetInstance(previous)
        vtkLogger.SetStderrVerbosity(verbosity)
    # The end of a file cut short is but a warning to VTK: "Error reading binary data!"
    if reader.GetErrorCode() or "error" in complaints.lower():
        clauses = [
            re.sub(r"^\w+ \(0x[0-9a-f]+\): ", "", line.strip()).rstrip(".!")
            for line in complaints.splitlines()
            if line.strip() and not re.match(r"(ERROR|Warning|Generic Warning): In ", line)
        ]
        detail = clauses[0][:120] if clauses else f"error {reader.GetErrorCode()}"
        raise InputError(f"is not readable by VTK ({detail})")
    return reader.GetOutput()


def _from_polydata(output: Any) -> RawMesh:
    if output is None or output.GetPoints() is None:
        raise InputError("holds no vertices")
    vertices = _array(output.GetPoints().GetData()).astype(np.float64)
    faces: list[IntArray] = []
    polygons, strips = output.GetPolys(), output.GetStrips()
    if polygons.GetNumberOfCells():
        offsets = _array(polygons.GetOffsetsArray()).astype(np.int64)
        corners = _array(polygons.GetConnectivityArray()).astype(np.int64)
        faces.append(fan_triangles(corners[offsets[0] : offsets[-1]], np.diff(offsets)))
    if strips.GetNumberOfCells():
        offsets = _array(strips.GetOffsetsArray()).astype(np.int64)
        corners = _array(strips.GetConnectivityArray()).astype(np.int64)
        faces.extend(strip_triangles(strip) for strip in np.split(corners, offsets[1:-1]))
    return RawMesh(vertices, np.concatenate(faces) if faces else np.empty((0, 3), dtype=np.int64))


def _array(values: Any) -> npt.NDArray[Any]:
    from vtkmodules.util import numpy_support

    convert: Any = numpy_support.vtk_to_numpy
    array: npt.NDArray[Any] = convert(values)
    return array

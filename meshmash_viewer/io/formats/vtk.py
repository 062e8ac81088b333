"""VTP and legacy VTK files, by VTK's own readers in a process of their own.

On some broken files VTK does not fail but ends its process, so that must not be ours.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.polygons import RawMesh, fan_triangles, strip_triangles
from meshmash_viewer.io.provenance import stated_unit
from meshmash_viewer.mesh import IntArray

__all__ = ["convert", "read_legacy_vtk", "read_vtp"]

# The child finds this package wherever the parent found it.
_CHILD = """
import json, sys
sys.path[:] = json.loads(sys.argv[1])
from meshmash_viewer.io.formats.vtk import convert
convert(*sys.argv[2:])
"""


def read_vtp(path: Path) -> RawMesh:
    """Read the polygons and triangle strips of a VTK XML PolyData file.

    Raises
    ------
    InputError
        If VTK cannot read the file.
    """
    with path.open("rb") as file:
        if b"<VTKFile" not in file.read(10_000):
            raise InputError("is not a VTK XML PolyData file")
    return _in_child(path)


def read_legacy_vtk(path: Path) -> RawMesh:
    """Read a legacy VTK file: PolyData, or the surface of an unstructured grid.

    Raises
    ------
    InputError
        If VTK cannot read the file, or it holds another kind of data.
    """
    with path.open("rb") as file:
        if not file.read(30).startswith(b"# vtk DataFile"):
            raise InputError('does not begin with "# vtk DataFile"')
    return _in_child(path)


def _in_child(path: Path) -> RawMesh:
    with tempfile.TemporaryDirectory(prefix="meshmash-") as folder:
        result = Path(folder) / "mesh.npz"
        command = [sys.executable, "-c", _CHILD, json.dumps(sys.path), str(path), str(result)]
        child = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # where VTK complains once more before it ends
            check=False,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        if child.returncode != 0:
            raise InputError("is so broken that VTK's reader ends on it")
        if not result.exists():
            raise InputError(child.stdout.decode("utf-8").strip())
        with np.load(result) as arrays:
            return RawMesh(arrays["vertices"], arrays["faces"], stated_unit(str(arrays["meta"])))


def convert(source: str, result: str) -> None:
    """Read a file with VTK and write its vertices and faces as NPZ, in the child process.

    A fault in the file is printed, as the clause after the file's name.
    """
    try:
        path = Path(source)
        output = _read_xml(path) if path.suffix.lower() == ".vtp" else _read_legacy(path)
        raw = _from_polydata(output)
        np.savez(result, vertices=raw.vertices, faces=raw.faces, meta=np.array(_said(output)))
    except InputError as fault:
        sys.stdout.buffer.write(str(fault).encode("utf-8"))


def _read_xml(path: Path) -> Any:
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    reader = vtkXMLPolyDataReader()
    if not reader.CanReadFile(str(path)):
        raise InputError("is not a VTK XML PolyData file")
    return _output(reader, path)


def _read_legacy(path: Path) -> Any:
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader

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
    return output


def _said(output: Any) -> str:
    """What our own exports say of themselves, where the unit is; empty in other files."""
    told = output.GetFieldData().GetAbstractArray("meshmash-viewer")
    return str(told.GetValue(0)) if told is not None and told.GetNumberOfValues() else ""


def _output(reader: Any, path: Path) -> Any:
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

    # VTK writes its errors to a window of its own and goes on; they are collected instead.
    collector = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(collector)
    reader.SetFileName(str(path))
    reader.Update()
    complaints = collector.GetOutput()
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

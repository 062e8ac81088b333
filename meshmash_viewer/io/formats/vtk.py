"""VTP and legacy VTK files, by VTK's own readers.

On some broken files VTK does not fail but ends its process, loops forever or exhausts the memory:
`meshmash_viewer.io.read` calls these functions in a child process.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.formats.vtk_maps import (
    colors_of_labels,
    vtk_maps,
    with_names_apart,
)
from meshmash_viewer.io.provenance import stated_structure, stated_unit
from meshmash_viewer.io.raw import RawMesh
from meshmash_viewer.io.text import unmarked
from meshmash_viewer.triangulation import polydata_triangles

#: Values that a byte of a compressed file can stand for at most; deflate shrinks 1032-fold.
_VALUES_PER_BYTE = 260
#: Of which VTK takes only the first each, if not asked for all.
_ATTRIBUTES = ("Scalars", "Vectors", "Normals", "ColorScalars", "TCoords", "Tensors", "Fields")
#: What a legacy file counts, in front of the values themselves.
_LEGACY_COUNTS = (b"POINTS", b"POLYGONS", b"TRIANGLE_STRIPS", b"CELLS", b"CELL_TYPES", b"LINES")


def read_vtp(path: Path) -> RawMesh:
    """Read the polygons and triangle strips of a VTK XML PolyData file.

    Raises
    ------
    InputError
        If VTK cannot read the file.
    """
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    content = path.read_bytes()
    reader = vtkXMLPolyDataReader()
    if b"<VTKFile" not in content[:10_000] or not reader.CanReadFile(str(path)):
        raise InputError("is not a VTK XML PolyData file")
    most = _VALUES_PER_BYTE * len(content)
    _check_counts(content, b"NumberOf", rb'NumberOf(\w+)\s*=\s*"\s*(\d+)', most)
    return _from_polydata(_output(reader, path))


def read_legacy_vtk(path: Path) -> RawMesh:
    """Read a legacy VTK file: PolyData, or the surface of an unstructured grid.

    Raises
    ------
    InputError
        If VTK cannot read the file, or it holds another kind of data.
    """
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader

    content = unmarked(path.read_bytes())
    if not content.startswith(b"# vtk DataFile"):
        raise InputError('does not begin with "# vtk DataFile"')
    for name in _LEGACY_COUNTS:
        _check_counts(content, b"\n" + name, rb"\n(\w+)[ \t]+(\d+)", len(content))
    content = with_names_apart(content)
    reader: Any = vtkGenericDataObjectReader()
    for kind in _ATTRIBUTES:
        getattr(reader, f"ReadAll{kind}On")()
    reader.ReadFromInputStringOn()
    reader.SetBinaryInputString(content, len(content))
    output = _output(reader, path)
    if output is None:
        raise InputError("holds no data set that VTK can read")
    if output.IsA("vtkUnstructuredGrid"):
        surface = vtkGeometryFilter()
        surface.SetInputData(output)
        surface.Update()
        output = surface.GetOutput()
    if not output.IsA("vtkPolyData"):
        raise InputError(f"holds a {output.GetClassName()} where a surface should be")
    return _from_polydata(output, colors_of_labels(content))


def _check_counts(content: bytes, begin: bytes, pattern: bytes, most: int) -> None:
    """Refuse a number of things that would not fit in the file, before VTK makes room for it."""
    count = re.compile(pattern)
    place = content.find(begin)
    while place >= 0:
        found = count.match(content, place)
        if found is not None and (len(found[2]) > 18 or int(found[2]) > most):
            raise InputError(
                f"promises {printable(found[2].decode(), 24)}"
                f" {printable(found[1].decode('latin-1').lower(), 40)},"
                " which a file of its size cannot hold"
            )
        place = content.find(begin, place + len(begin))


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
        detail = clauses[0] if clauses else f"error {reader.GetErrorCode()}"
        raise InputError(f"is not readable by VTK ({printable(detail)})")
    return reader.GetOutput()


def _from_polydata(output: Any, colors: dict[str, tuple[str, ...]] | None = None) -> RawMesh:
    if output is None or output.GetPoints() is None:
        raise InputError("holds no vertices")
    vertices, triangles = polydata_triangles(output)
    field = output.GetFieldData().GetAbstractArray("meshmash-viewer")
    said = str(field.GetValue(0)) if field is not None and field.GetNumberOfValues() else ""
    maps, remarks = vtk_maps(output, colors)
    unit, structure = stated_unit(said), stated_structure(said)
    return RawMesh(vertices, triangles, unit, maps, remarks, structure)

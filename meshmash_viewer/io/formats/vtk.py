"""Readers of VTP, VTU and legacy VTK files, by VTK.

On some broken files VTK crashes, loops forever or exhausts the memory. `meshmash_viewer.io.read`
therefore calls these functions in a child process.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable, wrong_format
from meshmash_viewer.io.provenance import stated_mesh
from meshmash_viewer.io.raw import MOST_MAPS, RawMap, RawMesh, maps_of_columns
from meshmash_viewer.io.text import unmarked
from meshmash_viewer.triangulation import polydata_triangles
from meshmash_viewer.vertex_map import MOST_LABELS, Label

#: Largest number of values per byte of a compressed file; deflate compresses 1032-fold at most.
_VALUES_PER_BYTE = 260
#: Kinds of arrays of which VTK reads only the first by default.
_ATTRIBUTES = ("Scalars", "Vectors", "Normals", "ColorScalars", "TCoords", "Tensors", "Fields")
#: Keywords in legacy files with the count after them.
_LEGACY_COUNTS = rb"\n(POINTS|POLYGONS|TRIANGLE_STRIPS|CELLS|CELL_TYPES|LINES)[ \t]+(\d+)"
#: Number of entries of VTK's default colour table, whose colours are not of labels.
_RAMP = 256
#: Names of arrays in a legacy file, of attributes and within a FIELD.
_ATTRIBUTE = re.compile(
    rb"(\n(?:SCALARS|VECTORS|NORMALS|TENSORS|COLOR_SCALARS|TEXTURE_COORDINATES)[ \t]+)(\S+)"
)
_FIELD_ARRAY = re.compile(
    rb"(\n)(\S+)(?=[ \t]+\d+[ \t]+\d+[ \t]+(?:bit|float|double"
    rb"|(?:unsigned_)?(?:char|short|int|long)|vtkIdType|vtktypeu?int64)[ \t]*\r?\n)"
)
_TEXT_KIND = re.compile(rb"[^\n]*\n[^\n]*\n\s*ASCII", re.IGNORECASE)
_TABLE_OF_SCALARS = re.compile(rb"\nSCALARS[ \t]+(\S+)[^\n]*\n\s*LOOKUP_TABLE[ \t]+(\S+)")
_TABLE = re.compile(rb"\nLOOKUP_TABLE[ \t]+(\S+)[ \t]+(\d+)[ \t]*\r?\n")


def read_vtk_xml(path: Path) -> RawMesh:
    """Read a VTK XML file: PolyData, or the surface of an unstructured grid.

    `InputError` is raised if VTK cannot read the file, or it holds another kind of data.
    """
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    content = path.read_bytes()
    readers = (vtkXMLPolyDataReader(), vtkXMLUnstructuredGridReader())
    reader = next((each for each in readers if each.CanReadFile(str(path))), None)
    if b"<VTKFile" not in content[:10_000] or reader is None:
        raise wrong_format("is not a VTK XML file of polygons or an unstructured grid")
    most = _VALUES_PER_BYTE * len(content)
    _check_counts(content, rb'NumberOf(\w+)\s*=\s*"\s*(\d+)', most)
    return _from_polydata(_surface(_output(reader, path)))


def read_legacy_vtk(path: Path) -> RawMesh:
    """Read a legacy VTK file: PolyData, or the surface of an unstructured grid.

    `InputError` is raised if VTK cannot read the file, or it holds another kind of data.
    """
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader

    whole = path.read_bytes()
    content = unmarked(whole)
    if not content.startswith(b"# vtk DataFile"):
        raise wrong_format('does not begin with "# vtk DataFile"')
    _check_counts(content, _LEGACY_COUNTS, len(content))
    content = _with_names_apart(content)
    reader: Any = vtkGenericDataObjectReader()
    for kind in _ATTRIBUTES:
        getattr(reader, f"ReadAll{kind}On")()
    if content is not whole:
        reader.ReadFromInputStringOn()
        reader.SetBinaryInputString(content, len(content))
    return _from_polydata(_surface(_output(reader, path)), _colors_of_labels(content))


def _surface(output: Any) -> Any:
    """Return PolyData, or the surface of an unstructured grid as PolyData."""
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    if output is None:
        raise wrong_format("holds no data set that VTK can read")
    if output.IsA("vtkUnstructuredGrid"):
        surface = vtkGeometryFilter()
        surface.SetInputData(output)
        surface.Update()
        output = surface.GetOutput()
    if not output.IsA("vtkPolyData"):
        raise InputError("no-faces", f"holds a {output.GetClassName()} where a surface should be")
    return output


def _check_counts(content: bytes, pattern: bytes, most: int) -> None:
    """Raise `InputError` for counts too large for the file, before VTK allocates memory."""
    for found in re.finditer(pattern, content):
        if len(found[2]) > 18 or int(found[2]) > most:
            raise InputError(
                "file-cut-short",
                f"promises {printable(found[2].decode(), 24)}"
                f" {printable(found[1].decode('latin-1').lower(), 40)}, which a file of its size"
                " cannot hold",
            )


def _output(reader: Any, path: Path) -> Any:
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

    # VTK reports errors to an output window and continues
    collector = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(collector)
    reader.SetFileName(str(path))
    reader.Update()
    complaints = collector.GetOutput()
    # VTK does not set an error code if a file is cut short, but warns "Error reading binary data!"
    if reader.GetErrorCode() or "error" in complaints.lower():
        clauses = [
            re.sub(r"^\w+ \(0x[0-9a-f]+\): ", "", line.strip()).rstrip(".!")
            for line in complaints.splitlines()
            if line.strip() and not re.match(r"(ERROR|Warning|Generic Warning): In ", line)
        ]
        detail = clauses[0] if clauses else f"error {reader.GetErrorCode()}"
        raise InputError("not-readable", f"is not readable by VTK ({printable(detail)})")
    return reader.GetOutput()


def _from_polydata(output: Any, colors: dict[str, tuple[str, ...]] | None = None) -> RawMesh:
    if output is None or output.GetPoints() is None:
        raise InputError("no-vertices", "holds no vertices")
    vertices, triangles = polydata_triangles(output)
    field = output.GetFieldData().GetAbstractArray("meshmash-viewer")
    meta = str(field.GetValue(0)) if field is not None and field.GetNumberOfValues() else ""
    maps, remarks = _maps(output, colors or {})
    unit, structure = stated_mesh(meta)
    return RawMesh(vertices, triangles, unit, maps, remarks, structure, meta)


def _maps(
    output: Any, colors: dict[str, tuple[str, ...]]
) -> tuple[tuple[RawMap, ...], tuple[str, ...]]:
    """Return a map per component of the point arrays, and a clause on data that are left out.

    `colors` has the colours of labels 0, 1, ... by the name of the array.
    """
    data = output.GetPointData()
    maps: list[RawMap] = []
    others: list[str] = []
    for at in range(data.GetNumberOfArrays()):
        array = data.GetAbstractArray(at)
        name = array.GetName() or f"array {at}"
        kind = _no_map(data, array)
        if kind:
            others.append(f"{kind} {printable(name, 60)!r}")
        else:
            maps += _columns(name, _array(array), array, colors.get(name, ()))
    if len(maps) > MOST_MAPS:
        others.append(f"{len(maps) - MOST_MAPS} of {len(maps)} arrays of numbers")
    cells = output.GetCellData()
    named = [cells.GetArrayName(at) or "" for at in range(cells.GetNumberOfArrays())]
    others += [f"values of its faces {printable(each, 60)!r}" for each in named]
    remark = f"has {', '.join(others)}, which are no maps and are left out"
    return tuple(maps[:MOST_MAPS]), (remark,) if others else ()


def _no_map(data: Any, array: Any) -> str:
    """Return the kind of an array that is not read as a map; "" for a map."""
    if array.IsA("vtkDataArray") == 0:
        return "texts"
    if array is data.GetNormals():  # == would compare the numbers
        return "normals"
    if array is data.GetTCoords():
        return "places in a texture"
    is_color = array.GetDataTypeAsString() == "unsigned char"
    return "colours" if is_color and array.GetNumberOfComponents() in (3, 4) else ""


def _columns(
    name: str, values: npt.NDArray[Any], array: Any, colors: tuple[str, ...]
) -> Iterator[RawMap]:
    if values.ndim == 1:
        yield RawMap(name, values, _labels(values, colors))
        return
    count = values.shape[1]
    axes = [array.GetComponentName(at) or ("xyz"[at] if count == 3 else at) for at in range(count)]
    yield from maps_of_columns(values, [f"{name} {axis}" for axis in axes])


def _labels(values: npt.NDArray[Any], colors: tuple[str, ...]) -> tuple[Label, ...]:
    """Return labels of integers that index a colour table, other than the default one of VTK."""
    counted = values.dtype.kind in "iu" and len(values) > 0
    if not counted or values.min() < 0 or values.max() >= len(colors) or len(colors) == _RAMP:
        return ()
    if len(colors) > MOST_LABELS:
        return ()
    return tuple(Label(key, str(key), color) for key, color in enumerate(colors))


def _colors_of_labels(content: bytes) -> dict[str, tuple[str, ...]]:
    """Return the colour tables in a legacy file by the name of the array that uses the table."""
    is_text = _TEXT_KIND.match(content) is not None
    tables = {}
    for found in _TABLE.finditer(content):
        count = int(found[2]) if len(found[2]) < 6 else 0
        shares: npt.NDArray[Any]
        if is_text:
            words = content[found.end() : found.end() + 120 * count].split(maxsplit=4 * count)
            try:
                shares = np.array([float(word) for word in words[: 4 * count]])
            except ValueError:
                continue
        else:
            room = content[found.end() : found.end() + 4 * count]
            shares = np.frombuffer(room, np.uint8) / 255.0
        if len(shares) == 4 * count and np.isfinite(shares).all():
            rgb = np.rint(255.0 * np.clip(shares.reshape(-1, 4)[:, :3], 0.0, 1.0)).astype(int)
            tables[found[1]] = tuple("#{:02x}{:02x}{:02x}".format(*each) for each in rgb.tolist())
    refers = {found[1]: found[2] for found in _TABLE_OF_SCALARS.finditer(content)}
    return {
        unquote(name.decode("latin-1")): tables[table]
        for name, table in refers.items()
        if table in tables
    }


def _with_names_apart(content: bytes) -> bytes:
    """Return the content with a number appended to repeated names of point arrays.

    Of arrays with equal names, VTK keeps only the last.
    """
    start = content.rfind(b"\nPOINT_DATA")
    stop = content.find(b"\nCELL_DATA", max(start, 0))
    points = content[start:stop] if stop >= 0 else content[start:]
    if start < 0:
        return content
    patterns = [_ATTRIBUTE, *([_FIELD_ARRAY] if b"\nFIELD" in points else [])]
    names = [found[2] for each in patterns for found in each.finditer(points)]
    if len(set(names)) == len(names):
        return content
    seen: Counter[bytes] = Counter()

    def numbered(found: re.Match[bytes]) -> bytes:
        seen[found[2]] += 1
        number = b"%%20%d" % seen[found[2]] if seen[found[2]] > 1 else b""
        return found[1] + found[2] + number

    for each in patterns:
        points = each.sub(numbered, points)
    return content[:start] + points + (content[stop:] if stop >= 0 else b"")


def _array(values: Any) -> npt.NDArray[Any]:
    """Return the numbers of a VTK array, shape (n,) or (n, components)."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

    if values.IsA("vtkBitArray"):
        bits, values = values, vtkUnsignedCharArray()
        values.DeepCopy(bits)
    convert: Any = numpy_support.vtk_to_numpy
    array: npt.NDArray[Any] = convert(values)
    return array

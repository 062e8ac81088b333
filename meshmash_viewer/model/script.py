"""Python script that reproduces the displayed field."""

from __future__ import annotations

from typing import NamedTuple

from meshmash_viewer.features import MATCHED_COLUMNS
from meshmash_viewer.features.comparison import Correspondence
from meshmash_viewer.fields.bank_columns import BankFamily
from meshmash_viewer.fields.family import Family
from meshmash_viewer.io.links import shown_path
from meshmash_viewer.io.session import packed_mask
from meshmash_viewer.model.display import FEWEST_PAIRS
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import FieldRequest, request_of
from meshmash_viewer.model.matching import MATCHED_IN
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.model.selection import mask_in_file
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


class Exported(NamedTuple):
    """The last export: hash of the mesh, family, number of pairs, and whether maps were added."""

    mesh_hash: str
    family: Family
    n_pairs: int
    maps: bool


def reproduction_script(
    document: Document, pair: Pair | None = None, exported: Exported | None = None
) -> str:
    """Return a script that reads, repairs and decomposes the mesh, and computes the field.

    The script needs only this package and NumPy; for a mesh in memory, the user has to complete a
    line. The script writes the columns of the last export, or columns suggested by the export
    dialog, to a new file in ``folder``; other paths are absolute. With `pair`, it also compares
    the two meshes.
    """
    request = request_of(document)
    lines, rest = _reading(document), list[str]()
    if document.mesh is not None and request is not None:
        rest = [*_computing(document, request, exported), *_writing(document, request, exported)]
        if document.display.shape.shown and len(request.spectrum) >= FEWEST_PAIRS:
            rest += _shape(document, len(request.spectrum))
        if pair is not None and pair.comparison is not None:
            rest += _comparison(pair, request)
        lines += _in_no_file(document, rest)
        if any("decomposition" in line for line in rest):
            lines += _decomposition(document, request.spectrum)
    lines += rest
    imports = []
    if any("folder /" in line for line in lines):
        imports += ["from pathlib import Path", ""]
        lines = ["", "folder = Path()  # of the results", *lines]
    if any("np." in line for line in lines):
        imports += ["import numpy as np", ""]
    if any("zlib." in line for line in lines):
        imports = ["import base64", "import zlib", *imports]
    return "\n".join([*imports, "import meshmash_viewer as mv", *lines, ""])


def script_output(document: Document) -> str:
    """Return the name of the file that the script writes; "" without a mesh or a field."""
    request = request_of(document)
    if document.mesh is None or request is None:
        return ""
    family, name = request.family, document.mesh.name or "mesh"
    return f"{name}_{family.export}.npz" if family.makes_features() else f"{name}_{family.name}.npy"


def _computing(document: Document, request: FieldRequest, exported: Exported | None) -> list[str]:
    """Return lines that compute ``values``, and ``features`` if the family has features."""
    family = request.family.measured_from([pin.vertex for pin in document.pins.placed])
    lines = family.script(request.spectrum)
    known = _known(document, request, exported)
    if isinstance(family, BankFamily) and known is not None:
        assert isinstance(known.family, BankFamily)
        bank = known.family.bank_script()
        if bank != family.bank_script():  # the export had other parameters than the display
            lines += [f"features = mv.compute_features(decomposition, {bank}, unit=mesh.unit)"]
    return lines


def _known(document: Document, request: FieldRequest, exported: Exported | None) -> Exported | None:
    """Return the last export if its family, mesh and number of pairs are the current ones."""
    mesh, family = document.mesh, request.family
    if exported is None or mesh is None or exported.family.name != family.name:
        return None
    same = exported.mesh_hash == mesh.content_hash
    same = same and (not family.of_pairs or exported.n_pairs == len(request.spectrum))
    return exported if same else None


def _reading(document: Document, name: str = "mesh") -> list[str]:
    if document.mesh is None:
        return []
    path = document.path
    if path is None:
        lines = ["", f"{name} = mv.Mesh(vertices, faces, unit=...)  # the mesh in memory"]
    else:
        where = shown_path(path.absolute())  # for a linked segment, the link
        read = f"mv.read_mesh({where!r}, unit={document.unit_text!r})"
        lines = ["", f"{name} = {read}"]
    if document.repairs:
        repairs = ", ".join(map(repr, document.repairs))
        lines += [f"{name} = mv.repair_mesh({name}, {repairs})"]
    added = dict.fromkeys(each.path for each in document.mesh.maps if each.path)
    lines += [f"{name} = {name}.with_maps(*mv.read_maps({each!r}, {name}))" for each in added]
    return lines


def _in_no_file(document: Document, rest: list[str]) -> list[str]:
    """Return comments on maps that the rest of a script uses but no file contains."""
    every = any(".with_maps(mesh)" in line for line in rest)
    needed = [
        repr(each.name)
        for each in document.maps.unsaved.maps
        if every or any(f"map_named({each.name!r})" in line for line in rest)
    ]
    if not needed:
        return []
    one = len(needed) == 1
    are, them, maps = ("is", "it", "The map") if one else ("are", "them", "The maps")
    return [
        f"# {maps} {', '.join(needed)} {are} in no file as shown. Export {them} (File, Export,",
        f"# Maps), and add {them} by the next line, with the name of that file:",
        "# mesh = mesh.with_maps(*mv.read_maps('maps.npz', mesh))",
    ]


def _operator(document: Document) -> str:
    spectrum = document.spectrum
    operator = (spectrum.operator if spectrum is not None else None) or document.solve.operator
    options = f"robust={operator.robust}"
    if operator.robust:
        options += f", mollify_factor={operator.mollify_factor!r}"
    return options


def _comparison(pair: Pair, request: FieldRequest) -> list[str]:
    """Return lines that solve the second mesh and compare it with the first.

    All pairs of the second mesh are computed, as the comparison used them, including pairs above
    the last eigenvalue of the first mesh.
    """
    first, second = request.spectrum, pair.second.spectrum
    assert second is not None
    family = MATCHED_IN[pair.matched_in].exported(MATCHED_COLUMNS)
    family = family.resolved(first, pair.first.display.fields)
    bank = family.carried(
        Correspondence(1.0 / float(first.vertex_areas.sum()) ** 0.5)
    ).bank_script()
    area = "decomposition.mass.sum()"
    landmarks = [list(each) for each in pair.landmarks]
    refined = f", refine=True, landmarks={landmarks}, meshes=(mesh, other)" if pair.refined else ""
    bank = bank.replace("decomposition.eigenvalues", f"decomposition.eigenvalues * {area}")
    return [
        *_reading(pair.second, "other"),
        f"other_laplacian, other_mass = mv.cotangent_laplacian(other, {_operator(pair.second)})",
        f"other_decomposition = mv.solve(other_laplacian, other_mass, {_asked(second)})",
        f"bank = {bank}",
        "vertices = mv.corresponding_vertices(mesh, other)",
        "comparison = mv.compare_shapes("
        f"decomposition, other_decomposition, bank, vertices=vertices{refined})",
        "print(comparison.distance, comparison.mutual_share)",
    ]


def _asked(spectrum: Eigenpairs) -> str:
    """Return the argument of `solve` that asks for a spectrum."""
    target = spectrum.target
    if target is None or target.kind == "count" or not spectrum.complete:
        return str(len(spectrum))
    return f"max_eigenvalue={target.value!r}"


def _decomposition(document: Document, spectrum: Eigenpairs) -> list[str]:
    lines, of, part, mesh = list[str](), "mesh", document.part_mesh, document.mesh
    if part is not None and mesh is not None:
        of, packed = "part", packed_mask(mask_in_file(mesh, part.referenced))
        lines = [
            f"packed = zlib.decompress(base64.b64decode({packed!r}))",
            f"mask = np.unpackbits(np.frombuffer(packed, np.uint8), count={mesh.n_file_vertices})",
            "part = mesh.masked(mask.astype(bool)[mesh.file_indices])",
        ]
    return [
        *lines,
        f"laplacian, mass = mv.cotangent_laplacian({of}, {_operator(document)})",
        f"decomposition = mv.solve(laplacian, mass, {_asked(spectrum)})",
        "print(decomposition.proof(mesh.unit))",
    ]


def _shape(document: Document, n_pairs: int) -> list[str]:
    shape = document.display.shape
    name = (document.mesh.name if document.mesh is not None else "") or "mesh"
    lines = [
        "from meshmash_viewer.features.shape import low_pass_vertices",
        f"vertices = low_pass_vertices(mesh, decomposition, {shape.within(n_pairs)})",
    ]
    if shape.morph != 1.0:
        lines += [f"vertices = mesh.vertices + {shape.morph!r} * (vertices - mesh.vertices)"]
    return [
        *lines,
        "shape = mv.Mesh(vertices, mesh.faces, unit=mesh.unit, structure=mesh.structure)",
        *_unused(f"{name}_shape.npz"),
        "np.savez(path, vertices=shape.vertices, faces=shape.faces)",
        "print(path)",
    ]


def _unused(name: str) -> list[str]:
    """Return lines that choose an output file; no file is overwritten."""
    return [
        "from meshmash_viewer.io.write import unused_path",
        f"path = unused_path(folder / {name!r})",
    ]


def _writing(document: Document, request: FieldRequest, exported: Exported | None) -> list[str]:
    mesh, family = document.mesh, request.family
    assert mesh is not None
    output = script_output(document)
    path = _unused(output)
    if family.makes_features():
        known = _known(document, request, exported)
        maps = bool(mesh.maps) if known is None else known.maps
        pairs = ", eigenvalues=decomposition.eigenvalues" if family.of_pairs else ""
        return [
            *(["features = features.with_maps(mesh)"] if maps else []),
            *path,
            f"mv.write_features(path, features, mesh{pairs})",
            "print(path)",
        ]
    # rows are the vertices of the file
    values = "values" if mesh.numbering is None else "mesh.on_file(values)"
    return [*path, f"np.save(path, {values})", "print(path)"]

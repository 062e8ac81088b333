"""What is on screen, as a Python script that makes it again."""

from __future__ import annotations

from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import FieldRequest, request_of
from meshmash_viewer.model.shape import FEWEST_PAIRS

__all__ = ["reproduction_script"]


def reproduction_script(document: Document) -> str:
    """Write the script: read, repair, decompose, compute the field, write it.

    A whole Python program that uses nothing but this package and NumPy. A mesh without a file gets
    a line for its owner to fill in.
    """
    request = request_of(document)
    lines = _reading(document)
    if document.mesh is not None and request is not None:
        field = request.family.script(request.spectrum)
        if any("decomposition" in line for line in field):
            lines += _decomposition(document, len(request.spectrum))
        lines += field
        lines += _writing(document, request)
        if document.display.shape.shown and len(request.spectrum) >= FEWEST_PAIRS:
            if not any(line.startswith("decomposition =") for line in lines):
                lines += _decomposition(document, len(request.spectrum))
            lines += _shape(document, len(request.spectrum))
    imports = ["import numpy as np", ""] if any("np." in line for line in lines) else []
    return "\n".join([*imports, "import meshmash_viewer as mv", *lines, ""])


def _reading(document: Document) -> list[str]:
    if document.mesh is None:
        return []
    path = document.path
    if path is None:
        lines = ["", "mesh = mv.Mesh(vertices, faces, unit=...)  # the mesh in memory"]
    else:
        lines = ["", f"mesh = mv.read_mesh({str(path.absolute())!r}, unit={document.unit_text!r})"]
    if document.repairs:
        lines.insert(0, "from meshmash_viewer.health import REPAIRS")
        lines += [f"mesh = REPAIRS[{name!r}].apply(mesh)" for name in document.repairs]
    added = dict.fromkeys(each.path for each in document.mesh.maps if each.path)
    lines += [f"mesh = mesh.with_maps(*mv.read_maps({name!r}, mesh))" for name in added]
    return lines


def _decomposition(document: Document, n_pairs: int) -> list[str]:
    spectrum = document.spectrum
    operator = (spectrum.operator if spectrum is not None else None) or document.operator
    options = f"robust={operator.robust}"
    if operator.robust:
        options += f", mollify_factor={operator.mollify_factor!r}"
    return [
        f"laplacian, mass = mv.cotangent_laplacian(mesh, {options})",
        f"decomposition = mv.solve(laplacian, mass, {n_pairs})",
        "print(decomposition.proof(mesh.unit))",
    ]


def _shape(document: Document, n_pairs: int) -> list[str]:
    shape = document.display.shape
    name = (document.mesh.name if document.mesh is not None else "") or "mesh"
    lines = [f"vertices = mv.low_pass_vertices(mesh, decomposition, {shape.within(n_pairs)})"]
    if shape.morph != 1.0:
        lines += [f"vertices = mesh.vertices + {shape.morph!r} * (vertices - mesh.vertices)"]
    return [
        *lines,
        "shape = mv.Mesh(vertices, mesh.faces, unit=mesh.unit)",
        f"np.savez({f'{name}_shape.npz'!r}, vertices=shape.vertices, faces=shape.faces)",
    ]


def _writing(document: Document, request: FieldRequest) -> list[str]:
    name = document.mesh.name if document.mesh is not None else ""
    stem = f"{name or 'mesh'}_{request.family.name}"
    if request.family.makes_features():
        told = ", eigenvalues=decomposition.eigenvalues" if request.family.of_pairs else ""
        return [f"mv.write_features({f'{stem}.npz'!r}, features, mesh{told})"]
    return [f"np.save({f'{stem}.npy'!r}, values)"]

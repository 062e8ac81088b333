"""What is on screen, as a Python script that makes it again."""

from __future__ import annotations

from meshmash_viewer.features.comparison import Correspondence
from meshmash_viewer.model.display import FEWEST_PAIRS
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import FieldRequest, request_of
from meshmash_viewer.model.pair import MATCHED_IN, Pair

__all__ = ["reproduction_script"]


def reproduction_script(document: Document, pair: Pair | None = None) -> str:
    """Write the script: read, repair, decompose, compute the field, write it; compare a pair.

    A whole Python program that uses nothing but this package and NumPy. A mesh without a file gets
    a line for its owner to fill in.
    """
    request = request_of(document)
    lines, rest = _reading(document), list[str]()
    if document.mesh is not None and request is not None:
        rest = [*request.family.script(request.spectrum), *_writing(document, request)]
        if document.display.shape.shown and len(request.spectrum) >= FEWEST_PAIRS:
            rest += _shape(document, len(request.spectrum))
        if pair is not None and pair.comparison is not None:
            rest += _comparison(pair, request)
        if any("decomposition" in line for line in rest):
            lines += _decomposition(document, len(request.spectrum))
    lines += rest
    imports = ["import numpy as np", ""] if any("np." in line for line in lines) else []
    return "\n".join([*imports, "import meshmash_viewer as mv", *lines, ""])


def _reading(document: Document, name: str = "mesh") -> list[str]:
    if document.mesh is None:
        return []
    path = document.path
    if path is None:
        lines = ["", f"{name} = mv.Mesh(vertices, faces, unit=...)  # the mesh in memory"]
    else:
        read = f"mv.read_mesh({str(path.absolute())!r}, unit={document.unit_text!r})"
        lines = ["", f"{name} = {read}"]
    if document.repairs:
        repairs = ", ".join(map(repr, document.repairs))
        lines += [f"{name} = mv.repair_mesh({name}, {repairs})"]
    added = dict.fromkeys(each.path for each in document.mesh.maps if each.path)
    lines += [f"{name} = {name}.with_maps(*mv.read_maps({each!r}, {name}))" for each in added]
    return lines


def _operator(document: Document) -> str:
    spectrum = document.spectrum
    operator = (spectrum.operator if spectrum is not None else None) or document.operator
    options = f"robust={operator.robust}"
    if operator.robust:
        options += f", mollify_factor={operator.mollify_factor!r}"
    return options


def _comparison(pair: Pair, request: FieldRequest) -> list[str]:
    """Solve the second mesh as far as the first, and match their vertices."""
    first, mesh = request.spectrum, pair.first.mesh
    assert mesh is not None
    family = MATCHED_IN[pair.matched_in]().resolved(first, pair.first.display.fields)
    bank = family.carried(Correspondence(1.0 / mesh.area**0.5)).bank_script()
    area = "decomposition.mass.sum()"
    bank = bank.replace("decomposition.eigenvalues", f"decomposition.eigenvalues * {area}")
    return [
        *_reading(pair.second, "other"),
        f"other_laplacian, other_mass = mv.cotangent_laplacian(other, {_operator(pair.second)})",
        f"top = decomposition.eigenvalues[-1] * {area} / other_mass.sum() * (1 + 1e-9)",
        "other_decomposition = mv.solve(other_laplacian, other_mass, max_eigenvalue=top)",
        f"bank = {bank}",
        "vertices = mv.corresponding_vertices(mesh, other)",
        "comparison = mv.compare_shapes("
        "decomposition, other_decomposition, bank, vertices=vertices)",
        "print(comparison.distance, comparison.mutual_share)",
    ]


def _decomposition(document: Document, n_pairs: int) -> list[str]:
    return [
        f"laplacian, mass = mv.cotangent_laplacian(mesh, {_operator(document)})",
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
        "shape = mv.Mesh(vertices, mesh.faces, unit=mesh.unit, structure=mesh.structure)",
        f"np.savez({f'{name}_shape.npz'!r}, vertices=shape.vertices, faces=shape.faces)",
    ]


def _writing(document: Document, request: FieldRequest) -> list[str]:
    name = document.mesh.name if document.mesh is not None else ""
    stem = f"{name or 'mesh'}_{request.family.name}"
    if request.family.makes_features():
        told = ", eigenvalues=decomposition.eigenvalues" if request.family.of_pairs else ""
        return [f"mv.write_features({f'{stem}.npz'!r}, features, mesh{told})"]
    values = "values"
    if document.mesh is not None and document.mesh.numbering is not None:
        values = "mesh.on_file(values)"  # so that a row is a vertex of the file
    return [f"np.save({f'{stem}.npy'!r}, {values})"]

"""What is on screen, as a Python script that makes it again."""

from __future__ import annotations

from meshmash_viewer.model.display import FieldKind, SimilarityBasis
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import FieldRequest, request_of

__all__ = ["reproduction_script"]


def reproduction_script(document: Document) -> str:
    """Write the script: read, repair, decompose, compute the field, write it.

    Parameters
    ----------
    document : Document

    Returns
    -------
    str
        A whole Python program that uses nothing but this package and NumPy. A mesh without a file
        gets a line for its owner to fill in.
    """
    request = request_of(document)
    lines = _reading(document)
    if document.mesh is not None and request is not None:
        lines += _decomposition(document, len(request.spectrum)) + _field(request)
        lines += _writing(document, request)
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


def _field(request: FieldRequest) -> list[str]:
    if request.kind is FieldKind.EIGENFUNCTION:
        shown = request.spectrum.shown
        turned = 1.0 if shown is None else shown.alignment.sign(request.index)
        sign = "-" if request.flipped != (turned == -1.0) else ""
        lines = [f"values = {sign}decomposition.eigenvectors[:, {request.index}]"]
        if turned is None:
            lines.insert(0, "# one of a multiplet: on screen it is rotated within that")
        return lines
    if request.kind is FieldKind.HKS:
        bank = f"mv.heat_kernel_bank([{request.time!r}])"
        column = 0
    elif request.kind is FieldKind.BAND:
        bank = _bspline_bank(request)
        column = request.band
    else:
        bank = _bspline_bank(request)
        if request.basis is SimilarityBasis.HKS:
            first, last = request.times
            bank = f"mv.heat_kernel_bank(np.geomspace({first!r}, {last!r}, {request.scales}))"
        return [
            f"features = mv.compute_features(decomposition, {bank}, unit=mesh.unit)",
            f"values = mv.feature_distance(features, {request.vertex})",
        ]
    return [
        f"features = mv.compute_features(decomposition, {bank}, unit=mesh.unit)",
        f"values = features.values[:, {column}]",
    ]


def _bspline_bank(request: FieldRequest) -> str:
    low, high = request.eigenvalues
    return f"mv.bspline_bank({low!r}, {high!r}, {request.band_count})"


def _writing(document: Document, request: FieldRequest) -> list[str]:
    name = document.mesh.name if document.mesh is not None else ""
    stem = name or "mesh"
    if request.kind in (FieldKind.HKS, FieldKind.BAND):
        return [
            f"mv.write_features({f'{stem}_{request.kind}.npz'!r}, features, mesh, "
            "eigenvalues=decomposition.eigenvalues)"
        ]
    return [f"np.save({f'{stem}_{request.kind}.npy'!r}, values)"]

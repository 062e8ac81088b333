"""Faults that the person at the keyboard can mend, and how they are said."""

from __future__ import annotations

__all__ = [
    "ConstantFeaturesWarning",
    "InputError",
    "MeshWarning",
    "MissingValuesWarning",
    "TruncationWarning",
    "UnprovenError",
    "UnprovenWarning",
    "missing_module",
    "not_installed",
    "of_mesh",
    "printable",
]

#: Packages to install that are called otherwise than what is imported.
_PACKAGES = {"PIL": "pillow", "PySide6": "PySide6-Essentials", "vtkmodules": "vtk"}


class InputError(ValueError):
    """A fault in what was given, said in one sentence that names it and the way out.

    The command line prints the sentence and exits with status 2; the window shows it in its
    message bar. Any other exception is a defect of the program and is reported as such.

    Examples
    --------
    >>> try:
    ...     mv.read_mesh("nowhere.ply")
    ... except mv.InputError as error:
    ...     print(error)
    nowhere.ply does not exist; check the spelling of its name and folder.
    """


class UnprovenError(InputError):
    """The eigenpairs of this matrix cannot be found, or not proven, in floating-point numbers."""


class MeshWarning(UserWarning):
    """A mesh is not all that its file holds, or has a fault that a result depends on.

    `read_mesh` warns of what it left out of a file, such as the lines and points of a scene, and
    `mean_curvature` of faces that do not agree on which side is outside.

    Examples
    --------
    >>> import warnings
    >>> corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     curvature = mv.mean_curvature((corners, [[0, 1, 2], [0, 3, 2], [0, 1, 3]]))
    >>> caught[0].category is mv.MeshWarning
    True
    """


class MissingValuesWarning(UserWarning):
    """A map has no value at some vertices: they have no weight in what is computed from it.

    Examples
    --------
    >>> import trimesh, warnings
    >>> ball = trimesh.creation.icosphere(3)
    >>> pairs = mv.solve(*mv.cotangent_laplacian(ball), 16)
    >>> height = np.where(np.arange(642) == 5, np.nan, ball.vertices[:, 2])
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     smooth = mv.filter_map(pairs, height, mv.low_pass_bank(3.0))
    >>> caught[0].category is mv.MissingValuesWarning, bool(np.isfinite(smooth).all())
    (True, True)
    """


class UnprovenWarning(UserWarning):
    """Eigenpairs that a function returns, or makes features of, lack a part of their proof."""


class ConstantFeaturesWarning(UserWarning):
    """Features are right, but the same at all vertices of a component.

    Only zero eigenvalues lie below the threshold: usual for a speck of membrane, but for a whole
    mesh a sign of a threshold that was meant for another unit.
    """


class TruncationWarning(UserWarning):
    """More than 1 % of a feature column is missing, because too few eigenpairs took part.

    By the estimate of `meshmash_viewer.features.truncation`; the features carry it with its bound.

    Examples
    --------
    >>> import trimesh
    >>> ball = trimesh.creation.icosphere(3)
    >>> L, M = mv.cotangent_laplacian(ball)
    >>> pairs = mv.solve(L, M, 16)
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     hks = mv.compute_features(pairs, mv.heat_kernel_bank([0.01]))
    >>> caught[0].category is mv.TruncationWarning
    True
    """


def of_mesh(name: str) -> str:
    """Beginning of a warning that concerns one mesh, "neuron: "; empty if it has no name."""
    return f"{printable(name)}: " if name else ""


def not_installed(module: str) -> str:
    """Clause on a module that is not there: "x, which is not installed: pip install x"."""
    package = _PACKAGES.get(module, module)
    return f"{package}, which is not installed: pip install {package}"


def missing_module(fault: BaseException) -> str:
    """Name of the package that an import did not find; empty if a part of one is missing."""
    name = fault.name if isinstance(fault, ModuleNotFoundError) else ""
    return "" if name is None or "." in name else name


def printable(text: object, length: int = 120) -> str:
    """Text out of a file as one line that a terminal and a message bar can show.

    Parameters
    ----------
    text : object
        Anything with a text.
    length : int
        Characters at most.
    """
    line = " ".join(str(text).split())
    line = "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in line
    )
    return line if len(line) <= length else line[: length - 1] + "…"

"""Exceptions and warnings for faults that the user can correct, and their wording."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable

#: Names of packages that differ from the imported module.
_PACKAGES = {
    "PIL": "pillow", "PySide6": "PySide6-Essentials", "vtkmodules": "vtk",
    "cloudvolume": "cloud-volume", "fast_simplification": "fast-simplification",
    "sklearn": "scikit-learn",
}  # fmt: skip


class InputError(ValueError):
    """Invalid input; the message is one sentence that names the fault and the remedy.

    The command line prints the sentence and exits with status 2; the window shows it in its
    message bar. Any other exception is a defect of the program and is reported as such.

    Parameters
    ----------
    code : str
        Kind of the fault, such as "file-not-found", which programs and tests compare.
    fault : str
        What is wrong and where, without a final full stop.
    remedy : str
        What to do, without a final full stop.

    Examples
    --------
    >>> try:
    ...     mv.read_mesh("nowhere.ply")
    ... except mv.InputError as error:
    ...     print(error.code, error, sep=": ")
    file-not-found: nowhere.ply does not exist: check the spelling of its name and folder.
    """

    def __init__(self, code: str, fault: str = "", remedy: str = "") -> None:
        whole = f"{fault}: {remedy}." if remedy else f"{fault}."
        if not fault:  # a plug-in gives one sentence
            whole, fault, code = code, code.removesuffix("."), ""
        #: Kind of the fault, what is wrong, and what to do.
        self.code, self.fault, self.remedy = code, fault, remedy
        super().__init__(whole)

    @property
    def clause(self) -> str:
        """Fault and remedy without a full stop."""
        return f"{self.fault}: {self.remedy}" if self.remedy else self.fault

    def of(self, subject: object = "", remedy: str = "") -> InputError:
        """Return this fault with its subject, such as a file, and a remedy if it has none.

        A clause, "has no faces", follows the subject; a sentence, "Map 'x' is empty", a colon.
        Without a subject, the result is the fault itself as a plain `InputError`.
        """
        remedy = self.remedy or remedy * bool(self.code)  # a sentence of a plug-in has its own
        start = f"{subject}{'' if self.fault[:1].islower() else ':'} " if subject else ""
        return InputError(self.code, f"{start}{self.fault}", remedy)


class UnprovenError(InputError):
    """Failure to compute or certify the eigenpairs of a matrix in double precision."""


class MeshWarning(UserWarning):
    """Warning that a part of a file is not read, or a result depends on a limit of the mesh.

    `decompose_mesh` warns if more pairs are requested than the mesh has, `read_mesh` of ignored
    content of a file, such as the lines and points of a scene, `mean_curvature` of neighbouring
    faces with inconsistent orientation, and `compare_shapes` of a match in doubt.

    Examples
    --------
    >>> import warnings
    >>> corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> with warnings.catch_warnings(action="ignore", category=mv.MeshWarning):
    ...     curvature = mv.mean_curvature((corners, [[0, 1, 2], [0, 3, 2], [0, 1, 3]]))
    """


class MissingValuesWarning(UserWarning):
    """Warning that a map has no value at some vertices, which are ignored in results.

    Examples
    --------
    >>> import warnings
    >>> height = np.where(np.arange(642) == 5, np.nan, ball.vertices[:, 2])
    >>> with warnings.catch_warnings(action="ignore", category=mv.MissingValuesWarning):
    ...     smooth = mv.filter_map(pairs, height, mv.low_pass_bank(3.0))
    >>> bool(np.isfinite(smooth).all())
    True
    """


class UnprovenWarning(UserWarning):
    """Warning that eigenpairs are not fully certified."""


class ConstantFeaturesWarning(UserWarning):
    """Warning that features are constant on each component.

    Only zero eigenvalues lie below the threshold: this is usual for small components, but for a
    whole mesh the threshold is probably in another unit.
    """


class TruncationWarning(UserWarning):
    """Warning that too few eigenpairs were used: more than 1 % of a feature column is missing.

    The estimate, from `meshmash_viewer.features.truncation`, is stored in the features.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(action="ignore", category=mv.TruncationWarning):
    ...     hks = mv.compute_features(pairs, mv.heat_kernel_bank([0.01]))
    """


def of_mesh(name: str) -> str:
    """Return the beginning of a warning about a mesh, "neuron: "; empty without a name."""
    return f"{printable(name)}: " if name else ""


def unknown(kind: str, name: object, known: Iterable[object]) -> InputError:
    """Return the fault of a name that is not one of those known."""
    choice = ", ".join(map(str, known)) or "none"
    return InputError("unknown-name", f"There is no {kind} {name!r}", f"give one of {choice}")


def wrong_shape(what: str, shape: object, wanted: str) -> InputError:
    """Return the fault of an array: "Points have shape (4,): give x, y and z for each"."""
    return InputError("wrong-shape", f"{what} have shape {shape}", f"give {wanted}")


def wrong_type(what: str, kind: object, wanted: str) -> InputError:
    """Return the fault of another type of objects or entries: "Labels have type str: give int"."""
    name = getattr(kind, "__name__", kind)
    return InputError("wrong-type", f"{what} have type {name}", f"give {wanted}")


def not_carried(doubt: str) -> InputError:
    """Return the fault of a match in doubt, which carries no values."""
    return InputError("match-in-doubt", f"Nothing is carried by this match: {doubt}")


def other_units(what: str, first: str, second: str, remedy: str) -> InputError:
    """Return the fault of two units that cannot be compared, of which one may be missing."""
    units = f"{first or 'no unit'} and {second or 'no unit'}"
    return InputError("other-units", f"{what} are in {units}", remedy)


def other_mesh(what: str, count: int, n: int, remedy: str = "") -> InputError:
    """Return the fault of data at `count` vertices, used with a mesh of `n`."""
    remedy = remedy or "give the mesh that was decomposed"
    return InputError("other-mesh", f"{what} have {count:,} vertices, and the mesh {n:,}", remedy)


def conflicting(fault: str, remedy: str = "") -> InputError:
    """Return the fault of arguments or options that do not go together."""
    return InputError("conflicting-arguments", fault, remedy)


def unknown_ending(path: object, endings: Iterable[str]) -> InputError:
    """Return the fault of the name of an output whose ending is not one of those known."""
    remedy = f"end it in {', '.join(endings)}"
    return InputError("unknown-ending", f"{path} has no ending in which it can be written", remedy)


def not_readable(path: object, fault: OSError) -> InputError:
    """Return the fault of a file that the system does not read."""
    reason = fault.strerror or printable(fault)
    return InputError(
        "not-readable",
        f"{path} cannot be read ({reason})",
        "check its name, the permission, and the disk",
    )


def no_whole_numbers(what: str) -> InputError:
    """Return the fault of numbers in a file, such as "vertex indices", as a clause."""
    return InputError("not-whole-numbers", f"has {what} that are no whole numbers")


def wrong_format(fault: str) -> InputError:
    """Return the fault of a file that is not of its format, as a clause: "is no PLY file"."""
    return InputError("wrong-format", fault)


def cut_short(fault: str) -> InputError:
    """Return the fault of a file with less content than stated: "promises 9 faces and has 3"."""
    return InputError("file-cut-short", f"{fault}, so it was cut short", "copy or export it again")


def package_missing(subject: str, module: str, extra: str = "") -> InputError:
    """Return the fault of a module that is not installed; `subject` is such as "Domains need"."""
    package = _PACKAGES.get(module, module)
    wanted = f'"meshmash-viewer[{extra}]"' if extra else package
    fault = f"{subject} {package}, which is not installed"
    return InputError("package-missing", fault, f"pip install {wanted}")


def require(subject: str, extra: str, *modules: str) -> None:
    """Raise `package_missing` unless the modules are installed."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise package_missing(subject, module, extra)


def missing_module(fault: BaseException) -> str:
    """Return the package that an import did not find, or "" if only a submodule is missing."""
    name = fault.name if isinstance(fault, ModuleNotFoundError) else ""
    return "" if name is None or "." in name else name


def printable(text: object, length: int = 120) -> str:
    """Convert text from a file to one printable line of at most `length` characters."""
    line = " ".join(str(text).split())
    line = "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in line
    )
    return line if len(line) <= length else line[: length - 1] + "…"

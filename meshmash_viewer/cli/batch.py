"""Functions shared by the commands: loop over meshes, eigenpairs, and reports."""

from __future__ import annotations

import contextlib
import glob
import json
import math
import os
import signal
import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from meshmash_viewer.cli.arguments import FAULT, chosen_operator
from meshmash_viewer.cli.numbers import in_unit
from meshmash_viewer.cli.streams import answer, say
from meshmash_viewer.errors import InputError
from meshmash_viewer.health import repair_mesh
from meshmash_viewer.io.maps import read_maps, read_mask
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.spectrum import obtain_eigenpairs
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.failure import failure_of, report_defect
from meshmash_viewer.progress import Cancelled, ProgressBar
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.weyl import Target, wavelength
from meshmash_viewer.units import format_quantity

#: Result for a mesh: entries for JSON, and text.
Report: TypeAlias = tuple[dict[str, Any], str]
#: Called with a mesh, its index and the options in its unit.
Work: TypeAlias = Callable[[Mesh, int, Namespace], Report]

_DEFECT = 1
#: Of many meshes, the worst status is that of the command.
_SEVERITY = (0, FAULT, _DEFECT)


# Messages -------------------------------------------------------------------------------------


def say_fault(fault: Exception, subject: str = "") -> int:
    """Print the fault of a mesh or of the command; return the exit status."""
    failure = failure_of(fault)
    if not failure.correctable:
        say(f"{subject or 'The command'} failed by {report_defect(fault)}")
        return _DEFECT
    said = not subject or subject in failure.text
    say(failure.text if said else f"{subject}: {failure.text}")
    return FAULT


def print_report(options: Namespace, subject: Path, report: dict[str, Any], said: str) -> None:
    """Print the result for a mesh, as text or as JSON."""
    for remark in report.get("remarks", ()):
        say(f"{subject}: {remark}")
    answer(json.dumps(report) if options.json else said)


def titled_rows(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Format names and values as rows of text."""
    width = max(len(name) for name, _ in rows)
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in rows)])


def reach(report: dict[str, Any], mesh: Mesh) -> str:
    """Format the largest eigenvalue of a run, and its wavelength."""
    reached = f"up to λ = {format_quantity(report['max_eigenvalue'], mesh.unit, -2)}"
    if report["wavelength"] is None:
        return reached
    return f"{reached}, waves of {format_quantity(report['wavelength'], mesh.unit)}"


def pairs_report(pairs: Eigenpairs, mesh: Mesh) -> dict[str, Any]:
    """Return the entries of a report on eigenpairs."""
    largest = float(pairs.eigenvalues[-1])
    return {
        "n_eigenpairs": pairs.n_components,
        "max_eigenvalue": largest,
        "wavelength": finite(wavelength(largest)),
        "proof": pairs.proof(mesh.unit),
    }


def finite(value: float) -> float | None:
    """Return a number for JSON, None for infinite ones such as the wavelength of a constant."""
    return value if math.isfinite(value) else None


def more_pairs(t_min: float | None = None) -> str:
    """Return the remedy for a truncated column."""
    if t_min is not None:
        return ": --count auto takes as many as it needs"
    return ": take more of them (--count, --max-eigenvalue, --wavelength)"


# Meshes ---------------------------------------------------------------------------------------


def expanded(named: Iterable[Path]) -> list[Path]:
    """Replace patterns such as ``*.ply``, which not every shell expands, by the files that match.

    A name that holds ``*``, ``?`` or ``[`` and is not that of an existing file is a pattern below
    the part of its path that exists; ``**`` stands for any number of folders. `InputError` is
    raised if nothing matches a pattern.
    """
    paths = []
    for name in named:
        if not glob.has_magic(str(name)) or os.path.lexists(name):
            paths.append(name)
            continue
        folder = next((each for each in name.parents if each.exists()), Path(name.anchor))
        rest = name.relative_to(folder)
        found = glob.glob(str(rest), root_dir=folder, recursive=True)
        if not found:
            remedy = "check its folder, its spelling and its ending."
            if len(rest.parts) > 1 and not glob.has_magic(rest.parts[0]):
                remedy = f"there is no folder {rest.parts[0]}: check the spelling."
            raise InputError(f"No file matches {name}; {remedy}")
        paths += sorted(folder / each for each in found)
    return paths


def for_each(options: Namespace, work: Work, *, repaired: bool = True) -> int:
    """Do the work for every mesh; a fault of one does not stop the others.

    It gets the mesh repaired as asked for, or as it was read, and the options with all quantities
    in its unit.
    """
    status = 0
    for index, path in enumerate(options.mesh):
        try:
            mesh = read(path, options)
            own = in_unit(options, mesh.unit)
            mesh = prepared(mesh, options) if repaired else mesh
            print_report(options, path, *work(mesh, index, own))
        except (Cancelled, BrokenPipeError):  # end the command
            raise
        except Exception as fault:  # noqa: BLE001  reported; the next mesh follows
            status = max(status, say_fault(fault, str(path)), key=_SEVERITY.index)
    return status


def read(path: Path, options: Namespace) -> Mesh:
    """Read a mesh with the requested unit and brain structure."""
    mesh = read_mesh(path, options.unit)
    structure = getattr(options, "structure", None)  # of the commands that write files
    return replace(mesh, structure=structure) if structure else mesh


def prepared(mesh: Mesh, options: Namespace) -> Mesh:
    """Apply the requested repairs and the mask to a mesh."""
    mesh = repair_mesh(mesh, *options.repair)
    return mesh if options.mask is None else mesh.masked(read_mask(options.mask, mesh))


def with_maps(mesh: Mesh, paths: Sequence[Path]) -> Mesh:
    """Add the maps in files to a mesh."""
    for path in paths:
        mesh = mesh.with_maps(*read_maps(path, mesh))
    return mesh


# Computation ----------------------------------------------------------------------------------


def solved(mesh: Mesh, options: Namespace, target: Target) -> Eigenpairs:
    """Return the eigenpairs of a mesh, stored or computed."""
    with progress_bar(mesh) as bar, until_interrupted() as cancel:
        request = Request(
            target.n_components,
            target.max_eigenvalue,
            n_jobs=options.jobs,
            progress=bar,
            cancel=cancel,
        )
        pairs, remark = obtain_eigenpairs(
            mesh, chosen_operator(options), request, use_cache=not options.no_cache
        )
    if remark:
        say(remark)
    return pairs.on_mask(options.mask or "")


def progress_bar(mesh: Mesh) -> contextlib.AbstractContextManager[ProgressBar | None]:
    """Return a progress bar on a terminal, None otherwise."""
    if sys.stderr.isatty():
        return ProgressBar(mesh.name, leave=False)
    return contextlib.nullcontext()


@contextlib.contextmanager
def until_interrupted() -> Iterator[Any]:
    """Let Ctrl-C cancel the solver; a second Ctrl-C raises KeyboardInterrupt."""
    asked = False

    def ask(*_: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    try:
        before = signal.signal(signal.SIGINT, ask)
    except ValueError:  # not the main thread, which gets no signals
        yield None
        return
    try:
        yield lambda: asked
        if asked:  # after the solver's last question
            raise KeyboardInterrupt
    finally:
        signal.signal(signal.SIGINT, before)

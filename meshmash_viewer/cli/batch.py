"""Functions shared by the commands: loop over meshes, eigenpairs, and reports."""

from __future__ import annotations

import contextlib
import glob
import json
import math
import os
import signal
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from meshmash_viewer.cli.arguments import FAULT, chosen_operator, in_unit
from meshmash_viewer.cli.cluster import connected, results_of_tasks
from meshmash_viewer.cli.manifest import Content, Manifest, Outcome, content_of
from meshmash_viewer.cli.streams import answer, say
from meshmash_viewer.errors import InputError, conflicting
from meshmash_viewer.fault_places import repair_effect
from meshmash_viewer.fields.family import Family
from meshmash_viewer.health import repair_mesh
from meshmash_viewer.io.links import LINK_ENDING, is_link, link_file, parse_link, shown_path
from meshmash_viewer.io.maps import read_maps, read_mask
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.spectrum import measure_errors, obtain_eigenpairs
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.notices import failure_of, report_defect
from meshmash_viewer.progress import Cancelled, Progress, ProgressBar
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.weyl import Target, wavelength
from meshmash_viewer.units import counted, format_quantity

#: Remedy of an ambiguous match.
SET_LANDMARKS = "give at least three pairs of corresponding vertices (--landmark)"
#: Result for a mesh: entries for JSON, and text.
Report: TypeAlias = tuple[dict[str, Any], str]
#: Function of a mesh, its index in the command, and the options in its unit.
Work: TypeAlias = Callable[[Mesh, int, Namespace], Report]

_DEFECT = 1
#: Exit statuses in order; a command has the most severe status of its meshes.
_SEVERITY = (0, FAULT, _DEFECT)


# Messages -------------------------------------------------------------------------------------


def say_fault(fault: Exception) -> int:
    """Print the fault of the command; return the exit status."""
    status, text = _described_fault(fault)
    say(text)
    return status


def _described_fault(fault: Exception, subject: str = "") -> tuple[int, str]:
    """Return exit status and message for a fault of `subject`, by default of the command."""
    failure = failure_of(fault)
    if not failure.correctable:
        return _DEFECT, f"{subject or 'The command'} failed by {report_defect(fault)}"
    is_named = not subject or subject in failure.text
    return FAULT, failure.text if is_named else f"{subject}: {failure.text}"


def print_report(options: Namespace, subject: Path, report: dict[str, Any], said: str) -> None:
    """Print the result for a mesh, as text or as JSON."""
    for remark in report.get("remarks", ()):
        say(f"{shown_path(subject)}: {remark}")
    answer(json.dumps(report) if options.json else said)


def titled_rows(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Format names and values as rows of text."""
    width = max(len(name) for name, _ in rows)
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in rows)])


def reach(report: dict[str, Any], mesh: Mesh) -> str:
    """Format the largest eigenvalue in a report, and its wavelength."""
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
        "complete": pairs.complete,
        "worst_residual": float(pairs.residuals.max(initial=0.0)),
        "orthonormality": float(pairs.orthonormality),
        "n_resolved": int(pairs.resolved.sum()),
        "n_measured": pairs.n_measured,
    }


def finite(value: float) -> float | None:
    """Return a value for JSON: None for infinity, the wavelength of a constant."""
    return value if math.isfinite(value) else None


def more_pairs(pairs: Eigenpairs | None, family: Family) -> str:
    """Return the remedy for truncated columns, or that further pairs are none."""
    if family.divergence:
        return f". {family.divergence}"
    if pairs is not None and pairs.exhausted:
        return f". {pairs.exhausted.rstrip('.')}"
    t_min = getattr(family, "t_min", None)
    limit = ""
    if pairs is not None and t_min is not None:
        _, limit = pairs.within_resolution(Target("time", t_min))
    if limit:
        return f": take more of them (--count). {limit.rstrip('.')}"
    if t_min is not None:
        return ": --count auto takes as many as it needs"
    return ": take more of them (--count, --max-eigenvalue, --wavelength)"


# Meshes ---------------------------------------------------------------------------------------


def linked(options: Namespace) -> list[Path]:
    """Return the meshes of the options; each link is replaced by the files of its segments.

    `InputError` is raised if a link is invalid, or --segment or --lod is given without a link.
    """
    n_links = sum(map(is_link, options.mesh))
    if not n_links and (options.segment or options.lod is not None):
        raise conflicting(
            "--segment and --lod need a link in place of the mesh file, such as"
            " precomputed://gs://bucket/layer",
        )
    if n_links > 1 and options.segment:
        raise conflicting("--segment needs a single link", "run the command once for each link")
    return [
        link_file(parse_link(each, one, options.lod)) if is_link(each) else each
        for each in options.mesh
        for one in (options.segment if is_link(each) and options.segment else [None])
    ]


def expanded(named: Iterable[Path]) -> list[Path]:
    """Replace patterns such as ``*.ply``, which some shells do not expand, by the matching files.

    A path with ``*``, ``?`` or ``[`` is a pattern unless a file of that name exists; ``**`` matches
    any number of folders. `InputError` is raised if no file matches a pattern.
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
            remedy = "check its folder, its spelling and its ending"
            if len(rest.parts) > 1 and not glob.has_magic(rest.parts[0]):
                remedy = f"there is no folder {rest.parts[0]}, check the spelling"
            raise InputError("file-not-found", f"No file matches {name}", remedy)
        paths += sorted(folder / each for each in found)
    return paths


@dataclass(frozen=True)
class Batch:
    """The work of a command on its meshes, in this process or on a cluster."""

    options: Namespace
    work: Work
    #: Whether `work` is called with the repaired mesh, not with the mesh as read.
    repaired: bool
    #: Contents of finished meshes, by index; meshes with the same content are skipped.
    finished: dict[int, Content] = field(default_factory=dict)

    def outcome(self, number: int) -> Outcome:
        """Process one mesh."""
        content = None
        try:
            mesh = read(self.options.mesh[number], self.options)
            content = content_of(mesh) if self.finished else None
            if content and content == self.finished.get(number):
                return Outcome(number, content=content, kept=True)
            own = in_unit(self.options, mesh.unit)
            used = prepared(mesh, self.options) if self.repaired else mesh
            began = time.perf_counter()
            report, said = self.work(used, number, own)
            report.setdefault("seconds", round(time.perf_counter() - began, 3))
            return Outcome(number, report, said, content_of(mesh))
        except (Cancelled, BrokenPipeError):  # these end the command
            raise
        except Exception as fault:  # noqa: BLE001  reported; the next mesh follows
            return self._failed(number, fault, content)

    def _failed(self, number: int, fault: Exception, content: Content | None = None) -> Outcome:
        status, text = _described_fault(fault, shown_path(self.options.mesh[number]))
        return Outcome(number, content=content, status=status, fault=text)

    def outcomes(self, client: Any = None) -> Iterator[list[Outcome]]:
        """Yield lists of outcomes: one mesh at a time, or batches of a cluster in any order."""
        numbers = range(len(self.options.mesh))
        if client is None:
            yield from ([self.outcome(number)] for number in numbers)
            return
        for answers in results_of_tasks(client, self.outcome, numbers):
            yield [
                self._failed(number, result) if isinstance(result, Exception) else result
                for number, result in answers
            ]


def for_each(
    options: Namespace,
    work: Work,
    *,
    repaired: bool = True,
    outputs: Sequence[Path] = (),
    others: Sequence[Path] = (),
) -> int:
    """Call `work` for every mesh, print its reports, and return the exit status.

    A fault of one mesh does not stop the others. `outputs` and `others` are the files that are
    written for each mesh; with `--scheduler` or `--resume` they are listed in a manifest.
    """
    scheduler, resume = (getattr(options, name, None) for name in ("scheduler", "resume"))
    manifest = Manifest(outputs, others, options) if scheduler or resume else None
    finished = manifest.finished() if manifest and resume else {}
    batch = Batch(options, work, repaired, finished)
    with contextlib.ExitStack() as stack:
        bar, client = None, stack.enter_context(connected(scheduler)) if scheduler else None
        if client and len(options.mesh) == 1 and getattr(options, "pieces", None):
            options.client, client = client, None  # the tasks are the pieces of the mesh
        elif client:
            options.jobs = options.jobs or 1  # each worker has cores of its own
            bar = stack.enter_context(progress_bar("meshes"))
        return _reported(options, batch.outcomes(client), manifest, bar)


def _reported(
    options: Namespace,
    outcomes: Iterator[list[Outcome]],
    manifest: Manifest | None,
    bar: ProgressBar | None,
) -> int:
    """Print outcomes as they arrive, and return the status.

    With a manifest, outcomes are also recorded, and faults are printed at the end.
    """
    came: list[Outcome] = []
    failed: list[Outcome] = []
    count = len(options.mesh)
    try:
        for batch in outcomes:
            if manifest is not None:
                manifest.add(each for each in batch if not each.kept)
            came += batch
            failed += [each for each in batch if each.fault]
            with contextlib.nullcontext() if bar is None else bar.hidden():
                for each in batch:
                    if each.fault and manifest is None:
                        say(each.fault)
                    elif not (each.fault or each.kept):
                        print_report(options, options.mesh[each.number], each.report, each.said)
            if bar is not None:
                message = f"{len(came)} of {count}, {len(failed)} failed"
                bar(Progress("meshes", len(came) / count, message=message))
    finally:
        if manifest is not None:
            for each in sorted(failed, key=lambda each: each.number):
                say(each.fault)
            kept = sum(each.kept for each in came)
            before = f", {kept} of them before" if kept else ""
            say(
                f"{len(came) - len(failed)} of {counted(count, 'mesh')} done{before},"
                f" {len(failed)} failed; manifest: {manifest.path}"
            )
    return max((each.status for each in failed), key=_SEVERITY.index, default=0)


def read(path: Path, options: Namespace) -> Mesh:
    """Read a mesh, with the unit and the brain structure of the options."""
    bar = progress_bar(path.stem) if path.suffix == LINK_ENDING else contextlib.nullcontext()
    with bar as progress:
        mesh = read_mesh(path, options.unit, progress=progress)
    structure = getattr(options, "structure", None)  # only commands that write files
    return replace(mesh, structure=structure) if structure else mesh


def prepared(mesh: Mesh, options: Namespace) -> Mesh:
    """Apply the requested repairs and the mask to a mesh."""
    for name in options.repair:
        if effect := repair_effect(mesh, name):
            say(f"{mesh.name}: {name} {effect}.")
        mesh = repair_mesh(mesh, name)
    return mesh if options.mask is None else mesh.masked(read_mask(options.mask, mesh))


def masked_options(options: Namespace) -> list[Namespace]:
    """Return the options for each mesh, with its own mask; "-" is the whole mesh.

    `InputError` is raised unless there are as many masks as meshes, or none.
    """
    masks, count = options.mask or ["-"] * len(options.mesh), len(options.mesh)
    if len(masks) != count:
        fault = f"{counted(len(masks), 'mask')} for {count} meshes"
        remedy = "give each mesh its own, in their order, and - for a whole mesh"
        raise InputError("counts-differ", fault, remedy)
    return [Namespace(**{**vars(options), "mask": None if m == "-" else m}) for m in masks]


def given_landmarks(options: Namespace, first: Mesh, second: Mesh) -> list[tuple[int, int]]:
    """Return the corresponding vertices of two meshes that the options name.

    `InputError` is raised if there are further meshes, or no such vertex.
    """
    if options.landmark and len(options.mesh) > 2:
        fault = f"--landmark is for two meshes, not {len(options.mesh)}"
        raise InputError("too-many", fault, "give each pair of meshes its own command")
    return [(first.vertex_of(here), second.vertex_of(there)) for here, there in options.landmark]


def with_maps(mesh: Mesh, paths: Sequence[Path]) -> Mesh:
    """Add the maps in files to a mesh."""
    for path in paths:
        mesh = mesh.with_maps(*read_maps(path, mesh))
    return mesh


# Computation ----------------------------------------------------------------------------------


def solved(mesh: Mesh, options: Namespace, target: Target) -> Eigenpairs:
    """Return the eigenpairs of a mesh, stored or computed."""
    count, top = target.n_components, target.max_eigenvalue
    with watched(mesh) as callbacks:
        request = Request(count, top, n_jobs=options.jobs, **callbacks)
        pairs, remark = obtain_eigenpairs(
            mesh, chosen_operator(options), request, use_cache=not options.no_cache
        )
        if options.resolution:
            pairs = measure_errors(mesh, pairs, use_cache=not options.no_cache, **callbacks)
    if remark:
        say(remark)
    return pairs.on_mask(options.mask or "")


def progress_bar(of: Mesh | str) -> contextlib.AbstractContextManager[ProgressBar | None]:
    """Return the context of a progress bar, or of None if stderr is no terminal."""
    if sys.stderr.isatty():
        return ProgressBar(of if isinstance(of, str) else of.name, leave=False)
    return contextlib.nullcontext()


@contextlib.contextmanager
def watched(mesh: Mesh) -> Iterator[dict[str, Any]]:
    """Yield the arguments `progress` and `cancel` of a computation.

    The first Ctrl-C makes `cancel` return True; the second raises `KeyboardInterrupt`.
    """
    interrupted = False

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        if interrupted:
            raise KeyboardInterrupt
        interrupted = True

    with progress_bar(mesh) as bar:
        try:
            before = signal.signal(signal.SIGINT, interrupt)
        except ValueError:  # only the main thread receives signals
            yield {"progress": bar, "cancel": None}
            return
        try:
            yield {"progress": bar, "cancel": lambda: interrupted}
            if interrupted:  # Ctrl-C after the last call of `cancel`
                raise KeyboardInterrupt
        finally:
            signal.signal(signal.SIGINT, before)

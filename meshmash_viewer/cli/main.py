"""The command ``meshmash-viewer``: the window, and what can be done without it.

Nothing heavy is imported before the arguments are known to be right. What the user can mend is
said in one line on stderr, with exit status 2; a defect of the program, with 1, names a file of
details. Neither holds up the other meshes of a batch.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshmash_viewer.cli.arguments import (
    FAULT,
    PROGRAM,
    check_pieces,
    check_repairs,
    chosen_family,
    chosen_operator,
    chosen_target,
    command_parser,
    window_parser,
)
from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import Cancelled, ProgressBar
from meshmash_viewer.spectral.engine.compiler import check_compiler
from meshmash_viewer.units import counted

if TYPE_CHECKING:
    import argparse

    from meshmash_viewer.cli.commands import Solver
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.weyl import Target

__all__ = ["main"]

_DEFECT, _INTERRUPTED = 1, 130
#: Columns of a gallery or movie where a family has as many as one likes.
_COLUMNS = 32
#: Of many meshes, the worst status is that of the command.
_SEVERITY = (0, FAULT, _DEFECT)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments after the program's name; those of the process if not given.

    Returns
    -------
    int
        Exit status: 0 well, 1 a defect of the program, 2 something the user can mend, 130
        interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    commands = {
        "info": _info,
        "features": _features,
        "compare": _compare,
        "reconstruct": _reconstruct,
        "render": _render,
        "gallery": _gallery,
        "movie": _movie,
    }
    warnings.showwarning = lambda message, *_: _say(str(message))
    try:
        if arguments and arguments[0] in commands:
            command = commands[arguments[0]]
            options = command_parser().parse_args(arguments)
        else:
            command, options = _window, window_parser().parse_args(arguments)
        check_compiler()
        return command(options)
    except (KeyboardInterrupt, Cancelled):
        _say("interrupted")
        return _INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has left; Python would complain once more while closing it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as fault:  # noqa: BLE001  nobody is shown a traceback
        return _say_fault(fault)


def _say(sentence: str) -> None:
    print(f"{PROGRAM}: {' '.join(sentence.split())}", file=sys.stderr)


def _say_fault(fault: Exception, subject: str = "") -> int:
    """Say what went wrong with a mesh, or with the command; the exit status it comes to."""
    from meshmash_viewer.model.failure import failure_of

    failure = failure_of(fault)
    if not failure.mendable:
        from meshmash_viewer.defects import report_defect

        _say(f"{subject or 'The command'} failed by {report_defect(fault)}")
        return _DEFECT
    said = not subject or subject in failure.text
    _say(failure.text if said else f"{subject}: {failure.text}")
    return FAULT


# Commands -------------------------------------------------------------------------------------


def _window(options: argparse.Namespace) -> int:
    if options.info:
        from meshmash_viewer.app.view.graphics import asked_graphics
        from meshmash_viewer.model.system_report import system_report

        print(system_report(asked_graphics()))
        return 0
    first = options.mesh[0] if options.mesh else ""
    if first.isidentifier() and not os.path.lexists(first):
        raise InputError(
            f"There is neither a command nor a file {first}; the commands are info, features,"
            " compare, render, gallery and movie."
        )
    if (
        sys.platform.startswith("linux")
        and not os.environ.get("DISPLAY")
        and not os.environ.get("WAYLAND_DISPLAY")
        and not os.environ.get("QT_QPA_PLATFORM")
    ):
        raise InputError(
            "There is no display to open a window on; use the commands that need none (see"
            " --help), or run it under xvfb-run."
        )
    if options.unit is not None:
        from meshmash_viewer.units import parse_unit

        parse_unit(options.unit)
    from meshmash_viewer.app.run import run_app

    if options.map and not first:
        raise InputError("--map is of a mesh: name the mesh file before it.")
    path = Path(first) if first else None
    return run_app(path, options.unit or "", options.map, fresh=options.fresh)


def _info(options: argparse.Namespace) -> int:
    from meshmash_viewer.cli.commands import describe

    target = chosen_target(options)

    def work(index: int, mesh: Mesh) -> None:
        about = describe(mesh, target)
        _tell(options, index, {"path": str(options.mesh[index]), **about}, _described(about))

    return _for_each(options, work)


def _features(options: argparse.Namespace) -> int:
    from meshmash_viewer.cli.commands import is_folder, output_paths, write_kind
    from meshmash_viewer.fields import EXPORTS
    from meshmash_viewer.io.atomic import made_folder
    from meshmash_viewer.io.write import check_output

    target, operator = chosen_target(options), chosen_operator(options)
    family = chosen_family(options, EXPORTS)
    outputs = output_paths(options.mesh, options.output, options.kind, f".{options.format}")

    if options.pieces is not None:
        check_pieces(options)

    def work(index: int, mesh: Mesh) -> None:
        if options.pieces is not None:
            _in_pieces(options, index, mesh, outputs[index], family)
            return
        with _solver(options, target, operator, mesh) as solver:
            report = write_kind(
                mesh,
                outputs[index],
                family,
                solver,
                drop_first=options.drop_first,
                tail=options.tail,
                automatic=options.count == "auto",
                component_column=options.component_column,
                maps=options.map,
                own_maps=options.maps,
                repairs=tuple(options.repair),
            )
        said = f"{report['output']}: " + (
            f"{report['proof']} · {_reach(report, mesh)}"
            if "proof" in report
            else counted(report["n_features"], "column")
        )
        _tell(options, index, report, said)

    if options.map and len(options.mesh) > 1:
        raise InputError("--map is of one mesh: name one, or put the values into the mesh files.")
    folder = Path(options.output) if is_folder(options.output) else None
    with made_folder(folder) if folder else contextlib.nullcontext():
        for path in outputs:
            check_output(path, "features" if family.makes_features() else "eigenpairs")
        return _for_each(options, work)


def _in_pieces(
    options: argparse.Namespace, index: int, mesh: Mesh, output: Path, family: Family
) -> None:
    from meshmash_viewer.model.pieces import described_seams, write_in_pieces

    shown = ProgressBar(mesh.name, leave=False) if sys.stderr.isatty() else contextlib.nullcontext()
    with shown as bar, _interruptible() as cancel:
        report = write_in_pieces(
            mesh,
            output,
            family,
            options.pieces,
            chosen_target(options),
            chosen_operator(options),
            n_jobs=options.jobs,
            progress=bar,
            cancel=cancel,
        )
    _tell(options, index, report, f"{report['output']}: {described_seams(report)}")


def _compare(options: argparse.Namespace) -> int:
    from meshmash_viewer.cli.comparison import described_comparison, write_comparison
    from meshmash_viewer.fields import EXPORTS
    from meshmash_viewer.health import repair_mesh
    from meshmash_viewer.io.read import read_mesh
    from meshmash_viewer.io.write import check_output

    check_repairs(options)
    if options.output is not None:
        check_output(options.output, "features")
    target, operator = chosen_target(options), chosen_operator(options)
    family = EXPORTS[options.kind].exported(options.n_components)
    first, second = (
        repair_mesh(read_mesh(path, options.unit), *options.repair) for path in options.mesh
    )
    with _solver(options, target, operator, first) as solver:
        report = write_comparison((first, second), family, solver, options.output)
    _tell(options, 0, report, described_comparison(report))
    return 0


def _reconstruct(options: argparse.Namespace) -> int:
    from meshmash_viewer.cli.reconstruction import described_reconstruction, write_reconstruction
    from meshmash_viewer.io.write import check_output

    target, operator = chosen_target(options), chosen_operator(options)
    check_output(options.output, "mesh")

    def work(index: int, mesh: Mesh) -> None:
        with _solver(options, target, operator, mesh) as solver:
            report = write_reconstruction(mesh, options.output, solver, tuple(options.repair))
        _tell(options, index, report, described_reconstruction(report))

    options.mesh = [options.mesh]
    return _for_each(options, work)


def _render(options: argparse.Namespace) -> int:
    from meshmash_viewer.cli.commands import write_render
    from meshmash_viewer.io.write import check_output

    target, operator = chosen_target(options), chosen_operator(options)
    check_output(options.output, "picture")

    def work(index: int, mesh: Mesh) -> None:
        with _solver(options, target, operator, mesh) as solver:
            report = write_render(
                mesh,
                options.output,
                options.field,
                solver,
                maps=options.map,
                map_name=options.map_name or "",
                index=options.index,
                diffusion_time=options.time,
                n_components=options.n_components,
                transparent=options.transparent,
                **_looks(options),
            )
        reached = f": {_reach(report, mesh)}" if "max_eigenvalue" in report else ""
        _tell(options, index, report, f"{report['output']}{reached}")

    options.mesh = [options.mesh]
    return _for_each(options, work)


def _gallery(options: argparse.Namespace) -> int:
    from meshmash_viewer.cli.series import write_gallery
    from meshmash_viewer.fields.sweep import SWEPT
    from meshmash_viewer.io.write import check_output

    target, operator = chosen_target(options), chosen_operator(options)
    family = chosen_family(options, SWEPT, _COLUMNS)
    check_output(options.output, "picture")

    def work(index: int, mesh: Mesh) -> None:
        with _solver(options, target, operator, mesh) as solver:
            report = write_gallery(
                mesh,
                options.output,
                family,
                solver,
                columns=options.columns,
                maps=options.map,
                transparent=options.transparent,
                **_looks(options),
            )
        pictures = counted(len(report["columns"]), "picture")
        _tell(options, index, report, f"{report['output']}: {pictures}")

    options.mesh = [options.mesh]
    return _for_each(options, work)


def _movie(options: argparse.Namespace) -> int:
    from meshmash_viewer.cli.series import write_movie
    from meshmash_viewer.fields.sweep import SWEPT
    from meshmash_viewer.io.movie import check_movie
    from meshmash_viewer.io.write import check_output
    from meshmash_viewer.model.cost import written_bytes

    target, operator = chosen_target(options), chosen_operator(options)
    check_movie(options.output, options.size, 1.0 if options.rate is None else options.rate)
    family = chosen_family(options, SWEPT, _COLUMNS)
    check_output(options.output, "movie")

    def work(index: int, mesh: Mesh) -> None:
        with _solver(options, target, operator, mesh) as solver:
            report = write_movie(
                mesh,
                options.output,
                family,
                solver,
                columns=options.sweep,
                maps=options.map,
                column=options.column,
                rate=options.rate,
                seconds=options.seconds,
                announce=_say if sys.stderr.isatty() else None,
                **_looks(options),
            )
        length = f"{counted(report['frames'], 'frame')}, {report['seconds']:.4g} s"
        size = written_bytes(report["bytes"])
        _tell(options, index, report, f"{report['output']}: {length}, {size}")

    options.mesh = [options.mesh]
    return _for_each(options, work)


def _looks(options: argparse.Namespace) -> dict[str, Any]:
    """Size and colours of pictures."""
    return {
        "size": options.size,
        "colormap": options.colormap,
        "limits": None if options.limits is None else tuple(options.limits),
        "dark": options.dark,
    }


def _tell(options: argparse.Namespace, index: int, report: dict[str, Any], said: str) -> None:
    """Print what became of a mesh, for people or as JSON."""
    for remark in report.get("remarks", ()):
        _say(f"{options.mesh[index]}: {remark}")
    print(json.dumps(report) if options.json else said, flush=True)


def _reach(report: dict[str, Any], mesh: Mesh) -> str:
    """How far up the spectrum a run went, for people."""
    from meshmash_viewer.units import format_quantity

    reached = f"up to λ = {format_quantity(report['max_eigenvalue'], mesh.unit, -2)}"
    if report["wavelength"] is None:
        return reached
    return f"{reached}, waves of {format_quantity(report['wavelength'], mesh.unit)}"


def _for_each(options: argparse.Namespace, work: Any) -> int:
    """Do the work for every mesh; one that cannot be done does not hold up the others."""
    from meshmash_viewer.health import repair_mesh
    from meshmash_viewer.io.read import read_mesh
    from meshmash_viewer.units import parse_unit

    check_repairs(options)
    if options.unit is not None:
        parse_unit(options.unit)  # wrong for all meshes is said once
    status = 0
    for index, path in enumerate(options.mesh):
        try:
            work(index, repair_mesh(read_mesh(path, options.unit), *options.repair))
        except (Cancelled, BrokenPipeError):  # meant for all of them
            raise
        except Exception as fault:  # noqa: BLE001  it is said, and the next mesh has its turn
            status = max(status, _say_fault(fault, str(path)), key=_SEVERITY.index)
    return status


# While it computes ----------------------------------------------------------------------------


@contextlib.contextmanager
def _solver(
    options: argparse.Namespace, target: Target, operator: OperatorOptions, mesh: Mesh
) -> Iterator[Solver]:
    from meshmash_viewer.cli.commands import Solver

    # A bar on a terminal, nothing in a pipe.
    shown = ProgressBar(mesh.name, leave=False) if sys.stderr.isatty() else contextlib.nullcontext()
    with shown as bar:
        solver = Solver(
            target,
            operator,
            use_cache=not options.no_cache,
            n_jobs=options.jobs,
            progress=bar,
            interruptible=_interruptible,
        )
        yield solver
    if solver.remark:
        _say(solver.remark)


@contextlib.contextmanager
def _interruptible() -> Iterator[Any]:
    """Let Ctrl-C ask the solver to stop, which ends its processes; a second one is not so kind."""
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


def _described(about: dict[str, Any]) -> str:
    """The facts of `describe` for people."""
    from meshmash_viewer.units import NO_VOXEL, format_quantity, written_unit

    unit, weyl = about["unit"], about["weyl"]
    extent = [high - low for low, high in zip(*about["bounds"], strict=True)]
    sizes = " × ".join(f"{side:.4g}" for side in extent)
    signs = {name: "" if name in weyl["exact"] else "≈ " for name in weyl}
    rows = [
        ("vertices", f"{about['n_vertices']:,}"),
        ("triangles", f"{about['n_faces']:,}"),
        ("extent", f"{sizes} {unit}".rstrip()),
        ("area", format_quantity(about["area"], unit, 2)),
        *([("voxel", written_unit(unit, about["voxel"]))] if about["voxel"] != NO_VOXEL else []),
        ("components", f"{about['n_components']:,} (largest {about['largest_component']:,})"),
        ("boundary edges", f"{about['boundary_edges']:,}"),
        ("non-manifold edges", f"{about['nonmanifold_edges']:,}"),
        ("degenerate triangles", f"{about['degenerate_faces']:,}"),
        ("duplicate triangles", f"{about['duplicate_faces']:,}"),
        ("unreferenced vertices", f"{about['unreferenced_vertices']:,}"),
        ("coincident vertices", f"{about['coincident_vertices']:,}"),
        ("median edge", format_quantity(about["median_edge"], unit)),
        ("eigenpairs", f"{signs['n_eigenpairs']}{weyl['n_eigenpairs']:,.0f}"),
        (
            "  up to eigenvalue",
            signs["max_eigenvalue"] + format_quantity(weyl["max_eigenvalue"], unit, -2),
        ),
        (
            "  down to wavelength",
            signs["wavelength"] + format_quantity(weyl["wavelength"], unit),
        ),
    ]
    width = max(len(name) for name, _ in rows)
    title = f"{about['name']} ({unit or 'no unit stated'})"
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in rows)])

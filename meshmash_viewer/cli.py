"""The command ``meshmash-viewer``: the window, and what can be done without it.

Nothing heavy is imported before the arguments are known to be right. What the user can mend is
said in one line on stderr, with exit status 2.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from meshmash_viewer.errors import InputError
from meshmash_viewer.feature_kinds import KINDS
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.units import UNIT_FORMS

if TYPE_CHECKING:
    from meshmash_viewer.commands import Solver
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.weyl import Target

__all__ = ["main"]

PROGRAM = "meshmash-viewer"
_FAULT, _INTERRUPTED = 2, 130
_DEFAULT_COUNT = 200
_FIELDS = ("hks", "eigenfunction", "band", "none")
_FORMATS = ("npz", "npy", "csv", "parquet", "vtp", "ply", "func.gii")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments after the program's name; those of the process if not given.

    Returns
    -------
    int
        Exit status: 0 well, 2 something the user can mend, 130 interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    commands = {"info": _info, "features": _features, "render": _render}
    try:
        if arguments and arguments[0] in commands:
            options = _parser().parse_args(arguments)
            return commands[arguments[0]](options)
        return _window(_window_parser().parse_args(arguments))
    except InputError as fault:
        _say(str(fault))
        return _FAULT
    except (KeyboardInterrupt, Cancelled):
        _say("interrupted")
        return _INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has left; Python would complain once more while closing it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _say(sentence: str) -> None:
    print(f"{PROGRAM}: {' '.join(sentence.split())}", file=sys.stderr)


# Arguments ------------------------------------------------------------------------------------


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as everything here does."""

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message} (see {self.prog} --help)", file=sys.stderr)
        raise SystemExit(_FAULT)


def _window_parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog=PROGRAM,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Open the window, on meshes or a session if given.",
        epilog="commands without a window (each has its own --help):\n"
        f"  {PROGRAM} info MESH...                 health, area, length of the spectrum\n"
        f"  {PROGRAM} features MESH... -o OUT      HKS, geometry vectors, WKS or eigenpairs\n"
        f"  {PROGRAM} render MESH -o OUT.png       a picture\n",
    )
    parser.add_argument("mesh", nargs="*", help="mesh file or session")
    _add_unit(parser)
    parser.add_argument("--fresh", action="store_true", help="ignore stored settings")
    from meshmash_viewer import __version__

    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    return parser


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog=PROGRAM)
    commands = parser.add_subparsers(dest="command", required=True, parser_class=_Parser)

    info = commands.add_parser("info", help="say what a mesh is like")
    info.add_argument("mesh", nargs="+", type=Path)
    _add_unit(info)
    _add_target(info)
    _add_json(info)

    features = commands.add_parser("features", help="compute features of meshes")
    features.add_argument("mesh", nargs="+", type=Path)
    features.add_argument("--kind", choices=tuple(KINDS), default="hks", help="default: hks")
    _add_unit(features)
    _add_target(features)
    features.add_argument(
        "--n-components",
        type=_positive,
        default=32,
        metavar="N",
        help="number of columns, default 32",
    )
    features.add_argument(
        "--t-min",
        type=float,
        metavar="T",
        help="shortest diffusion time (unit²); default by the λ of each mesh, so give both times"
        " where columns of many meshes are to agree",
    )
    features.add_argument("--t-max", type=float, metavar="T", help="longest diffusion time (unit²)")
    features.add_argument("--drop-first", action="store_true", help="leave out the first eigenpair")
    _add_solver(features)
    features.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help="file whose ending is the format ("
        + " ".join(f".{name}" for name in _FORMATS)
        + '), a folder, or a template such as "{name}_{kind}.csv"',
    )
    features.add_argument(
        "--format", choices=_FORMATS, default="npz", help="of the files in a folder, default npz"
    )
    _add_json(features)

    render = commands.add_parser("render", help="draw a picture of a mesh")
    render.add_argument("mesh", type=Path)
    render.add_argument("--field", choices=_FIELDS, default="hks", help="default: hks")
    render.add_argument(
        "--index", type=int, metavar="I", help="which eigenfunction or band, from 0"
    )
    render.add_argument("--time", type=float, metavar="T", help="diffusion time of the HKS (unit²)")
    render.add_argument(
        "--n-components", type=_positive, default=32, metavar="N", help="number of bands"
    )
    _add_unit(render)
    _add_target(render)
    _add_solver(render)
    render.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.png")
    render.add_argument("--size", type=_size, default=(1600, 1200), metavar="WIDTHxHEIGHT")
    render.add_argument("--colormap", metavar="NAME", help="one of matplotlib's")
    render.add_argument("--limits", type=float, nargs=2, metavar=("LOW", "HIGH"))
    render.add_argument("--transparent", action="store_true", help="leave the background out")
    render.add_argument("--dark", action="store_true", help="light text on a dark ground")
    _add_json(render)
    return parser


def _add_unit(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--unit", metavar="U", help=f"of coordinates: {UNIT_FORMS}")


def _add_target(parser: argparse.ArgumentParser) -> None:
    target = parser.add_mutually_exclusive_group()
    target.add_argument(
        "--count", type=int, metavar="K", help=f"number of eigenpairs, default {_DEFAULT_COUNT}"
    )
    target.add_argument(
        "--max-eigenvalue", type=float, metavar="X", help="all eigenvalues up to X (per unit²)"
    )
    target.add_argument(
        "--wavelength", type=float, metavar="W", help="all waves of length W (unit) and longer"
    )


def _add_solver(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--no-robust", action="store_true", help="plain cotangent Laplacian, for clean manifolds"
    )
    parser.add_argument("--mollify-factor", type=float, default=1e-5, metavar="F")
    parser.add_argument(
        "--no-cache", action="store_true", help="neither use nor keep stored eigenpairs"
    )
    parser.add_argument(
        "--jobs", type=_positive, metavar="J", help="processes; default: as many as fit"
    )


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="one line of JSON for each mesh")


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    try:
        size = int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size like 1600x1200") from None
    if not all(1 <= side <= 16384 for side in size):
        raise argparse.ArgumentTypeError(f"{text!r} is not between 1x1 and 16384x16384")
    return size


def _positive(text: str) -> int:
    if not (text.isdecimal() and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1")
    return int(text)


def _target(options: argparse.Namespace) -> Target:
    from meshmash_viewer.weyl import Target

    if options.max_eigenvalue is not None:
        return Target("max_eigenvalue", options.max_eigenvalue)
    if options.wavelength is not None:
        return Target("wavelength", options.wavelength)
    return Target("count", _DEFAULT_COUNT if options.count is None else options.count)


def _operator(options: argparse.Namespace) -> OperatorOptions:
    from meshmash_viewer.laplacian import OperatorOptions

    if not options.mollify_factor >= 0.0:
        raise InputError(
            f"--mollify-factor is {options.mollify_factor}: give zero or a small positive one."
        )
    return OperatorOptions(robust=not options.no_robust, mollify_factor=options.mollify_factor)


def _check_times(options: argparse.Namespace) -> None:
    """Complain of diffusion times now, not after the first decomposition."""
    if options.kind == "hks":
        from meshmash_viewer.filters import get_hks_filter

        get_hks_filter(options.t_max, options.t_min)
    elif options.t_min is not None or options.t_max is not None:
        raise InputError(f"--t-min and --t-max are of --kind hks; {options.kind} has no times.")


# Commands -------------------------------------------------------------------------------------


def _window(options: argparse.Namespace) -> int:
    first = options.mesh[0] if options.mesh else ""
    if first.isidentifier() and not os.path.lexists(first):
        raise InputError(
            f"There is neither a command nor a file {first}; the commands are info, features and"
            " render."
        )
    if (
        sys.platform.startswith("linux")
        and not os.environ.get("DISPLAY")
        and not os.environ.get("WAYLAND_DISPLAY")
        and not os.environ.get("QT_QPA_PLATFORM")
    ):
        raise InputError(
            "There is no display to open a window on; use the commands info, features and render,"
            " or run it under xvfb-run."
        )
    if options.unit is not None:
        from meshmash_viewer.units import parse_unit

        parse_unit(options.unit)
    from meshmash_viewer.app import run_app

    arguments = list(options.mesh)
    arguments += ["--unit", options.unit] if options.unit else []
    arguments += ["--fresh"] if options.fresh else []
    return run_app(arguments)


def _info(options: argparse.Namespace) -> int:
    from meshmash_viewer.commands import describe

    target = _target(options)

    def work(index: int, mesh: Mesh) -> None:
        about = describe(mesh, target)
        if options.json:
            print(json.dumps({"path": str(options.mesh[index]), **about}), flush=True)
        else:
            print(_described(about), flush=True)

    return _for_each(options, work)


def _features(options: argparse.Namespace) -> int:
    from meshmash_viewer.commands import output_paths, write_kind
    from meshmash_viewer.io.write import check_output

    target, operator = _target(options), _operator(options)
    _check_times(options)
    outputs = output_paths(options.mesh, options.output, options.kind, f".{options.format}")
    for path in outputs:
        check_output(path, "eigenpairs" if options.kind == "eigenpairs" else "features")

    def work(index: int, mesh: Mesh) -> None:
        with _solver(options, target, operator, mesh) as solver:
            report = write_kind(
                mesh,
                outputs[index],
                options.kind,
                solver,
                n_components=options.n_components,
                t_min=options.t_min,
                t_max=options.t_max,
                drop_first=options.drop_first,
            )
        if "warning" in report:
            _say(f"{options.mesh[index]}: {report['warning']}")
        if options.json:
            print(json.dumps(report), flush=True)
        else:
            print(f"{report['output']}: {report['proof']}", flush=True)

    return _for_each(options, work)


def _render(options: argparse.Namespace) -> int:
    from meshmash_viewer.commands import write_render
    from meshmash_viewer.io.write import check_output

    target, operator = _target(options), _operator(options)
    check_output(options.output, "picture")

    def work(index: int, mesh: Mesh) -> None:
        with _solver(options, target, operator, mesh) as solver:
            report = write_render(
                mesh,
                options.output,
                options.field,
                solver,
                index=options.index,
                diffusion_time=options.time,
                n_components=options.n_components,
                size=options.size,
                colormap=options.colormap,
                limits=None if options.limits is None else tuple(options.limits),
                transparent=options.transparent,
                dark=options.dark,
            )
        if options.json:
            print(json.dumps(report), flush=True)
        else:
            print(report["output"], flush=True)

    options.mesh = [options.mesh]
    return _for_each(options, work)


def _for_each(options: argparse.Namespace, work: Any) -> int:
    """Do the work for every mesh; one that cannot be done does not hold up the others."""
    from meshmash_viewer.io.read import read_mesh
    from meshmash_viewer.units import parse_unit

    if options.unit is not None:
        parse_unit(options.unit)  # wrong for all meshes is said once
    status = 0
    for index, path in enumerate(options.mesh):
        try:
            work(index, read_mesh(path, options.unit))
        except InputError as fault:
            name = "" if str(path) in str(fault) else f"{path}: "
            _say(f"{name}{fault}")
            status = _FAULT
    return status


# While it computes ----------------------------------------------------------------------------


@contextlib.contextmanager
def _solver(
    options: argparse.Namespace, target: Target, operator: OperatorOptions, mesh: Mesh
) -> Iterator[Solver]:
    from meshmash_viewer.commands import Solver

    with _ProgressBar(mesh.name) as bar:
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


class _ProgressBar:
    """A bar on a terminal, nothing in a pipe; it counts eigenpairs once their number is known."""

    def __init__(self, name: str) -> None:
        self._bar: Any = None
        if sys.stderr.isatty():
            from tqdm import tqdm

            self._bar = tqdm(desc=name, unit=" pairs", leave=False, dynamic_ncols=True)

    def __enter__(self) -> _ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def __call__(self, progress: Progress) -> None:
        if self._bar is None:
            return
        self._bar.set_postfix_str(progress.stage, refresh=False)
        if progress.total and self._bar.total != progress.total:
            self._bar.reset(total=progress.total)
        self._bar.n = progress.converged
        self._bar.refresh()


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
    by_count = weyl["target"] == "count"
    count_sign, bound_sign = ("", "≈ ") if by_count else ("≈ ", "")
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
        ("eigenpairs", f"{count_sign}{weyl['n_eigenpairs']:,.0f}"),
        (
            "  up to eigenvalue",
            bound_sign + format_quantity(weyl["max_eigenvalue"], unit, -2),
        ),
        (
            "  down to wavelength",
            bound_sign + format_quantity(weyl["wavelength"], unit),
        ),
    ]
    width = max(len(name) for name, _ in rows)
    title = f"{about['name']} ({unit or 'no unit stated'})"
    return "\n".join([title, *(f"  {name:<{width}}  {value}" for name, value in rows)])

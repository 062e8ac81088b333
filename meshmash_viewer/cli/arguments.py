"""The arguments of the command ``meshmash-viewer``, and what is asked for with them."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from meshmash_viewer.errors import InputError
from meshmash_viewer.units import UNIT_FORMS

if TYPE_CHECKING:
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.spectral.weyl import Target

__all__ = [
    "FAULT",
    "PROGRAM",
    "check_pieces",
    "check_repairs",
    "chosen_family",
    "chosen_operator",
    "chosen_target",
    "command_parser",
    "window_parser",
]

PROGRAM = "meshmash-viewer"
#: Exit status for what the user can mend.
FAULT = 2
_DEFAULT_COUNT = 200
_FIELDS = ("hks", "eigenfunction", "band", "map", "none")
_FORMATS = ("npz", "npy", "csv", "parquet", "vtp", "ply", "func.gii")


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as everything here does."""

    def error(self, message: str) -> NoReturn:
        self.exit(FAULT, f"{self.prog}: {message} (see {self.prog} --help)\n")


def window_parser() -> argparse.ArgumentParser:
    """For the window: ``meshmash-viewer [MESH ...]``."""
    parser = _Parser(
        prog=PROGRAM,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Open the window, on meshes or a session if given.",
        epilog="commands without a window (each has its own --help):\n"
        f"  {PROGRAM} info MESH...                 health, area, length of the spectrum\n"
        f"  {PROGRAM} features MESH... -o OUT      HKS, geometry vectors, distances …\n"
        f"  {PROGRAM} compare A B [-o OUT]         spectral distance, matches of vertices\n"
        f"  {PROGRAM} render MESH -o OUT.png       a picture\n"
        f"  {PROGRAM} gallery MESH -o OUT.png      many fields side by side\n"
        f"  {PROGRAM} movie MESH -o OUT.mp4        a sweep through fields, or a turn\n",
    )
    parser.add_argument("mesh", nargs="*", help="mesh file or session")
    _add_unit(parser)
    _add_maps(parser)
    parser.add_argument("--fresh", action="store_true", help="ignore stored settings")
    parser.add_argument(
        "--info",
        action="store_true",
        help="say what a report of a fault needs: versions, memory, graphics, stored eigenpairs",
    )
    from meshmash_viewer import __version__

    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    return parser


def command_parser() -> argparse.ArgumentParser:
    """For the commands without a window."""
    parser = _Parser(prog=PROGRAM)
    commands = parser.add_subparsers(dest="command", required=True, parser_class=_Parser)

    info = commands.add_parser("info", help="say what a mesh is like")
    info.add_argument("mesh", nargs="+", type=Path)
    _add_mesh(info)
    _add_target(info)
    _add_json(info)

    features = commands.add_parser("features", help="compute features of meshes")
    features.add_argument("mesh", nargs="+", type=Path)
    from meshmash_viewer.fields import EXPORTS

    features.add_argument("--kind", choices=tuple(EXPORTS), default="hks", help="default: hks")
    _add_mesh(features)
    _add_target(features, automatic=True)
    features.add_argument(
        "--n-components",
        type=_positive,
        metavar="N",
        help="number of columns, default 32; 1 of --kind filter",
    )
    _add_families(features, EXPORTS)
    features.add_argument(
        "--tail",
        choices=("weyl",),
        help="of --kind hks: add what Weyl's law expects of the eigenpairs that are not computed",
    )
    features.add_argument(
        "--component-column",
        action="store_true",
        help="a last column with the connected component of each vertex, from 0",
    )
    features.add_argument(
        "--pieces",
        type=_positive,
        metavar="N",
        help="compute in about N overlapping pieces, for a mesh too large to be solved whole",
    )
    _add_maps(features)
    features.add_argument(
        "--maps",
        action="store_true",
        help="the values per vertex that a mesh file has, as more columns",
    )
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

    compare = commands.add_parser("compare", help="compare two meshes")
    compare.add_argument("mesh", nargs=2, type=Path)
    kinds = tuple(kind for kind, family in EXPORTS.items() if family.counted)
    compare.add_argument(
        "--kind", choices=kinds, default="wks", help="features to match vertices in, default wks"
    )
    compare.add_argument("--n-components", type=_positive, metavar="N", help="number of columns")
    _add_mesh(compare)
    _add_target(compare)
    _add_solver(compare)
    compare.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="OUT",
        help="file for the matches, one row for each vertex of the first mesh",
    )
    _add_json(compare)

    from meshmash_viewer.io.writers import MESH_WRITERS

    rebuilt = commands.add_parser(
        "reconstruct", help="rebuild a mesh from its lowest eigenfunctions: a smoothed shape"
    )
    rebuilt.add_argument("mesh", type=Path)
    _add_mesh(rebuilt)
    _add_target(rebuilt)
    _add_solver(rebuilt)
    rebuilt.add_argument(
        "-o",
        "--output",
        required=True,
        type=Path,
        metavar="OUT",
        help=f"the mesh to write: {' '.join(MESH_WRITERS)}",
    )
    _add_json(rebuilt)

    render = commands.add_parser("render", help="draw a picture of a mesh")
    render.add_argument("mesh", type=Path)
    render.add_argument(
        "--field", choices=_FIELDS, help="default: hks, or the first map if one is given"
    )
    _add_maps(render)
    render.add_argument("--map-name", metavar="NAME", help="which map, of a file or of the mesh")
    render.add_argument(
        "--index", type=int, metavar="I", help="which eigenfunction or band, from 0"
    )
    render.add_argument("--time", type=float, metavar="T", help="diffusion time of the HKS (unit²)")
    render.add_argument(
        "--n-components", type=_positive, default=32, metavar="N", help="number of bands"
    )
    _add_mesh(render)
    _add_target(render)
    _add_solver(render)
    render.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.png")
    _add_looks(render, (1600, 1200))
    render.add_argument("--transparent", action="store_true", help="leave the background out")
    _add_json(render)
    _add_gallery(commands.add_parser("gallery", help="draw many fields of a mesh side by side"))
    _add_movie(commands.add_parser("movie", help="draw a sweep through fields, or a turn"))
    return parser


def _add_gallery(gallery: argparse.ArgumentParser) -> None:
    _add_series(gallery)
    gallery.add_argument(
        "--columns",
        metavar="START:STOP:STEP",
        help="which, from 0 and without STOP, as in Python; default two dozen, evenly spread",
    )
    gallery.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.png")
    _add_looks(gallery, (2400, 1800))
    gallery.add_argument("--transparent", action="store_true", help="leave the background out")
    _add_json(gallery)


def _add_movie(movie: argparse.ArgumentParser) -> None:
    _add_series(movie)
    moves = movie.add_mutually_exclusive_group(required=True)
    moves.add_argument(
        "--sweep",
        metavar="START:STOP:STEP",
        help="through these columns, from 0 and without STOP, as in Python; : is all of them",
    )
    moves.add_argument(
        "--turntable", action="store_true", help="once around the mesh, which shows one column"
    )
    movie.add_argument("--column", type=int, metavar="I", help="which, on the turntable")
    movie.add_argument(
        "--rate",
        type=float,
        metavar="FPS",
        help="frames a second; default as the window plays these fields, 25 on the turntable",
    )
    movie.add_argument(
        "--seconds",
        type=float,
        metavar="S",
        help="how long; default every column once, 6 on the turntable",
    )
    movie.add_argument(
        "-o",
        "--output",
        required=True,
        type=Path,
        metavar="OUT",
        help="file that ends in .mp4, .gif, .webp or .apng",
    )
    _add_looks(movie, (1280, 720))
    _add_json(movie)


def _add_series(parser: argparse.ArgumentParser) -> None:
    """Of which mesh, and which fields."""
    from meshmash_viewer.fields.sweep import SWEPT

    kinds = tuple(SWEPT)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--kind", choices=kinds, default=kinds[0], help=f"default: {kinds[0]}")
    parser.add_argument(
        "--n-components",
        type=_positive,
        metavar="N",
        help="number of columns of the kinds that have as many as one likes, default 32",
    )
    _add_families(parser, SWEPT)
    _add_maps(parser)
    _add_mesh(parser)
    _add_target(parser)
    _add_solver(parser)


def _add_families(parser: argparse.ArgumentParser, table: Mapping[str, type[Family]]) -> None:
    """The options of the families of a table, each once, with the kinds that they are of."""
    kinds: dict[str, list[str]] = {}
    for kind, family in table.items():
        for option in family.options:
            kinds.setdefault(option.name, []).append(kind)
    known = {option.name: option for family in table.values() for option in family.options}
    for name, option in known.items():
        parser.add_argument(
            option.flag,
            type=option.kind,
            choices=option.values,
            metavar=option.metavar,
            action="append" if option.many else "store",
            help=f"of --kind {', '.join(kinds[name])}: {option.about}",
        )


def _add_looks(parser: argparse.ArgumentParser, size: tuple[int, int]) -> None:
    parser.add_argument(
        "--size",
        type=_size,
        default=size,
        metavar="WIDTHxHEIGHT",
        help=f"in pixels, default {size[0]}x{size[1]}",
    )
    parser.add_argument("--colormap", metavar="NAME", help="one of matplotlib's")
    parser.add_argument("--limits", type=float, nargs=2, metavar=("LOW", "HIGH"))
    parser.add_argument("--dark", action="store_true", help="light text on a dark ground")


def _add_unit(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--unit", metavar="U", help=f"of coordinates: {UNIT_FORMS}")


def _add_maps(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="values per vertex of the mesh, from a file; may be given many times",
    )


def _add_mesh(parser: argparse.ArgumentParser) -> None:
    """What is done to each mesh after it was read."""
    _add_unit(parser)
    parser.add_argument(
        "--repair",
        action="append",
        default=[],
        metavar="NAME",
        help="repair the mesh first, in the order given; `info` counts what each would mend",
    )
    parser.add_argument(
        "--largest-component",
        dest="repair",
        action="append_const",
        const="keep_largest_component",
        help="leave out all but the largest connected component",
    )


def _add_target(parser: argparse.ArgumentParser, *, automatic: bool = False) -> None:
    target = parser.add_mutually_exclusive_group()
    target.add_argument(
        "--count",
        type=_count,
        metavar="K",
        help=f"number of eigenpairs, default {_DEFAULT_COUNT}"
        + ("; auto: as many as --t-min needs" if automatic else ""),
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


def _count(text: str) -> int | str:
    if text == "auto":
        return text
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a whole number nor auto") from None


def _positive(text: str) -> int:
    if not (text.isdecimal() and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1")
    return int(text)


def chosen_target(options: argparse.Namespace) -> Target:
    """How much of the spectrum is asked for."""
    from meshmash_viewer.spectral.weyl import Target

    if options.max_eigenvalue is not None:
        return Target("max_eigenvalue", options.max_eigenvalue)
    if options.wavelength is not None:
        return Target("wavelength", options.wavelength)
    if options.count == "auto":
        if getattr(options, "kind", "") != "hks" or options.t_min is None:
            raise InputError(
                "--count auto takes as many eigenpairs as the shortest time of --kind hks needs:"
                " give --t-min, or a number."
            )
        return Target("count", _DEFAULT_COUNT)  # until the mesh is known
    return Target("count", _DEFAULT_COUNT if options.count is None else options.count)


def check_repairs(options: argparse.Namespace) -> None:
    """Complain of repairs that there are none of, before the first mesh is read."""
    from meshmash_viewer.health import REPAIRS

    for name in options.repair:
        if name not in REPAIRS:
            raise InputError(f"There is no repair {name}; the repairs are {', '.join(REPAIRS)}.")


def check_pieces(options: argparse.Namespace) -> None:
    """Complain of what cannot be had in pieces."""
    from meshmash_viewer.fields import EXPORTS

    wrong = {
        "--drop-first": options.drop_first,
        "--tail": options.tail is not None,
        "--count auto": options.count == "auto",
        "--component-column": options.component_column,
        f"--kind {options.kind}": not EXPORTS[options.kind].counted,
    }
    for name, given in wrong.items():
        if given:
            raise InputError(f"{name} is of the whole mesh; leave it out, or --pieces.")


def chosen_operator(options: argparse.Namespace) -> OperatorOptions:
    """The Laplacian that is asked for."""
    from meshmash_viewer.laplacian import OperatorOptions

    if not options.mollify_factor >= 0.0:
        raise InputError(
            f"--mollify-factor is {options.mollify_factor}: give zero or a small positive one."
        )
    return OperatorOptions(robust=not options.no_robust, mollify_factor=options.mollify_factor)


def chosen_family(
    options: argparse.Namespace, table: Mapping[str, type[Family]], n_columns: int | None = None
) -> Family:
    """The family of a table that is asked for; complains now, not after the first decomposition.

    `n_columns` are those of families that have as many as one likes, where nobody says.
    """
    chosen = table[options.kind]
    own = {option.name for option in chosen.options}
    for kind, family in table.items():
        for option in family.options:
            if option.name not in own and getattr(options, option.name) is not None:
                raise InputError(f"{option.flag} is of --kind {kind}, not of {options.kind}.")
    if getattr(options, "tail", None) is not None:
        from meshmash_viewer.features.sums import check_tail

        check_tail(options.tail, chosen.export)
    given = {name: getattr(options, name) for name in own}
    parameters = {name: value for name, value in given.items() if value is not None}
    count = options.n_components
    if count is None and chosen.counted:
        count = n_columns
    return chosen.exported(count, **parameters)

"""Argument parsers of ``meshmash-viewer``, for the window and for commands."""

from __future__ import annotations

import argparse
from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from meshmash_viewer.cli.arguments import (
    FAULT,
    MAPS,
    NO_FIELD,
    mesh_argument,
    option_type,
    options_of,
    quantity,
    signed,
    usual_counts,
    whole,
)
from meshmash_viewer.cli.options import add_options, joined_numbers, target_type
from meshmash_viewer.cli.streams import PROGRAM
from meshmash_viewer.learn import CLASSIFIERS, KINDS

if TYPE_CHECKING:
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.fields.parameter import Parameter
    from meshmash_viewer.spectral.weyl import Target

_FORMATS = ("npz", "npy", "csv", "parquet", "vtp", "ply", "func.gii")
#: Formats of maps and of label sets.
_MAP_FORMATS = (*_FORMATS, "label.gii", "annot")
_DEFAULT_COUNT = 200
_READING = ("--unit", "--segment", "--lod")
_CLUSTER = ("--scheduler", "--resume")

#: Arguments and result of each command without a window.
_COMMANDS = {
    "info": ("MESH...", "size, health, area, number of eigenpairs"),
    "features": ("MESH... -o OUT", "HKS, geometry vectors, distances …"),
    "condense": ("MESH... -o OUT [--graphs DIR/]", "domains of similar HKS, and their graph"),
    "compare": ("A B [-o OUT]", "spectral distance, matches of vertices"),
    "reconstruct": ("MESH -o OUT", "the mesh of its lowest eigenfunctions"),
    "regions": ("MESH --labels L -o OUT", "measures of the connected parts of labels"),
    "points": ("MESH --points FILE -o OUT", "vertices, features and counts of synapses"),
    "carry": ("A B... --labels L -o OUT", "labels and maps of A, carried to other meshes"),
    "train": ("MESH --labels L ... -o OUT.skops", "a model of classes from labels"),
    "predict": ("MESH... --model M -o OUT", "classes by a model"),
    "render": ("MESH -o OUT.png", "a picture"),
    "gallery": ("MESH -o OUT.png", "a picture of many fields"),
    "movie": ("MESH -o OUT.mp4", "a sweep through fields, or a turntable"),
}
COMMANDS = tuple(_COMMANDS)


class _Parser(argparse.ArgumentParser):
    """Argument parser that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(FAULT, f"{self.prog}: {message} (see {self.prog} --help)\n")


#: Help of `--mask` for commands in which every mesh has its own mask.
_MASKS = "solve on a part of each mesh, FILE[:LABEL] as for info, or - for the whole"


def window_parser() -> ArgumentParser:
    """Return the parser for the window: ``meshmash-viewer [MESH ...]``."""
    from meshmash_viewer import __version__

    parser = _Parser(
        prog=PROGRAM,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Open the window, on meshes or a session if given.",
        epilog=f"commands without a window ({PROGRAM} COMMAND --help lists their options):\n"
        + "\n".join(
            f"  {f'{name} {takes}':<41}{about}" for name, (takes, about) in _COMMANDS.items()
        ),
    )
    parser.add_argument("mesh", nargs="*", type=mesh_argument, help="mesh file, session, or link")
    add_options(parser, *_READING, "--map", "--fresh", "--info")
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    return parser


def command_parser() -> ArgumentParser:
    """Return the parser for the commands without a window."""
    from meshmash_viewer.features import MATCHED_COLUMNS, MATCHED_KIND
    from meshmash_viewer.fields import EXPORTS, FEATURES
    from meshmash_viewer.fields.table import SWEPT
    from meshmash_viewer.io.writers import MESH_WRITERS, SPECTRUM_WRITERS

    parser = _Parser(prog=PROGRAM)
    commands = parser.add_subparsers(dest="command", required=True, parser_class=_Parser)

    def command(name: str, about: str, n_meshes: int | None = 1) -> ArgumentParser:
        made: ArgumentParser = commands.add_parser(name, help=about)
        made.add_argument(
            "mesh",
            nargs=1 if n_meshes == 1 else "+",
            type=mesh_argument,
            help='mesh file, a pattern such as "*.ply", or a link to a layer of segments',
        )
        # checked after patterns are expanded
        made.set_defaults(n_meshes=n_meshes)
        add_options(made, *_READING, "--repair", "--largest-component")
        if name == "compare":
            add_options(made, "--mask", nargs=2, metavar=("A", "B"), help=f"{_MASKS}: --mask A B")
        elif name == "carry":
            about = f"{_MASKS}: --mask A --mask B …"
            add_options(made, "--mask", action="append", help=about)
        else:
            add_options(made, "--mask")
        if name not in ("regions", "predict", "condense"):
            _add_target(made, automatic=name == "features")
        if name not in ("info", "regions", "condense"):
            operator = () if name == "predict" else ("--no-robust", "--mollify-factor")
            add_options(made, *operator, "--no-cache", "--jobs", "--resolution")
        return made

    command("info", "print size, health and area of meshes", None)

    features = command("features", "compute features of meshes", None)
    features.add_argument(
        "--kind",
        choices=(*EXPORTS, MAPS),
        default="hks",
        help=f"default: hks; {MAPS}: only the values per vertex of the mesh and of --map",
    )
    _add_families(features, EXPORTS, f"number of columns, {usual_counts(EXPORTS)}")
    add_options(features, "--tail", "--component-column", "--pieces", "--accept-seams", "--maps")
    _add_outputs(features)
    add_options(features, "--whole-mesh", "--map", "--drop-first", "--structure", *_CLUSTER)

    _add_condensing(command("condense", "divide meshes into domains of similar HKS", None))

    compare = command("compare", "compare two meshes", 2)
    kinds = tuple(family.export for family in FEATURES.values())
    compare.add_argument(
        "--kind",
        choices=kinds,
        default=MATCHED_KIND,
        help=f"features to match vertices in, default {MATCHED_KIND}",
    )
    about = f"number of columns, default {MATCHED_COLUMNS}"
    add_options(compare, "--n-components", help=about)
    about = "file for the matches, one row for each vertex of the first mesh"
    _add_output(compare, "OUT", about, required=False)
    add_options(compare, "--refine", "--landmark", "--whole-mesh", "--structure")

    about = "rebuild a mesh from its lowest eigenfunctions: a smoothed shape"
    rebuilt = command("reconstruct", about)
    _add_output(rebuilt, "OUT", f"the mesh to write: {' '.join(MESH_WRITERS)}")
    add_options(rebuilt, "--structure")

    measured = command("regions", "measure the connected parts of labels")
    about = "file of labels, with names or numbers; MAP selects one of several maps"
    add_options(measured, "--labels", help=about, required=True)
    add_options(measured, "--whole-labels", "--map")
    _add_points(measured, required=False)
    _add_output(measured, "OUT", f"table to write: {' '.join(SPECTRUM_WRITERS)}")

    placed = command("points", "project points such as synapses onto the mesh")
    _add_points(placed, required=True)
    placed.add_argument(
        "--kind",
        action="append",
        choices=tuple(kind for kind, family in EXPORTS.items() if family().makes_features()),
        default=[],
        help="features at each point; may be given several times",
    )
    _add_families(placed, EXPORTS, f"number of columns, {usual_counts(EXPORTS)}")
    about = "file of labels: add the label at each point, and print the number of points of each"
    add_options(placed, "--labels", help=f"{about} label")
    placed.set_defaults(tail=None, component_column=False)
    _add_output(placed, "OUT", "table to write: .csv .parquet")
    add_options(placed, "--id-map", "--map", "--drop-first", *_CLUSTER)

    carried = command("carry", "carry labels and maps of the first mesh to the others", None)
    about = "file of labels of the first mesh; MAP selects one of several maps"
    add_options(carried, "--labels", help=about)
    _add_outputs(carried, _MAP_FORMATS)
    add_options(carried, "--map", "--landmark", "--whole-mesh", "--structure")

    _add_training(command("train", "learn classes of vertices from labels", None))
    predicted = command("predict", "predict classes of vertices by a model", None)
    add_options(predicted, "--model", "--domains")
    _add_outputs(predicted, _MAP_FORMATS)
    add_options(predicted, *_CLUSTER, "--whole-mesh", "--structure")

    render = command("render", "draw a picture of a mesh")
    render.add_argument(
        "--field",
        "--kind",
        dest="kind",
        choices=(*SWEPT, NO_FIELD),
        help="default: hks, or the first map if one is given",
    )
    _add_families(render, SWEPT, f"number of columns, {usual_counts(SWEPT, least=2)}")
    about = "file to write, such as .png; .pdf and .svg are figures with vector text"
    _add_output(render, "OUT.png", about)
    _add_looks(render, (1600, 1200))
    add_options(render, "--index", "--map", "--transparent", "--width-mm", "--dpi", "--font-size")

    gallery = command("gallery", "draw many fields of a mesh side by side")
    movie = command("movie", "draw a sweep through fields, or a turntable")
    for drawn in (gallery, movie):
        kind = next(iter(SWEPT))
        drawn.add_argument("--kind", choices=tuple(SWEPT), default=kind, help=f"default: {kind}")
        about = "number of columns of the kinds that have any number"
        _add_families(drawn, SWEPT, f"{about}, {usual_counts(SWEPT, least=2)}")
        add_options(drawn, "--map")
    _add_output(gallery, "OUT.png")
    _add_looks(gallery, (2400, 1800))
    add_options(gallery, "--columns", "--transparent")
    moves = movie.add_mutually_exclusive_group(required=True)
    add_options(moves, "--sweep", "--turntable")
    add_options(movie, "--column", "--rate", "--seconds")
    _add_output(movie, "OUT", "file to write: .mp4 or .gif")
    _add_looks(movie, (1280, 720))
    for each in commands.choices.values():
        add_options(each, "--json")
    return parser


def parsed_command(arguments: list[str]) -> argparse.Namespace:
    """Parse the arguments of a command; meshes of train may also follow its options."""
    parser = command_parser()
    options, others = parser.parse_known_args(joined_numbers(signed(arguments)))
    parser.prog += f" {options.command}"
    if options.command != "train" or any(each.startswith("-") for each in others):
        _refuse(parser, others, options.n_meshes)
    options.mesh += map(mesh_argument, others)
    return options


def parsed_window(arguments: list[str]) -> argparse.Namespace:
    """Parse the arguments for the window."""
    parser = window_parser()
    options, others = parser.parse_known_args(joined_numbers(arguments))
    _refuse(parser, others)
    return options


#: Options of earlier versions, and what to use instead.
_GONE = {"--lambda2": "leave it out, and solve a label by features --kind eigenpairs --mask"}


def _refuse(parser: ArgumentParser, others: list[str], n_meshes: int | None = None) -> None:
    """Exit with an error if there are `others`, the arguments that were not parsed."""
    for option in set(others) & set(_GONE):
        parser.error(f"{option} is no longer an option: {_GONE[option]}")
    if any(each.startswith("-") for each in others):
        parser.error(f"unrecognized arguments: {' '.join(others)}")
    if others:
        many = f"takes one mesh, so {others[0]} is one argument too many: run it once for each mesh"
        late = f"finds {others[0]} after an option: name all meshes together, before the options"
        again = "and repeat an option, such as --map, before each of its values"
        parser.error(f"{many if n_meshes == 1 else late}, {again}")


# Groups of options ----------------------------------------------------------------------------


def _add_families(parser: ArgumentParser, table: Mapping[str, type[Family]], about: str) -> None:
    """Add options for the number of columns and the parameters of families."""
    add_options(parser, "--n-components", help=about)
    kinds: dict[str, list[str]] = {}
    known: dict[str, Parameter] = {}
    for kind, family in table.items():
        for each in options_of(family).values():
            kinds.setdefault(each.option, []).append(kind)
            known[each.option] = each
    for name, each in known.items():
        parser.add_argument(
            each.flag,
            type=option_type(each.parse),
            choices=each.choices,
            metavar=each.metavar,
            action="append" if each.many else "store",
            help=f"for --kind {', '.join(kinds[name])}: {each.help}",
        )


def _add_looks(parser: ArgumentParser, size: tuple[int, int]) -> None:
    about = f"size in pixels, default {size[0]}x{size[1]}"
    add_options(parser, "--size", help=about, default=size)
    add_options(parser, "--colormap", "--limits", "--color-scale", "--dark")


def _add_output(
    parser: ArgumentParser, metavar: str, about: str | None = None, *, required: bool = True
) -> None:
    parser.add_argument("-o", "--output", required=required, type=Path, metavar=metavar, help=about)


def _add_outputs(parser: ArgumentParser, formats: tuple[str, ...] = _FORMATS) -> None:
    """Add the options for one output file per mesh."""
    endings = " ".join(f".{name}" for name in formats)
    about = f"file with the ending of a format ({endings}), a folder, or a template such as"
    about += ' "{name}_{kind}.csv"'
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help=about)
    parser.add_argument(
        "--format",
        choices=formats,
        default="npz",
        help="format of the files in a folder, default npz",
    )


def _add_points(parser: ArgumentParser, *, required: bool) -> None:
    add_options(parser, "--points", required=required)
    add_options(parser, "--position", "--max-distance")
    add_options(parser.add_mutually_exclusive_group(), "--points-unit", "--voxel")


def _add_target(parser: ArgumentParser, *, automatic: bool) -> None:
    """Add the options for `target`; None is as many pairs as the shortest time needs."""
    from meshmash_viewer.spectral.weyl import Target

    def count(text: str) -> Target | None:
        if automatic and text == "auto":
            return None
        try:
            return Target("count", whole(1)(text))
        except ArgumentTypeError as fault:
            raise ArgumentTypeError(f"{fault}{'; or auto' * automatic}") from None

    parser.set_defaults(target=Target("count", _DEFAULT_COUNT))
    pairs = f"number of eigenpairs, default {_DEFAULT_COUNT}"
    pairs += "; auto: the number needed by --t-min" if automatic else ""
    bound, length = target_type("max_eigenvalue", -2), target_type("wavelength", 1)
    group = parser.add_mutually_exclusive_group()
    for flag, parse, metavar, about in (
        ("--count", count, "K", pairs),
        ("--max-eigenvalue", bound, "X", "all eigenvalues up to X (per unit²)"),
        ("--wavelength", length, "W", "all waves of length W (unit) and longer"),
    ):
        group.add_argument(flag, type=parse, metavar=metavar, help=about, dest="target")


def _add_condensing(parser: ArgumentParser) -> None:
    """Add the options of condense; defaults are those of `condensed_hks_pipeline`."""
    about = 'an .npz file, a folder, or a template such as "features/{name}.npz"; header.txt next'
    about += " to it names the columns"
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help=about)
    for flag, power, about in (
        ("--t-min", 2, "shortest diffusion time (unit²), default 50,000 nm²"),
        ("--t-max", 2, "longest diffusion time (unit²), default 2e7 nm²"),
        ("--max-eigenvalue", -2, "all eigenvalues up to X (per unit²), default 1e-5 nm⁻²"),
    ):
        parser.add_argument(flag, type=quantity(power), metavar="X", help=about)
    add_options(parser, "--n-components", help="number of times, default 32")
    add_options(parser, "--graphs", "--reduction", "--distance-threshold", "--min-vertices")
    add_options(parser, "--nucleus", *_CLUSTER, "--jobs")


def _add_training(parser: ArgumentParser) -> None:
    about = "file of labels, with names or numbers; once for each mesh, in the same order"
    add_options(parser, "--labels", help=about, required=True, action="append")
    parser.add_argument(
        "--kind",
        action="append",
        choices=tuple(KINDS),
        help=f"columns to learn from, default hks; may be given several times. {_listed(KINDS)}",
    )
    for flag, end in (("--t-min", "shortest"), ("--t-max", "longest")):
        about = f"{end} diffusion time (unit²); default: from the spectrum of the first mesh"
        parser.add_argument(flag, type=quantity(2), metavar="T", help=about)
    add_options(parser, "--n-components", help="number of times, default 32")
    parser.add_argument(
        "--classifier",
        choices=tuple(CLASSIFIERS),
        default="ensemble",
        help=f"default ensemble; {_listed(CLASSIFIERS)}",
    )
    _add_output(parser, "OUT.skops", "the model to write")
    add_options(parser, "--smoothing", "--drop-first")


def _listed(texts: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {text}" for name, text in texts.items())

"""Argument parsers of ``meshmash-viewer``, for the window and for commands."""

from __future__ import annotations

import argparse
from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from meshmash_viewer.cli.arguments import (
    FAULT,
    MAPS,
    NO_FIELD,
    TargetQuantity,
    mesh_argument,
    number,
    option_type,
    options_of,
    quantity,
    usual_counts,
    whole,
)
from meshmash_viewer.cli.streams import PROGRAM
from meshmash_viewer.errors import InputError
from meshmash_viewer.learn import CLASSIFIERS, KINDS
from meshmash_viewer.quantities import parse_number, parse_quantity, parse_unit
from meshmash_viewer.structures import named_structure
from meshmash_viewer.units import UNIT_FORMS

if TYPE_CHECKING:
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.fields.parameter import Parameter
    from meshmash_viewer.spectral.weyl import Target

_FORMATS = ("npz", "npy", "csv", "parquet", "vtp", "ply", "func.gii")
#: Formats of maps and of label sets.
_MAP_FORMATS = (*_FORMATS, "label.gii", "annot")
_DEFAULT_COUNT = 200

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


def window_parser() -> ArgumentParser:
    """Return the parser for the window: ``meshmash-viewer [MESH ...]``."""
    from meshmash_viewer import __version__

    calls = {f"{PROGRAM} {name} {takes}": about for name, (takes, about) in _COMMANDS.items()}
    parser = _Parser(
        prog=PROGRAM,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Open the window, on meshes or a session if given.",
        epilog="commands without a window (each has its own --help):\n"
        + "\n".join(f"  {call:<47}{about}" for call, about in calls.items()),
    )
    parser.add_argument("mesh", nargs="*", type=mesh_argument, help="mesh file, session, or link")
    _add_shared(parser, *_READING, "--map")
    _switch(parser, "--fresh", "ignore stored settings")
    about = "print versions, memory, graphics and stored eigenpairs, for a report of a fault"
    _switch(parser, "--info", about)
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    return parser


def command_parser() -> ArgumentParser:
    """Return the parser for the commands without a window."""
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
        _add_shared(made, *_READING, "--repair", "--largest-component", "--mask")
        if name not in ("regions", "predict", "condense"):
            _add_target(made, automatic=name == "features")
        if name not in ("info", "regions", "condense"):
            operator = () if name == "predict" else ("--no-robust", "--mollify-factor")
            _add_shared(made, *operator, "--no-cache", "--jobs")
        return made

    command("info", "print size, health and area of meshes", None)

    features = command("features", "compute features of meshes", None)
    features.add_argument(
        "--kind",
        choices=(*EXPORTS, MAPS),
        default="hks",
        help=f"default: hks; {MAPS}: the values per vertex alone, of the mesh and of --map",
    )
    _add_families(features, EXPORTS, f"number of columns, {usual_counts(EXPORTS)}")
    features.add_argument(
        "--tail",
        choices=("weyl",),
        help="for --kind hks: add the contribution of higher eigenpairs expected by Weyl's law",
    )
    about = "add a last column, the connected component of each vertex, from 0"
    _switch(features, "--component-column", about)
    about = "compute in about N overlapping pieces, for a mesh too large to be solved whole"
    _value(features, "--pieces", whole(1), "N", about)
    about = "add the values per vertex of the mesh file as columns"
    _switch(features, "--maps", about)
    _add_outputs(features)
    _add_shared(features, "--whole-mesh", "--map", "--drop-first", "--structure", *_CLUSTER)

    _add_condensing(command("condense", "divide meshes into domains of similar HKS", None))

    compare = command("compare", "compare two meshes", 2)
    kinds = tuple(family.export for family in FEATURES.values())
    compare.add_argument(
        "--kind", choices=kinds, default="wks", help="features to match vertices in, default wks"
    )
    _value(compare, *_COLUMNS, "number of columns")
    about = "match vertices by a functional map from these features, refined by ZoomOut"
    _switch(compare, "--refine", about)
    about = "file for the matches, one row for each vertex of the first mesh"
    _add_output(compare, "OUT", about, required=False)
    _add_shared(compare, "--whole-mesh", "--structure")

    about = "rebuild a mesh from its lowest eigenfunctions: a smoothed shape"
    rebuilt = command("reconstruct", about)
    _add_output(rebuilt, "OUT", f"the mesh to write: {' '.join(MESH_WRITERS)}")
    _add_shared(rebuilt, "--structure")

    measured = command("regions", "measure the connected parts of labels")
    about = "file of labels, with names or numbers; MAP selects one of several maps"
    _value(measured, *_LABELS, about, required=True)
    about = "add the first nonzero eigenvalue of each region, with a free boundary"
    _switch(measured, "--lambda2", about)
    about = "one row for each label, not for each connected part; without neck width and λ₂"
    _switch(measured, "--whole-labels", about)
    _add_points(measured, required=False)
    _add_output(measured, "OUT", f"table to write: {' '.join(SPECTRUM_WRITERS)}")
    _add_shared(measured, "--map")

    placed = command("points", "project points such as synapses onto the mesh")
    _add_points(placed)
    placed.add_argument(
        "--kind",
        action="append",
        choices=tuple(kind for kind, family in EXPORTS.items() if family().makes_features()),
        default=[],
        help="features at each point; may be given several times",
    )
    _add_families(placed, EXPORTS, f"number of columns, {usual_counts(EXPORTS)}")
    _value(
        placed,
        *_LABELS,
        "file of labels: add the label at each point, and print the number of points of each label",
    )
    about = "file for id and vertex of each point, in meshmash's format (id_to_mesh_map)"
    _value(placed, "--id-map", Path, "OUT.npz", about)
    placed.set_defaults(tail=None, component_column=False)
    _add_output(placed, "OUT", "table to write: .csv .parquet")
    _add_shared(placed, "--map", "--drop-first", *_CLUSTER)

    carried = command("carry", "carry labels and maps of the first mesh to the others", None)
    _value(carried, *_LABELS, "file of labels of the first mesh; MAP selects one of several maps")
    _add_outputs(carried, _MAP_FORMATS)
    _add_shared(carried, "--map", "--whole-mesh", "--structure")

    _add_training(command("train", "learn classes of vertices from labels", None))
    predicted = command("predict", "predict classes of vertices by a model", None)
    about = "model written by train, a .skops file"
    _value(predicted, "--model", Path, "FILE", about, required=True)
    about = "file or folder of condensed features: predict one class for each domain"
    _value(predicted, "--domains", str, "FILE", about)
    _add_outputs(predicted, _MAP_FORMATS)
    _add_shared(predicted, *_CLUSTER, "--whole-mesh", "--structure")

    render = command("render", "draw a picture of a mesh")
    render.add_argument(
        "--field",
        "--kind",
        dest="kind",
        choices=(*SWEPT, NO_FIELD),
        help="default: hks, or the first map if one is given",
    )
    _value(render, "--index", whole(), "I", "index of the eigenfunction, band or column, from 0")
    _add_families(render, SWEPT, f"number of columns, {usual_counts(SWEPT, least=2)}")
    _add_output(
        render, "OUT.png", "file to write, such as .png; .pdf and .svg are figures with vector text"
    )
    _add_looks(render, (1600, 1200))
    _add_shared(render, "--map", "--transparent")
    about = "of a figure for a paper, in place of --size; white background unless --transparent"
    _value(render, "--width-mm", number(), "MM", f"width {about}")
    _value(render, "--dpi", whole(1), "N", "pixels per inch of a figure", default=300)
    _value(render, "--font-size", number(), "PT", "font size of a figure in points", default=7.0)

    gallery = command("gallery", "draw many fields of a mesh side by side")
    movie = command("movie", "draw a sweep through fields, or a turntable")
    for drawn in (gallery, movie):
        kind = next(iter(SWEPT))
        drawn.add_argument("--kind", choices=tuple(SWEPT), default=kind, help=f"default: {kind}")
        about = "number of columns of the kinds that have any number"
        _add_families(drawn, SWEPT, f"{about}, {usual_counts(SWEPT, least=2)}")
        _add_shared(drawn, "--map")
    about = "columns to draw, from 0 and without STOP as in Python; default 24, evenly spread"
    _value(gallery, "--columns", str, "START:STOP:STEP", about)
    _add_output(gallery, "OUT.png")
    _add_looks(gallery, (2400, 1800))
    _add_shared(gallery, "--transparent")
    moves = movie.add_mutually_exclusive_group(required=True)
    about = "sweep through columns, from 0 and without STOP as in Python; : for all columns"
    _value(moves, "--sweep", str, "START:STOP:STEP", about)
    _switch(moves, "--turntable", "turn the mesh once around, with one column displayed")
    _value(movie, "--column", whole(), "I", "column displayed on the turntable, from 0")
    about = "frames per second; default: as in the window, 25 on the turntable"
    _value(movie, "--rate", number(), "FPS", about)
    about = "duration; default: every column once, 6 s on the turntable"
    _value(movie, "--seconds", number("s"), "S", about)
    _add_output(movie, "OUT", "file to write: .mp4, .gif, .webp or .apng")
    _add_looks(movie, (1280, 720))
    for each in commands.choices.values():
        _switch(each, "--json", "one line of JSON for each mesh")
    return parser


def parsed_command(arguments: list[str]) -> argparse.Namespace:
    """Parse the arguments of a command; meshes of train may also follow its options."""
    parser = command_parser()
    options, others = parser.parse_known_args(arguments)
    if others and (options.command != "train" or any(each.startswith("-") for each in others)):
        parser.error(f"unrecognized arguments: {' '.join(others)}")
    options.mesh += map(mesh_argument, others)
    return options


# Types of arguments ---------------------------------------------------------------------------


def _scheduler(text: str) -> str:
    kind, _, count = text.partition(":")
    if kind == "local" and not (count.isdecimal() and int(count) > 0):
        raise ArgumentTypeError(f"{text!r} is not local:N with a number of processes")
    return text


def _unit(text: str) -> str:
    parse_unit(text)
    return text


def _repair(name: str) -> str:
    from meshmash_viewer.health import REPAIRS

    if name not in REPAIRS:
        raise InputError(f"There is no repair {name}; the repairs are {', '.join(REPAIRS)}.")
    return name


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    try:
        size = int(width), int(height)
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is not a size like 1600x1200") from None
    if not all(1 <= side <= 16384 for side in size):
        raise ArgumentTypeError(f"{text!r} is not between 1x1 and 16384x16384")
    return size


def _not_negative(text: str) -> float:
    value = parse_number(text, share=True)
    if not value >= 0.0:
        raise InputError(f"{text} is negative: give zero or a small positive number.")
    return value


def _target(
    kind: Literal["max_eigenvalue", "wavelength"], power: int
) -> Callable[[str], Target | TargetQuantity]:
    """Return a parser of targets; a target without a unit is checked at once."""

    def parse(text: str) -> Target | TargetQuantity:
        found = TargetQuantity(kind, parse_quantity(text, power))
        return found if found.quantity.unit else found.in_unit("")

    return option_type(parse)


# Groups of options ----------------------------------------------------------------------------

_READING = ("--unit", "--segment", "--lod")
_CLUSTER = ("--scheduler", "--resume")
#: Flag, type and placeholder of options whose help differs between commands.
_COLUMNS = ("--n-components", whole(1), "N")
_LABELS = ("--labels", str, "FILE[:MAP]")


def _takes(
    kind: Callable[[str], Any], metavar: str | tuple[str, ...], about: str, **more: Any
) -> dict[str, Any]:
    """Return the arguments of `add_argument` for an option that has a value."""
    return {"type": kind, "metavar": metavar, "help": about, **more}


_MANY: dict[str, Any] = {"action": "append", "default": []}
#: Options of several commands with the same help.
_SHARED: dict[str, dict[str, Any]] = {
    "--unit": _takes(option_type(_unit), "U", f"length unit of the coordinates: {UNIT_FORMS}"),
    "--segment": _takes(
        str, "ID", "id of the segment to read from a link; may be given several times", **_MANY
    ),
    "--lod": _takes(
        int, "N", "level of detail of a segment, 0 for the finest (default, unless the mesh is"
        " too large)",
    ),
    "--repair": _takes(
        option_type(_repair), "NAME", "repair the mesh first; may be given several times, in"
        " order. `info` counts the faults that each repair corrects", **_MANY,
    ),
    "--largest-component": {
        "dest": "repair", "action": "append_const", "const": "keep_largest_component",
        "help": "leave out all but the largest connected component",
    },
    "--mask": _takes(
        str, "FILE[:LABEL]", "solve on a part of the vertices; results are NaN elsewhere. The part"
        " is a label, all labels but one (lh.aparc.annot:-unknown), all vertices with a nonzero"
        " value, or a condition ('lh.thickness>0.5', in quotes)",
    ),
    "--mollify-factor": _takes(
        option_type(_not_negative), "F", "mollification of the robust Laplacian, a share of the"
        " mean edge length, default 1e-5", default=1e-5,
    ),
    "--jobs": _takes(whole(1), "J", "number of processes; default: as many as fit into memory"),
    "--map": _takes(
        Path, "FILE", "file of values per vertex; may be given several times", **_MANY
    ),
    "--structure": _takes(
        option_type(named_structure), "NAME", "brain structure in GIFTI files: left, right, or a"
        " name such as CortexLeft; default: that of the mesh file, or of its name (lh.pial)",
    ),
    "--scheduler": _takes(
        _scheduler, "ADDRESS", "compute on the workers of this Dask scheduler, one task a mesh (the"
        " pieces of a single one), or by N processes with local:N; writes a manifest next to the"
        " results",
    ),
}  # fmt: skip
_SHARED |= {
    flag: {"action": "store_true", "help": about}
    for flag, about in {
        "--no-robust": "plain cotangent Laplacian, for clean manifolds",
        "--no-cache": "do not read or store eigenpairs",
        "--drop-first": "leave out the first eigenpair",
        "--whole-mesh": "after repairs: write results at all vertices of the file, NaN at removed"
        " vertices",
        "--resume": "skip meshes with results of the same content and options in the manifest of an"
        " earlier run",
        "--transparent": "transparent background",
    }.items()
}


def _add_shared(parser: ArgumentParser, *flags: str) -> None:
    for flag in flags:
        parser.add_argument(flag, **_SHARED[flag])


def _value(parser: argparse._ActionsContainer, flag: str, *what: Any, **more: Any) -> None:
    """Add an option that has a value, see `_takes`."""
    parser.add_argument(flag, **_takes(*what, **more))


def _switch(parser: argparse._ActionsContainer, flag: str, about: str) -> None:
    parser.add_argument(flag, action="store_true", help=about)


def _add_families(parser: ArgumentParser, table: Mapping[str, type[Family]], about: str) -> None:
    """Add options for the number of columns and the parameters of families."""
    _value(parser, *_COLUMNS, about)
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
    _value(parser, "--size", _size, "WIDTHxHEIGHT", about, default=size)
    _value(parser, "--colormap", str, "NAME", "name of a matplotlib colour map")
    _value(parser, "--limits", number(), ("LOW", "HIGH"), "limits of the colours", nargs=2)
    parser.add_argument(
        "--color-scale",
        choices=("automatic", "linear", "log"),
        default="automatic",
        help="automatic: log if the values are positive and span more than two decades",
    )
    _switch(parser, "--dark", "light text on a dark background")


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


def _add_points(parser: ArgumentParser, *, required: bool = True) -> None:
    about = "table of points, such as synapses: CSV, Parquet or Feather"
    _value(parser, "--points", Path, "FILE", about, required=required)
    about = "name of the position if rows have several, such as pre_pt or ctr_pt_position"
    _value(parser, "--position", str, "NAME", about, default="")
    unit = parser.add_mutually_exclusive_group()
    about = f"length unit of the points: {UNIT_FORMS}; default: that of the mesh"
    _value(unit, "--points-unit", option_type(_unit), "U", about, default="")
    about = "voxel size of points given in voxels, in the unit of the mesh"
    _value(unit, "--voxel", number(), ("X", "Y", "Z"), about, nargs=3)
    about = "largest distance to a vertex (unit); default: 1/100 of the diagonal of the mesh"
    _value(parser, "--max-distance", quantity(1), "L", about)


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
    about = f"number of eigenpairs, default {_DEFAULT_COUNT}"
    about += "; auto: the number needed by --t-min" if automatic else ""
    group = parser.add_mutually_exclusive_group()
    _value(group, "--count", count, "K", about, dest="target")
    about, kind = "all eigenvalues up to X (per unit²)", _target("max_eigenvalue", -2)
    _value(group, "--max-eigenvalue", kind, "X", about, dest="target")
    about, kind = "all waves of length W (unit) and longer", _target("wavelength", 1)
    _value(group, "--wavelength", kind, "W", about, dest="target")


def _add_condensing(parser: ArgumentParser) -> None:
    """Add the options of condense; defaults are those of `condensed_hks_pipeline`."""
    about = 'an .npz file, a folder, or a template such as "features/{name}.npz"; header.txt next'
    about += " to it names the columns"
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help=about)
    _value(
        parser,
        "--graphs",
        str,
        "OUT",
        "file, folder or template of the graph of domains of each mesh",
    )
    for flag, power, about in (
        ("--t-min", 2, "shortest diffusion time (unit²), default 50,000 nm²"),
        ("--t-max", 2, "longest diffusion time (unit²), default 2e7 nm²"),
        ("--max-eigenvalue", -2, "all eigenvalues up to X (per unit²), default 1e-5 nm⁻²"),
    ):
        _value(parser, flag, quantity(power), "X", about)
    _value(parser, *_COLUMNS, "number of times, default 32")
    share, dest = number(share=True), "simplify_target_reduction"
    about = "share of the faces that decimation removes first, default 0.7"
    _value(parser, "--reduction", share, "SHARE", about, dest=dest)
    about = "Ward distance of log-HKS at which clustering stops, default 3"
    _value(parser, "--distance-threshold", number(), "D", about)
    about, dest = (
        "components with fewer vertices are in no domain, default 200",
        "min_vertex_threshold",
    )
    _value(parser, "--min-vertices", whole(), "N", about, dest=dest)
    about = "position of the nucleus in the unit of the mesh; adds a column of distances to it"
    xyz = {"nargs": 3, "dest": "nuc_point"}
    _value(parser, "--nucleus", number(), ("X", "Y", "Z"), about, **xyz)
    _add_shared(parser, *_CLUSTER, "--jobs")


def _add_training(parser: ArgumentParser) -> None:
    about = "file of labels, with names or numbers; once for each mesh, in the same order"
    _value(parser, *_LABELS, about, required=True, action="append")
    parser.add_argument(
        "--kind",
        action="append",
        choices=tuple(KINDS),
        help=f"columns to learn from, default hks; may be given several times. {_listed(KINDS)}",
    )
    for flag, end in (("--t-min", "shortest"), ("--t-max", "longest")):
        about = f"{end} diffusion time (unit²); default: from the spectrum of the first mesh"
        _value(parser, flag, quantity(2), "T", about)
    _value(parser, *_COLUMNS, "number of times, default 32")
    parser.add_argument(
        "--classifier",
        choices=tuple(CLASSIFIERS),
        default="ensemble",
        help=f"default ensemble; {_listed(CLASSIFIERS)}",
    )
    about = "length over which probabilities are smoothed along the surface (unit), default 0"
    _value(parser, "--smoothing", quantity(1), "L", about, default=0.0)
    _add_output(parser, "OUT.skops", "the model to write")
    _add_shared(parser, "--drop-first")


def _listed(texts: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {text}" for name, text in texts.items())

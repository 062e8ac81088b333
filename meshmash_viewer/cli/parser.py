"""Parsers of the command ``meshmash-viewer``, for the window and for its commands."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

from meshmash_viewer.cli.arguments import (
    FAULT,
    FORMATS,
    LABEL_FORMATS,
    MAPS,
    NO_FIELD,
    add_cluster,
    add_columns,
    add_drop_first,
    add_families,
    add_jobs,
    add_labels,
    add_looks,
    add_maps,
    add_output,
    add_outputs,
    add_points,
    add_preparation,
    add_solver,
    add_structure,
    add_switch,
    add_target,
    add_unit,
    add_value,
    add_whole,
    mesh_argument,
    number,
    quantity,
    usual_counts,
    whole,
)
from meshmash_viewer.cli.streams import PROGRAM
from meshmash_viewer.learn import CLASSIFIERS, KINDS

#: Commands without a window: their arguments and result.
_COMMANDS = {
    "info": ("MESH...", "health, area, length of the spectrum"),
    "features": ("MESH... -o OUT", "HKS, geometry vectors, distances …"),
    "condense": ("MESH... -o OUT [--graphs DIR/]", "domains of similar HKS, and their graph"),
    "compare": ("A B [-o OUT]", "spectral distance, matches of vertices"),
    "reconstruct": ("MESH -o OUT", "the mesh of its lowest eigenfunctions"),
    "regions": ("MESH --labels L -o OUT", "connected parts of labels, measured"),
    "points": ("MESH --points FILE -o OUT", "vertex and features of synapses, counts"),
    "carry": ("A B... --labels L -o OUT", "labels and maps of A at the vertices of others"),
    "train": ("MESH --labels L ... -o OUT.skops", "a model of classes from labels"),
    "predict": ("MESH... --model M -o OUT", "classes by a model"),
    "render": ("MESH -o OUT.png", "a picture"),
    "gallery": ("MESH -o OUT.png", "many fields side by side"),
    "movie": ("MESH -o OUT.mp4", "a sweep through fields, or a turn"),
}
COMMANDS = tuple(_COMMANDS)


class _Parser(argparse.ArgumentParser):
    """Argument parser that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(FAULT, f"{self.prog}: {message} (see {self.prog} --help)\n")


def window_parser() -> argparse.ArgumentParser:
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
    add_unit(parser)
    add_maps(parser)
    add_switch(parser, "--fresh", "ignore stored settings")
    about = "say what a report of a fault needs: versions, memory, graphics, stored eigenpairs"
    add_switch(parser, "--info", about)
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    return parser


def command_parser() -> argparse.ArgumentParser:
    """Return the parser for the commands without a window."""
    from meshmash_viewer.fields import EXPORTS, FEATURES
    from meshmash_viewer.fields.table import SWEPT
    from meshmash_viewer.io.writers import MESH_WRITERS, SPECTRUM_WRITERS

    parser = _Parser(prog=PROGRAM)
    commands = parser.add_subparsers(dest="command", required=True, parser_class=_Parser)

    def command(name: str, about: str, n_meshes: int | None = 1) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=about)
        made.add_argument(
            "mesh",
            nargs=1 if n_meshes == 1 else "+",
            type=mesh_argument,
            help='mesh file, a pattern such as "*.ply", or a link to a layer of segments',
        )
        # counted when patterns are expanded
        made.set_defaults(n_meshes=n_meshes)
        add_preparation(made)
        if name not in ("regions", "predict", "condense"):
            add_target(made, automatic=name == "features")
        if name not in ("info", "regions", "condense"):
            add_solver(made, operator=name != "predict")
        return made

    command("info", "say what a mesh is like", None)

    features = command("features", "compute features of meshes", None)
    features.add_argument(
        "--kind",
        choices=(*EXPORTS, MAPS),
        default="hks",
        help=f"default: hks; {MAPS}: the values per vertex alone, of the mesh and of --map",
    )
    add_columns(features, f"number of columns, {usual_counts(EXPORTS)}")
    add_families(features, EXPORTS)
    features.add_argument(
        "--tail",
        choices=("weyl",),
        help="of --kind hks: add what Weyl's law expects of the eigenpairs that are not computed",
    )
    about = "a last column with the connected component of each vertex, from 0"
    add_switch(features, "--component-column", about)
    about = "compute in about N overlapping pieces, for a mesh too large to be solved whole"
    add_value(features, "--pieces", whole(1), "N", about)
    add_whole(features)
    add_maps(features)
    about = "the values per vertex that a mesh file has, as more columns"
    add_switch(features, "--maps", about)
    add_drop_first(features)
    add_outputs(features)
    add_cluster(features)

    _add_condensing(command("condense", "divide meshes into domains of similar HKS", None))

    compare = command("compare", "compare two meshes", 2)
    kinds = tuple(family.export for family in FEATURES.values())
    compare.add_argument(
        "--kind", choices=kinds, default="wks", help="features to match vertices in, default wks"
    )
    add_columns(compare, "number of columns")
    about = "match vertices by a functional map from these features, refined by ZoomOut"
    add_switch(compare, "--refine", about)
    about = "file for the matches, one row for each vertex of the first mesh"
    add_output(compare, "OUT", about, False)
    add_whole(compare)

    rebuilt = command(
        "reconstruct", "rebuild a mesh from its lowest eigenfunctions: a smoothed shape"
    )
    for written in (features, compare, rebuilt):
        add_structure(written)
    add_output(rebuilt, "OUT", f"the mesh to write: {' '.join(MESH_WRITERS)}")

    measured = command("regions", "measure the connected parts of labels")
    about = "labels of vertices, with names or numbers; after a colon which map of several"
    add_labels(measured, about, required=True)
    add_maps(measured)
    about = "the first eigenvalue above zero of each region with a free border"
    add_switch(measured, "--lambda2", about)
    about = "one row a label, not one a connected part; without neck and λ₂"
    add_switch(measured, "--whole-labels", about)
    add_points(measured, required=False)
    add_output(measured, "OUT", f"table to write: {' '.join(SPECTRUM_WRITERS)}")

    placed = command("points", "project points such as synapses onto the mesh")
    add_points(placed)
    placed.add_argument(
        "--kind",
        action="append",
        choices=tuple(kind for kind, family in EXPORTS.items() if family().makes_features()),
        default=[],
        help="features at each point; may be given many times",
    )
    add_columns(placed, f"number of columns, {usual_counts(EXPORTS)}")
    add_families(placed, EXPORTS)
    add_labels(placed, "the label at each point, and counts of each label")
    add_maps(placed)
    add_drop_first(placed)
    about = "id and vertex of each point, as meshmash reads them: id_to_mesh_map"
    add_value(placed, "--id-map", Path, "OUT.npz", about)
    add_output(placed, "OUT", "table to write: .csv .parquet")
    add_cluster(placed)

    carried = command("carry", "carry labels and maps of the first mesh to the others", None)
    add_labels(carried, "labels of the first mesh; after a colon which map of several")
    add_maps(carried)
    add_outputs(carried, (*FORMATS, *LABEL_FORMATS))
    add_whole(carried)
    add_structure(carried)

    _add_training(command("train", "learn classes of vertices from labels", None))
    predicted = command("predict", "predict classes of vertices by a model", None)
    about = "a .skops file that train wrote"
    add_value(predicted, "--model", Path, "FILE", about, required=True)
    about = "condensed features of the mesh, or the folder of them: one class for each domain"
    add_value(predicted, "--domains", str, "FILE", about)
    add_outputs(predicted, (*FORMATS, *LABEL_FORMATS))
    add_cluster(predicted)
    add_whole(predicted)
    add_structure(predicted)

    render = command("render", "draw a picture of a mesh")
    render.add_argument(
        "--field",
        "--kind",
        dest="kind",
        choices=(*SWEPT, NO_FIELD),
        help="default: hks, or the first map if one is given",
    )
    add_maps(render)
    add_value(render, "--index", whole(), "I", "which eigenfunction, band or column, from 0")
    add_columns(render, f"number of columns, {usual_counts(SWEPT, least=2)}")
    add_families(render, SWEPT)
    add_output(render, "OUT.png", "a .pdf or .svg is a figure")
    add_looks(render, (1600, 1200), transparent=True)
    about = "of a figure for a paper, in place of --size: white unless --transparent"
    add_value(render, "--width-mm", number(), "MM", f"width {about}")
    add_value(render, "--dpi", whole(1), "N", "pixels per inch of a figure", default=300)
    about = "of a figure, in points"
    add_value(render, "--font-size", number(), "PT", about, default=7.0)

    gallery = command("gallery", "draw many fields of a mesh side by side")
    movie = command("movie", "draw a sweep through fields, or a turn")
    for drawn in (gallery, movie):
        kind = next(iter(SWEPT))
        drawn.add_argument("--kind", choices=tuple(SWEPT), default=kind, help=f"default: {kind}")
        about = usual_counts(SWEPT, least=2)
        add_columns(drawn, f"number of columns of the kinds that have any number, {about}")
        add_families(drawn, SWEPT)
        add_maps(drawn)
    about = "which, from 0 and without STOP, as in Python; default two dozen, evenly spread"
    add_value(gallery, "--columns", str, "START:STOP:STEP", about)
    add_output(gallery, "OUT.png")
    add_looks(gallery, (2400, 1800), transparent=True)
    moves = movie.add_mutually_exclusive_group(required=True)
    about = "through these columns, from 0 and without STOP, as in Python; : is all of them"
    add_value(moves, "--sweep", str, "START:STOP:STEP", about)
    add_switch(moves, "--turntable", "once around the mesh, which shows one column")
    add_value(movie, "--column", whole(), "I", "which, on the turntable")
    about = "frames a second; default as the window plays these fields, 25 on the turntable"
    add_value(movie, "--rate", number(), "FPS", about)
    about = "how long; default every column once, 6 on the turntable"
    add_value(movie, "--seconds", number("s"), "S", about)
    add_output(movie, "OUT", "file that ends in .mp4, .gif, .webp or .apng")
    add_looks(movie, (1280, 720))
    for each in commands.choices.values():
        add_switch(each, "--json", "one line of JSON for each mesh")
    return parser


def parsed_command(arguments: list[str]) -> argparse.Namespace:
    """Parse the arguments of a command; meshes of train may also follow the labels of others."""
    parser = command_parser()
    options, others = parser.parse_known_args(arguments)
    if others and (options.command != "train" or any(each.startswith("-") for each in others)):
        parser.error(f"unrecognized arguments: {' '.join(others)}")
    options.mesh += map(mesh_argument, others)
    return options


def _add_condensing(parser: argparse.ArgumentParser) -> None:
    """Add the options of condense; defaults are those of `condensed_hks_pipeline`."""
    about = 'an .npz file, a folder, or a template such as "features/{name}.npz"; header.txt next'
    about += " to it names the columns"
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help=about)
    add_value(parser, "--graphs", str, "OUT", "likewise for the graph of domains of each mesh")
    add_cluster(parser)
    for flag, power, about in (
        ("--t-min", 2, "shortest diffusion time (unit²), default 50,000 nm²"),
        ("--t-max", 2, "longest diffusion time (unit²), default 2e7 nm²"),
        ("--max-eigenvalue", -2, "all eigenvalues up to X (per unit²), default 1e-5 nm⁻²"),
    ):
        add_value(parser, flag, quantity(power), "X", about)
    add_columns(parser, "number of times, default 32")
    share, dest = number(share=True), "simplify_target_reduction"
    about = "of the faces to remove before, default 0.7"
    add_value(parser, "--reduction", share, "SHARE", about, dest=dest)
    about = "Ward distance of log-HKS from which domains are separate, default 3"
    add_value(parser, "--distance-threshold", number(), "D", about)
    about, dest = "smaller components are in no domain, default 200", "min_vertex_threshold"
    add_value(parser, "--min-vertices", whole(), "N", about, dest=dest)
    about = "position of the nucleus in the unit of the mesh; its distance is one more column"
    xyz = {"nargs": 3, "dest": "nuc_point"}
    add_value(parser, "--nucleus", number(), ("X", "Y", "Z"), about, **xyz)
    add_jobs(parser)


def _add_training(parser: argparse.ArgumentParser) -> None:
    """Add the options of train."""
    about = "labels of a mesh, with names or numbers; once for each mesh, in the same order"
    add_labels(parser, about, required=True, action="append")
    parser.add_argument(
        "--kind",
        action="append",
        choices=tuple(KINDS),
        help=f"columns to learn from, default hks; may be given many times. {_listed(KINDS)}",
    )
    for flag, end in (("--t-min", "shortest"), ("--t-max", "longest")):
        about = f"{end} diffusion time (unit²); default: from the spectrum of the first mesh"
        add_value(parser, flag, quantity(2), "T", about)
    add_columns(parser, "number of times, default 32")
    add_drop_first(parser)
    parser.add_argument(
        "--classifier",
        choices=tuple(CLASSIFIERS),
        default="ensemble",
        help=f"default ensemble; {_listed(CLASSIFIERS)}",
    )
    about = "length over which probabilities are smoothed (unit), default 0"
    add_value(parser, "--smoothing", quantity(1), "L", about, default=0.0)
    add_output(parser, "OUT.skops", "the model to write")


def _listed(texts: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {text}" for name, text in texts.items())

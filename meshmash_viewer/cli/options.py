"""Options of the commands, and parsers of their values."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError, _ActionsContainer
from collections.abc import Callable, Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from meshmash_viewer.cli.arguments import TargetQuantity, number, option_type, quantity, whole
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filter_responses import MOST_FILTERS
from meshmash_viewer.quantities import (
    parse_number,
    parse_quantity,
    parse_several,
    parse_unit,
    parse_voxel,
    parse_whole,
)
from meshmash_viewer.structures import named_structure
from meshmash_viewer.units import METRES, UNIT_FORMS

if TYPE_CHECKING:
    from meshmash_viewer.spectral.weyl import Target


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
        fault = f"There is no repair {name}"
        raise InputError("unknown-name", fault, f"the repairs are {', '.join(REPAIRS)}")
    return name


def _size(text: str) -> tuple[int, ...]:
    def side(each: str) -> int:
        return parse_whole(each, 1, _LARGEST_SIDE, "The width or height of a picture")

    return parse_several(text.lower(), 2, side, "1600x1200")


def _not_negative(text: str) -> float:
    value = parse_number(text, share=True)
    if not value >= 0.0:
        fault = f"{text} is negative"
        raise InputError("out-of-range", fault, "give zero or a small positive number")
    return value


def _several(
    count: int, parse: Callable[[str], Any], example: str
) -> Callable[[str], tuple[Any, ...]]:
    """Return a parser of values that are separated by spaces or commas."""
    return option_type(lambda text: parse_several(text, count, parse, example))


def target_type(
    kind: Literal["max_eigenvalue", "wavelength"], power: int
) -> Callable[[str], Target | TargetQuantity]:
    """Return a parser of targets; a target without a unit is checked at once."""

    def parse(text: str) -> Target | TargetQuantity:
        found = TargetQuantity(kind, parse_quantity(text, power))
        return found if found.quantity.unit else found.in_unit("")

    return option_type(parse)


def _takes(
    kind: Callable[[str], Any], metavar: str | tuple[str, ...], about: str = "", **more: Any
) -> dict[str, Any]:
    """Return the arguments of `add_argument` for an option that has a value."""
    return {"type": kind, "metavar": metavar, "help": about, **more}


def _switches(**abouts: str) -> dict[str, dict[str, Any]]:
    """Return the arguments of `add_argument` for options without a value."""
    return {
        f"--{name.replace('_', '-')}": {"action": "store_true", "help": about}
        for name, about in abouts.items()
    }


#: Largest width and height of a picture in pixels.
_LARGEST_SIDE = 16384
_MANY: dict[str, Any] = {"action": "append", "default": []}
#: Arguments of `add_argument` by flag. Options without help have another one in each command.
OPTIONS: dict[str, dict[str, Any]] = {
    # meshes
    "--unit": _takes(option_type(_unit), "U", f"length unit of the coordinates: {UNIT_FORMS}"),
    "--segment": _takes(str, "ID", "id of the segment to read from a link; may be given several"
        " times", **_MANY),
    "--lod": _takes(int, "N", "level of detail of a segment, 0 for the finest (default, unless the"
        " mesh is too large)"),
    "--repair": _takes(option_type(_repair), "NAME", "repair the mesh first; may be given several"
        " times, in order. `info` counts the faults that each repair corrects", **_MANY),
    "--largest-component": {
        "dest": "repair", "action": "append_const", "const": "keep_largest_component",
        "help": "leave out all but the largest connected component",
    },
    "--mask": _takes(str, "FILE[:LABEL]", "solve on a part of the vertices; results are NaN"
        " elsewhere. The part is a label, all labels but one (lh.aparc.annot:-unknown), all"
        " vertices with a nonzero value, or a condition ('lh.thickness>0.5', in quotes)"),
    "--map": _takes(Path, "FILE", "file of values per vertex; may be given several times", **_MANY),
    "--labels": _takes(str, "FILE[:MAP]"),
    "--landmark": _takes(_several(2, whole(), "12 40"), "A B", "corresponding vertices"
        " of the first and the second mesh, counted from 0; may be given several times",
        **_MANY),
    "--structure": _takes(option_type(named_structure), "NAME", "brain structure in GIFTI files:"
        " left, right, or a name such as CortexLeft; default: that of the mesh file, or of its name"
        " (lh.pial)"),
    # eigenpairs and features
    "--mollify-factor": _takes(option_type(_not_negative), "F", "mollification of the robust"
        " Laplacian, a share of the mean edge length, default 1e-5", default=1e-5),
    "--jobs": _takes(whole(1), "J", "number of processes; default: as many as fit into memory"),
    "--scheduler": _takes(_scheduler, "ADDRESS", "compute on the workers of this Dask scheduler,"
        " one task per mesh (the pieces of a single one), or by N processes with local:N; writes a"
        " manifest next to the results"),
    "--n-components": _takes(whole(1, MOST_FILTERS), "N"),
    "--tail": {
        "choices": ("weyl",),
        "help": "for --kind hks: add the contribution of higher eigenpairs expected by Weyl's law",
    },
    "--pieces": _takes(whole(1), "N", "compute in about N overlapping pieces, for a mesh too large"
        " to be solved whole"),
    "--accept-seams": {
        "action": "store_true",
        "help": "with --pieces: write features that differ by more than 10 %% where pieces meet",
    },
    # points
    "--points": _takes(Path, "FILE", "table of points, such as synapses: CSV, Parquet or Feather"),
    "--position": _takes(str, "NAME", "name of the position if rows have several, such as pre_pt or"
        " ctr_pt_position", default=""),
    "--points-unit": _takes(option_type(_unit), "U", f"length unit of the points: {UNIT_FORMS};"
        " default: that of the mesh", default=""),
    "--voxel": _takes(option_type(parse_voxel), "X Y Z", "voxel size of points given in voxels,"
        " in the unit of the mesh unless one is given: 4 4 40, 4x4x40, 4 4 40 nm"),
    "--max-distance": _takes(quantity(1), "L", "largest distance to a vertex (unit); default: 1/100"
        " of the diagonal of the mesh"),
    "--id-map": _takes(Path, "OUT.npz", "file for id and vertex of each point, in meshmash's format"
        " (id_to_mesh_map)"),
    # domains
    "--graphs": _takes(str, "OUT", "file, folder or template of the graph of domains of each mesh"),
    "--reduction": _takes(number(share=True), "SHARE", "share of the faces that decimation removes"
        " first, default 0.7", dest="simplify_target_reduction"),
    "--distance-threshold": _takes(number(), "D", "Ward distance of log-HKS at which clustering"
        " stops, default 3"),
    "--min-vertices": _takes(whole(), "N", "components with fewer vertices are in no domain,"
        " default 200", dest="min_vertex_threshold"),
    "--nucleus": _takes(_several(3, parse_quantity, '"4200 1800 350" or "4.2, 1.8, 0.35 µm"'),
        "X Y Z", "position of the nucleus in the unit of the mesh unless one is given; adds a"
        " column of distances to it", dest="nuc_point"),
    # classes
    "--smoothing": _takes(quantity(1), "L", "length over which probabilities are smoothed along the"
        " surface (unit), default 0", default=0.0),
    "--model": _takes(Path, "FILE", "model written by train, a .skops file", required=True),
    "--domains": _takes(str, "FILE", "file or folder of condensed features: predict one class for"
        " each domain"),
    # pictures
    "--index": _takes(whole(), "I", "index of the eigenfunction, band or column, from 0"),
    "--columns": _takes(str, "START:STOP:STEP", "columns to draw, from 0 and without STOP as in"
        " Python; default 24, evenly spread"),
    "--sweep": _takes(str, "START:STOP:STEP", "sweep through columns, from 0 and without STOP as in"
        " Python; : for all columns"),
    "--column": _takes(whole(), "I", "column displayed on the turntable, from 0"),
    "--rate": _takes(number(), "FPS", "frames per second; default: as in the window, 25 on the"
        " turntable"),
    "--seconds": _takes(number("s"), "S", "duration; default: every column once, 6 s on the"
        " turntable"),
    "--size": _takes(option_type(_size), "WIDTHxHEIGHT"),
    "--colormap": _takes(str, "NAME", "name of a matplotlib colour map"),
    "--limits": _takes(_several(2, parse_number, "-1 1"), "LOW HIGH", "limits of the colours"),
    "--color-scale": {
        "choices": ("automatic", "linear", "log"), "default": "automatic",
        "help": "automatic: log if the values are positive and span more than two decades",
    },
    "--width-mm": _takes(number(), "MM", "width of a figure for a paper, in place of --size; white"
        " background unless --transparent"),
    "--dpi": _takes(whole(1), "N", "pixels per inch of a figure", default=300),
    "--font-size": _takes(number(), "PT", "font size of a figure in points", default=7.0),
}  # fmt: skip
OPTIONS |= _switches(
    fresh="ignore stored settings",
    info="print versions, memory, graphics and stored eigenpairs, for a report of a fault",
    no_robust="plain cotangent Laplacian, for clean manifolds",
    no_cache="do not read or store eigenpairs",
    resolution="measure how many eigenvalues the mesh resolves, by solving it with every face cut"
    " in four, which takes several times as long; of a large mesh, only of the lowest ones",
    drop_first="leave out the first eigenpair",
    component_column="add a last column, the connected component of each vertex, from 0",
    maps="add the values per vertex of the mesh file as columns",
    whole_mesh="after repairs: write results at all vertices of the file, NaN at removed vertices",
    resume="skip meshes with results of the same content and options in the manifest of an earlier"
    " run",
    refine="match vertices by a functional map from these features, refined by ZoomOut",
    whole_labels="one row for each label, not for each connected part; without neck width",
    turntable="turn the mesh once around, with one column displayed",
    dark="light text on a dark background",
    transparent="transparent background",
    json="one line of JSON for each mesh",
)


#: Options whose value is several numbers, or a number and a unit, which need no quotes.
_SEVERAL = ("--landmark", "--limits", "--nucleus", "--points-unit", "--size", "--unit", "--voxel")
#: An argument that is numbers, separators or a unit: "4,", "4x4x40nm", "[4", "nm".
_PART = re.compile(r"[-\u2212+\d.,'_eE;:xX×*^⁻⁺⁰¹²³⁴-⁹()\[\]{}]*(?P<unit>[^\W\d_]*)[])}]*,?")


def joined_numbers(arguments: Sequence[str]) -> list[str]:
    """Join the numbers after each option of `_SEVERAL` to one argument: "4", "4", "40" to "4 4 40".

    A first argument without a digit is the whole value.
    """
    found: list[str] = []
    rest = list(arguments)
    while rest:
        found.append(rest.pop(0))
        of_several = any(each.startswith(found[-1]) for each in _SEVERAL)
        if of_several and len(found[-1]) > len("--") and rest and re.search(r"\d", rest[0]):
            parts = list(takewhile(_is_part, rest)) or rest[:1]
            found.append(" ".join(parts))
            del rest[: len(parts)]
    return found


def _is_part(argument: str) -> bool:
    match = _PART.fullmatch(argument)
    return match is not None and match["unit"].replace("μ", "µ") in {"", *METRES}


def add_options(parser: _ActionsContainer, *flags: str, **changes: Any) -> None:
    """Add options of the table; `changes` are arguments of `add_argument` that differ from it."""
    for flag in flags:
        parser.add_argument(flag, **{**OPTIONS[flag], **changes})

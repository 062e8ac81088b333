"""Groups of arguments of the commands, and the objects that they describe."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping
from pathlib import Path
from statistics import mode
from typing import TYPE_CHECKING

from meshmash_viewer.cli import numbers
from meshmash_viewer.cli.numbers import said, whole
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.links import is_link
from meshmash_viewer.learn import CLASSIFIERS, KINDS
from meshmash_viewer.quantities import parse_number, parse_unit
from meshmash_viewer.structures import named_structure
from meshmash_viewer.units import UNIT_FORMS

if TYPE_CHECKING:
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.fields.parameter import Parameter
    from meshmash_viewer.laplacian import OperatorOptions

#: Exit status for faults that the user can correct.
FAULT = 2
_DEFAULT_COUNT = 200
#: What ``features --kind`` takes besides families: the maps alone.
MAPS = "maps"
#: What ``render --field`` takes besides families: the mesh alone.
NO_FIELD = "none"
FORMATS = ("npz", "npy", "csv", "parquet", "vtp", "ply", "func.gii")
#: Formats of labels alone.
LABEL_FORMATS = ("label.gii", "annot")


def add_condensing(parser: argparse.ArgumentParser) -> None:
    """Add the options of condense; defaults are those of `condensed_hks_pipeline`."""
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help='an .npz file, a folder, or a template such as "features/{name}.npz"; header.txt next'
        " to it names the columns",
    )
    parser.add_argument(
        "--graphs", metavar="OUT", help="likewise for the graph of domains of each mesh"
    )
    add_cluster(parser)
    for flag, power, about in (
        ("--t-min", 2, "shortest diffusion time (unit²), default 50,000 nm²"),
        ("--t-max", 2, "longest diffusion time (unit²), default 2e7 nm²"),
        ("--max-eigenvalue", -2, "all eigenvalues up to X (per unit²), default 1e-5 nm⁻²"),
    ):
        parser.add_argument(flag, type=numbers.quantity(power), metavar="X", help=about)
    add_columns(parser, "number of times, default 32")
    parser.add_argument(
        "--reduction",
        dest="simplify_target_reduction",
        type=numbers.number(share=True),
        metavar="SHARE",
        help="of the faces to remove before, default 0.7",
    )
    parser.add_argument(
        "--distance-threshold",
        type=numbers.number(),
        metavar="D",
        help="Ward distance of log-HKS from which domains are separate, default 3",
    )
    parser.add_argument(
        "--min-vertices",
        dest="min_vertex_threshold",
        type=whole(),
        metavar="N",
        help="smaller components are in no domain, default 200",
    )
    parser.add_argument(
        "--nucleus",
        dest="nuc_point",
        type=numbers.number(),
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="position of the nucleus in the unit of the mesh; its distance is one more column",
    )
    _add_jobs(parser)


def add_training(parser: argparse.ArgumentParser) -> None:
    """Add the options of train."""
    parser.add_argument(
        "--labels",
        action="append",
        required=True,
        metavar="FILE[:MAP]",
        help="labels of a mesh, with names or numbers; once for each mesh, in the same order",
    )
    about = "; ".join(f"{kind}: {said}" for kind, said in KINDS.items())
    parser.add_argument(
        "--kind",
        action="append",
        choices=tuple(KINDS),
        help=f"columns to learn from, default hks; may be given many times. {about}",
    )
    for flag, end in (("--t-min", "shortest"), ("--t-max", "longest")):
        parser.add_argument(
            flag,
            type=numbers.quantity(2),
            metavar="T",
            help=f"{end} diffusion time (unit²); default: from the spectrum of the first mesh",
        )
    add_columns(parser, "number of times, default 32")
    parser.add_argument("--drop-first", action="store_true", help="leave out the first eigenpair")
    about = "; ".join(f"{kind}: {said}" for kind, said in CLASSIFIERS.items())
    parser.add_argument(
        "--classifier",
        choices=tuple(CLASSIFIERS),
        default="forest",
        help=f"default forest; {about}",
    )
    parser.add_argument(
        "--smoothing",
        type=numbers.quantity(1),
        default=0.0,
        metavar="L",
        help="length over which probabilities are smoothed (unit), default 0",
    )
    add_output(parser, "OUT.skops", "the model to write")


def add_families(parser: argparse.ArgumentParser, table: Mapping[str, type[Family]]) -> None:
    """Add the options of the families of a table, each once, with the kinds that have it."""
    kinds: dict[str, list[str]] = {}
    known: dict[str, Parameter] = {}
    for kind, family in table.items():
        for each in options_of(family).values():
            kinds.setdefault(each.option, []).append(kind)
            known[each.option] = each
    for name, each in known.items():
        parser.add_argument(
            each.flag,
            type=said(each.parse),
            choices=each.choices,
            metavar=each.metavar,
            action="append" if each.many else "store",
            help=f"of --kind {', '.join(kinds[name])}: {each.help}",
        )


def usual_count(family: type[Family], least: int = 1) -> int:
    """Return the number of columns unless one is given; 32 if that is below a minimum."""
    count = getattr(family(), family.counted)
    return count if count >= least else 32


def usual_counts(table: Mapping[str, type[Family]], least: int = 1) -> str:
    """Describe the numbers of columns: that of most kinds, and of which it is another."""
    counts = {kind: usual_count(each, least) for kind, each in table.items() if each.counted}
    usual = mode(counts.values())
    others = (f"; {count} of --kind {kind}" for kind, count in counts.items() if count != usual)
    return f"default {usual}{''.join(others)}"


def options_of(family: type[Family]) -> dict[str, Parameter]:
    """Return the parameters of a family that are options, by name."""
    return {name: each for name, each in family.declared().items() if each.option}


def add_looks(
    parser: argparse.ArgumentParser, size: tuple[int, int], *, transparent: bool = False
) -> None:
    """Add the appearance of pictures."""
    parser.add_argument(
        "--size",
        type=_size,
        default=size,
        metavar="WIDTHxHEIGHT",
        help=f"in pixels, default {size[0]}x{size[1]}",
    )
    parser.add_argument("--colormap", metavar="NAME", help="one of matplotlib's")
    parser.add_argument("--limits", type=numbers.number(), nargs=2, metavar=("LOW", "HIGH"))
    parser.add_argument(
        "--color-scale",
        choices=("automatic", "linear", "log"),
        default="automatic",
        help="automatic is log where values are positive and span more than two decades",
    )
    parser.add_argument("--dark", action="store_true", help="light text on a dark ground")
    if transparent:
        parser.add_argument("--transparent", action="store_true", help="leave the background out")


def add_columns(parser: argparse.ArgumentParser, about: str, default: int | None = None) -> None:
    """Add the number of columns."""
    parser.add_argument("--n-components", type=whole(1), default=default, metavar="N", help=about)


def add_output(
    parser: argparse.ArgumentParser, metavar: str, about: str | None = None, required: bool = True
) -> None:
    """Add the file that is written."""
    parser.add_argument("-o", "--output", required=required, type=Path, metavar=metavar, help=about)


def add_outputs(parser: argparse.ArgumentParser, formats: tuple[str, ...] = FORMATS) -> None:
    """Add the options for a file each mesh."""
    endings = " ".join(f".{name}" for name in formats)
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help=f"file whose ending is the format ({endings}), a folder, or a template such as"
        ' "{name}_{kind}.csv"',
    )
    parser.add_argument(
        "--format", choices=formats, default="npz", help="of the files in a folder, default npz"
    )


def add_cluster(parser: argparse.ArgumentParser) -> None:
    """Add the options for many meshes, which `for_each` takes with the outputs."""
    parser.add_argument(
        "--scheduler",
        type=_scheduler,
        metavar="ADDRESS",
        help="compute on the workers of this Dask scheduler, one task a mesh (the pieces of a"
        " single one), or by N processes with local:N; writes a manifest next to the results",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="leave out meshes whose results exist, by the manifest of an earlier run: the same"
        " content and options",
    )


def _scheduler(text: str) -> str:
    kind, _, count = text.partition(":")
    if kind == "local" and not (count.isdecimal() and int(count) > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not local:N with a number of processes")
    return text


def mesh_argument(text: str) -> Path | str:
    """A file, or a link, whose two slashes a path would not keep."""
    return text if is_link(text) else Path(text)


def add_unit(parser: argparse.ArgumentParser) -> None:
    """Add the unit of length."""
    parser.add_argument(
        "--unit", type=said(_unit), metavar="U", help=f"of coordinates: {UNIT_FORMS}"
    )
    parser.add_argument(
        "--segment",
        action="append",
        default=[],
        metavar="ID",
        help="of a link: the segment to read; may be given many times",
    )
    parser.add_argument(
        "--lod",
        type=int,
        metavar="N",
        help="of a link: the level of detail, 0 for the finest (default, unless it is too large)",
    )


def add_maps(parser: argparse.ArgumentParser) -> None:
    """Add maps, values per vertex from files."""
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="values per vertex of the mesh, from a file; may be given many times",
    )


def add_preparation(parser: argparse.ArgumentParser) -> None:
    """Add the options for reading and repairing meshes."""
    add_unit(parser)
    parser.add_argument(
        "--repair",
        action="append",
        default=[],
        type=said(_repair),
        metavar="NAME",
        help="repair the mesh first, in the order given; `info` counts what each would correct",
    )
    parser.add_argument(
        "--largest-component",
        dest="repair",
        action="append_const",
        const="keep_largest_component",
        help="leave out all but the largest connected component",
    )
    parser.add_argument(
        "--mask",
        metavar="FILE[:LABEL]",
        help="solve on these vertices only, NaN elsewhere: those of a label, of all others after -"
        " (lh.aparc.annot:-unknown), with a value but zero, or that meet a condition"
        " ('lh.thickness>0.5', in quotes)",
    )


def add_points(parser: argparse.ArgumentParser, *, required: bool = True) -> None:
    """Add the options of a table of points."""
    parser.add_argument(
        "--points",
        required=required,
        type=Path,
        metavar="FILE",
        help="table of points, such as synapses: CSV, Parquet or Feather",
    )
    parser.add_argument(
        "--position",
        default="",
        metavar="NAME",
        help="which position, where a row has several: pre_pt, ctr_pt_position",
    )
    unit = parser.add_mutually_exclusive_group()
    unit.add_argument(
        "--points-unit",
        type=said(_unit),
        default="",
        metavar="U",
        help=f"of the points: {UNIT_FORMS}; default: that of the mesh",
    )
    unit.add_argument(
        "--voxel",
        type=numbers.number(),
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="size of the voxels that the points count, in the unit of the mesh",
    )
    parser.add_argument(
        "--max-distance",
        type=numbers.quantity(1),
        metavar="L",
        help="from a vertex (unit); default a hundredth of the diagonal of the mesh",
    )


def add_structure(parser: argparse.ArgumentParser) -> None:
    """Add the brain structure that a GIFTI file names."""
    parser.add_argument(
        "--structure",
        type=said(named_structure),
        metavar="NAME",
        help="of a brain: left, right, or a name such as CortexLeft, which GIFTI files then state;"
        " default: what the mesh file states, or its name: lh.pial",
    )


def add_whole(parser: argparse.ArgumentParser) -> None:
    """Add whether results are written at all vertices of the file."""
    parser.add_argument(
        "--whole-mesh",
        action="store_true",
        help="after repairs: write results at all vertices of the file, NaN where one is left out",
    )


def add_target(parser: argparse.ArgumentParser, *, automatic: bool = False) -> None:
    """Add the options of `target`; None for as many pairs as the shortest time needs."""
    from meshmash_viewer.spectral.weyl import Target

    def count(text: str) -> Target | None:
        if automatic and text == "auto":
            return None
        try:
            return Target("count", whole(1)(text))
        except argparse.ArgumentTypeError as fault:
            raise argparse.ArgumentTypeError(f"{fault}{'; or auto' * automatic}") from None

    parser.set_defaults(target=Target("count", _DEFAULT_COUNT))
    about = f"number of eigenpairs, default {_DEFAULT_COUNT}"
    about += "; auto: as many as --t-min needs" if automatic else ""
    target = parser.add_mutually_exclusive_group()
    for flag, kind, metavar, text in (
        ("--count", count, "K", about),
        (
            "--max-eigenvalue",
            numbers.target("max_eigenvalue", -2),
            "X",
            "all eigenvalues up to X (per unit²)",
        ),
        (
            "--wavelength",
            numbers.target("wavelength", 1),
            "W",
            "all waves of length W (unit) and longer",
        ),
    ):
        target.add_argument(flag, dest="target", type=kind, metavar=metavar, help=text)


def add_solver(parser: argparse.ArgumentParser, *, operator: bool = True) -> None:
    """Add the options of the operator and the solver."""
    if operator:
        parser.add_argument(
            "--no-robust",
            action="store_true",
            help="plain cotangent Laplacian, for clean manifolds",
        )
        parser.add_argument("--mollify-factor", type=said(_not_negative), default=1e-5, metavar="F")
    parser.add_argument(
        "--no-cache", action="store_true", help="neither use nor keep stored eigenpairs"
    )
    _add_jobs(parser)


def _add_jobs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--jobs", type=whole(1), metavar="J", help="processes; default: as many as fit"
    )


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
        raise argparse.ArgumentTypeError(f"{text!r} is not a size like 1600x1200") from None
    if not all(1 <= side <= 16384 for side in size):
        raise argparse.ArgumentTypeError(f"{text!r} is not between 1x1 and 16384x16384")
    return size


def _not_negative(text: str) -> float:
    value = parse_number(text, share=True)
    if not value >= 0.0:
        raise InputError(f"{text} is negative: give zero or a small positive number.")
    return value


def chosen_operator(options: argparse.Namespace) -> OperatorOptions:
    """Return the requested options of the Laplacian."""
    from meshmash_viewer.laplacian import OperatorOptions

    return OperatorOptions(robust=not options.no_robust, mollify_factor=options.mollify_factor)


def refuse_others(
    options: argparse.Namespace, table: Mapping[str, type[Family]], own: Collection[str]
) -> None:
    """Raise `InputError` if an option of a family is given that is not among `own`."""
    for kind, family in table.items():
        for each in options_of(family).values():
            if each.option not in own and getattr(options, each.option) is not None:
                raise InputError(f"{each.flag} is of --kind {kind}, not of {options.kind}.")


def chosen_family(
    options: argparse.Namespace, table: Mapping[str, type[Family]], least: int = 1
) -> Family:
    """Return the requested family of a table, and check its parameters.

    The options have their quantities in a unit (`numbers.in_unit`). `least` is the least
    number of columns that is a default.
    """
    chosen = table[options.kind]
    own = {name: each.option for name, each in options_of(chosen).items()}
    refuse_others(options, table, own.values())
    if getattr(options, "tail", None) is not None:
        from meshmash_viewer.features.truncation import check_tail

        check_tail(options.tail, chosen.export)
    given = {name: getattr(options, option) for name, option in own.items()}
    parameters = {name: value for name, value in given.items() if value is not None}
    count = options.n_components
    if count is None and chosen.counted:
        count = usual_count(chosen, least)
    return chosen.exported(count, options.mesh_unit, **parameters)

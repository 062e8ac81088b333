"""Groups of arguments of the commands, their numbers and quantities, and what they describe."""

from __future__ import annotations

import argparse
import re
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import mode
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.links import is_link
from meshmash_viewer.quantities import (
    Quantity,
    parse_number,
    parse_quantity,
    parse_unit,
    parse_whole,
)
from meshmash_viewer.structures import named_structure
from meshmash_viewer.units import UNIT_FORMS

if TYPE_CHECKING:
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.fields.parameter import Parameter
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.spectral.weyl import Target

_T = TypeVar("_T")
#: Largest whole number of an option: indices and counts have 32 bits.
_MOST = 2**31 - 1
_NEGATIVE = re.compile(r"\A-(?=[.,]?[0-9][-0-9.,'_eE+×x*^⁻⁺⁰¹²³⁴-⁹ ]*\Z)")


def signed(arguments: list[str]) -> list[str]:
    """Replace the hyphen of negative numbers, as argparse takes "-1e-4" for an option."""
    return [_NEGATIVE.sub("\u2212", each) for each in arguments]


def option_type(parse: Callable[[str], _T]) -> Callable[[str], _T]:
    """Return a function that parses as another one, for argparse: it raises what that expects."""

    def taken(text: str) -> _T:
        try:
            return parse(text)
        except InputError as fault:
            raise ArgumentTypeError(str(fault).rstrip(".")) from None

    return taken


def whole(least: int = 0) -> Callable[[str], int]:
    """Return a parser of whole numbers from a minimum."""
    return option_type(lambda text: parse_whole(text, least, _MOST, "the value"))


def number(unit: str = "", *, share: bool = False) -> Callable[[str], float]:
    """Return a parser of numbers, which may have a unit."""
    return option_type(lambda text: parse_number(text, unit, share=share))


def quantity(power: int) -> Callable[[str], Quantity]:
    """Return a parser of powers of a length, in any unit or in that of each mesh."""
    return option_type(lambda text: parse_quantity(text, power))


@dataclass(frozen=True)
class TargetQuantity:
    """A quantity that becomes a `Target` once the unit of its mesh is known."""

    kind: Literal["max_eigenvalue", "wavelength"]
    quantity: Quantity

    def in_unit(self, unit: str) -> Target:
        """Return the target in a unit of length."""
        from meshmash_viewer.spectral.weyl import Target

        return Target(self.kind, self.quantity.in_unit(unit))


def _target(
    kind: Literal["max_eigenvalue", "wavelength"], power: int
) -> Callable[[str], Target | TargetQuantity]:
    """Return a parser of targets, which checks those without a unit at once."""

    def taken(text: str) -> Target | TargetQuantity:
        found = TargetQuantity(kind, parse_quantity(text, power))
        return found if found.quantity.unit else found.in_unit("")

    return option_type(taken)


def in_unit(options: Namespace, unit: str | None = None) -> Namespace:
    """Convert all quantities of the options to the unit of a mesh, their `mesh_unit`.

    Without one those in a unit of their own are left out, to check the others.
    """
    found = {name: _in_unit(value, unit) for name, value in vars(options).items()}
    return Namespace(**{**found, "mesh_unit": unit})


def _in_unit(value: Any, unit: str | None) -> Any:
    if isinstance(value, Quantity):
        return None if unit is None and value.unit else value.in_unit(unit or "")
    if isinstance(value, TargetQuantity) and unit is not None:
        return value.in_unit(unit)
    return value


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


def add_value(
    parser: argparse._ActionsContainer,
    flag: str,
    kind: Callable[[str], Any],
    metavar: str | tuple[str, ...],
    about: str,
    **more: Any,
) -> None:
    """Add an option that has a value: what parses it, its placeholder, and what it is."""
    parser.add_argument(flag, type=kind, metavar=metavar, help=about, **more)


def add_switch(parser: argparse._ActionsContainer, flag: str, about: str) -> None:
    """Add an option without a value."""
    parser.add_argument(flag, action="store_true", help=about)


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
            type=option_type(each.parse),
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
    about = f"in pixels, default {size[0]}x{size[1]}"
    add_value(parser, "--size", _size, "WIDTHxHEIGHT", about, default=size)
    add_value(parser, "--colormap", str, "NAME", "one of matplotlib's")
    parser.add_argument("--limits", type=number(), nargs=2, metavar=("LOW", "HIGH"))
    parser.add_argument(
        "--color-scale",
        choices=("automatic", "linear", "log"),
        default="automatic",
        help="automatic is log where values are positive and span more than two decades",
    )
    add_switch(parser, "--dark", "light text on a dark ground")
    if transparent:
        add_switch(parser, "--transparent", "leave the background out")


def add_columns(parser: argparse.ArgumentParser, about: str) -> None:
    """Add the number of columns."""
    add_value(parser, "--n-components", whole(1), "N", about)


def add_drop_first(parser: argparse.ArgumentParser) -> None:
    """Add whether the first eigenpair is left out."""
    add_switch(parser, "--drop-first", "leave out the first eigenpair")


def add_labels(parser: argparse.ArgumentParser, about: str, **more: Any) -> None:
    """Add a label set, from a file."""
    add_value(parser, "--labels", str, "FILE[:MAP]", about, **more)


def add_output(
    parser: argparse.ArgumentParser, metavar: str, about: str | None = None, required: bool = True
) -> None:
    """Add the file that is written."""
    parser.add_argument("-o", "--output", required=required, type=Path, metavar=metavar, help=about)


def add_outputs(parser: argparse.ArgumentParser, formats: tuple[str, ...] = FORMATS) -> None:
    """Add the options for a file each mesh."""
    endings = " ".join(f".{name}" for name in formats)
    about = f"file whose ending is the format ({endings}), a folder, or a template such as"
    about += ' "{name}_{kind}.csv"'
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help=about)
    parser.add_argument(
        "--format", choices=formats, default="npz", help="of the files in a folder, default npz"
    )


def add_cluster(parser: argparse.ArgumentParser) -> None:
    """Add the options for many meshes, which `for_each` takes with the outputs."""
    about = "compute on the workers of this Dask scheduler, one task a mesh (the pieces of a"
    about += " single one), or by N processes with local:N; writes a manifest next to the results"
    add_value(parser, "--scheduler", _scheduler, "ADDRESS", about)
    about = "leave out meshes whose results exist, by the manifest of an earlier run: the same"
    add_switch(parser, "--resume", f"{about} content and options")


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
    add_value(parser, "--unit", option_type(_unit), "U", f"of coordinates: {UNIT_FORMS}")
    about = "of a link: the segment to read; may be given many times"
    add_value(parser, "--segment", str, "ID", about, action="append", default=[])
    about = "of a link: the level of detail, 0 for the finest (default, unless it is too large)"
    add_value(parser, "--lod", int, "N", about)


def add_maps(parser: argparse.ArgumentParser) -> None:
    """Add maps, values per vertex from files."""
    about = "values per vertex of the mesh, from a file; may be given many times"
    add_value(parser, "--map", Path, "FILE", about, action="append", default=[])


def add_preparation(parser: argparse.ArgumentParser) -> None:
    """Add the options for reading and repairing meshes."""
    add_unit(parser)
    about = "repair the mesh first, in the order given; `info` counts what each would correct"
    add_value(parser, "--repair", option_type(_repair), "NAME", about, action="append", default=[])
    parser.add_argument(
        "--largest-component",
        dest="repair",
        action="append_const",
        const="keep_largest_component",
        help="leave out all but the largest connected component",
    )
    about = "solve on these vertices only, NaN elsewhere: those of a label, of all others after -"
    about += " (lh.aparc.annot:-unknown), with a value but zero, or that meet a condition"
    add_value(parser, "--mask", str, "FILE[:LABEL]", f"{about} ('lh.thickness>0.5', in quotes)")


def add_points(parser: argparse.ArgumentParser, *, required: bool = True) -> None:
    """Add the options of a table of points."""
    about = "table of points, such as synapses: CSV, Parquet or Feather"
    add_value(parser, "--points", Path, "FILE", about, required=required)
    about = "which position, where a row has several: pre_pt, ctr_pt_position"
    add_value(parser, "--position", str, "NAME", about, default="")
    unit = parser.add_mutually_exclusive_group()
    about = f"of the points: {UNIT_FORMS}; default: that of the mesh"
    add_value(unit, "--points-unit", option_type(_unit), "U", about, default="")
    about = "size of the voxels that the points count, in the unit of the mesh"
    add_value(unit, "--voxel", number(), ("X", "Y", "Z"), about, nargs=3)
    about = "from a vertex (unit); default a hundredth of the diagonal of the mesh"
    add_value(parser, "--max-distance", quantity(1), "L", about)


def add_structure(parser: argparse.ArgumentParser) -> None:
    """Add the brain structure that a GIFTI file names."""
    about = "of a brain: left, right, or a name such as CortexLeft, which GIFTI files then state;"
    about += " default: what the mesh file states, or its name: lh.pial"
    add_value(parser, "--structure", option_type(named_structure), "NAME", about)


def add_whole(parser: argparse.ArgumentParser) -> None:
    """Add whether results are written at all vertices of the file."""
    about = "after repairs: write results at all vertices of the file, NaN where one is left out"
    add_switch(parser, "--whole-mesh", about)


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
    group = parser.add_mutually_exclusive_group()
    add_value(group, "--count", count, "K", about, dest="target")
    about, kind = "all eigenvalues up to X (per unit²)", _target("max_eigenvalue", -2)
    add_value(group, "--max-eigenvalue", kind, "X", about, dest="target")
    about, kind = "all waves of length W (unit) and longer", _target("wavelength", 1)
    add_value(group, "--wavelength", kind, "W", about, dest="target")


def add_solver(parser: argparse.ArgumentParser, *, operator: bool = True) -> None:
    """Add the options of the operator and the solver."""
    if operator:
        add_switch(parser, "--no-robust", "plain cotangent Laplacian, for clean manifolds")
        kind = option_type(_not_negative)
        parser.add_argument("--mollify-factor", type=kind, default=1e-5, metavar="F")
    add_switch(parser, "--no-cache", "neither use nor keep stored eigenpairs")
    add_jobs(parser)


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add the number of processes."""
    add_value(parser, "--jobs", whole(1), "J", "processes; default: as many as fit")


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


def made_with(options: argparse.Namespace, kind: str, target: Target, proof: str) -> dict[str, Any]:
    """Return `export_options` of a result of some kind."""
    from meshmash_viewer.io.provenance import export_options

    return export_options(
        kind, chosen_operator(options), target, proof, options.repair,
        whole_mesh=getattr(options, "whole_mesh", False), mask=options.mask,
    )  # fmt: skip


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

    The options have their quantities in a unit (`in_unit`). `least` is the least
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

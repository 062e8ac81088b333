"""The commands render, gallery and movie, which write pictures without a window."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from meshmash_viewer.cli.arguments import NO_FIELD, chosen_family, in_unit, options_of
from meshmash_viewer.cli.batch import (
    Report,
    for_each,
    more_pairs,
    pairs_report,
    progress_bar,
    reach,
    solved,
    with_maps,
)
from meshmash_viewer.errors import InputError, conflicting
from meshmash_viewer.features.filters import heat_kernel_bank
from meshmash_viewer.features.truncation import missing_sentence
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.bank_columns import BankFamily
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.table import (
    SWEPT,
    chosen_columns,
    evenly,
    film,
    n_columns,
    n_frames,
    sweep,
)
from meshmash_viewer.io.movie import TURN_RATE, TURN_SECONDS, check_movie, movie_file
from meshmash_viewer.io.write import check_output, write_picture
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.field import FieldRequest, LiveFeatures
from meshmash_viewer.model.limits import LockedLimits
from meshmash_viewer.progress import Progress, ProgressBar
from meshmash_viewer.spectral.cost import written_bytes
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import counted

#: Default number of pictures of a gallery, and least default number of columns of a family.
_PICTURES, _LEAST = 24, 2
_AS_IT_COMES = {name: family() for name, family in FAMILIES.items()}


# render ---------------------------------------------------------------------------------------


def render(options: Namespace) -> int:
    """Draw a picture of each mesh."""
    check_output(options.output, "figure")
    if options.kind is None:
        options.kind = OwnMaps.name if options.map or options.map_name else HeatKernelSignature.name
    elif options.map and options.kind != OwnMaps.name:
        raise conflicting(f"--map is for --field {OwnMaps.name}, not for {options.kind}")
    _drawn(in_unit(options))
    return for_each(options, lambda mesh, _, own: _write_render(mesh, own))


def _write_render(mesh: Mesh, options: Namespace) -> Report:
    from meshmash_viewer.app.view.picture import draw_picture, new_drawing
    from meshmash_viewer.app.view.series import compute_shot, shots_of

    report: dict[str, Any] = {"mesh": mesh.name, "output": str(options.output)}
    report["field"] = options.kind
    values, shown = None, dict[str, Any]()
    mesh, own = with_maps(mesh, options.map), len(mesh.maps)
    if options.map and not options.map_name:  # by default the first map of the file
        options.map_name = mesh.maps[own].name
    family = _drawn(options)
    if family is not None:
        family = family.at_vertices(mesh.vertex_of)
        spectrum = _solved(mesh, family, options, report)
        if options.index is not None:
            most = n_columns(family, spectrum)
            if options.index >= most:
                fault = f"There is no {options.kind} {options.index} among {most}"
                remedy = "lower --index or ask for more columns or eigenpairs"
                raise InputError("out-of-range", fault, remedy)
            family = sweep(family, spectrum, range(options.index, options.index + 1))[0]
        elif not options_of(type(family)):
            family = family.for_other_mesh(mesh.n_components)
        shot = shots_of([family], spectrum, mesh, mesh.area_sample(), _AS_IT_COMES)[0]
        display = _display(options, [shot.request])
        field = compute_shot(shot, display, LiveFeatures())
        assert field is not None
        if options.kind == OwnMaps.name:
            report["map"] = field.title
        elif said := _missing(spectrum, field.family, mesh):
            report["remarks"] = [f"{said}{more_pairs(spectrum, field.family)}."]
        limits, colormap = field.colors(display)
        values = field.values
        report |= {"limits": list(limits[:2]), "log_scale": limits.logarithmic}
        shown = {
            "colormap": colormap,
            "limits": limits,
            "quantity": f"{field.title}: {field.quantity}",
            "unit": field.unit,
            "formula": field.family.definition,
        }
    shown |= {"title": mesh.name, "dark": options.dark}
    drawing = new_drawing(mesh, values, **shown)
    if options.width_mm is not None or options.output.suffix.lower() != ".png":
        from meshmash_viewer.app.view.figure import FigureOptions, compose_figure, save_figure

        figure = FigureOptions(
            width_mm=options.width_mm or 85.0,
            dpi=options.dpi,
            font_points=options.font_size,
            background="transparent" if options.transparent else "white",
        )
        save_figure(compose_figure([drawing], figure), options.output)
    else:
        write_picture(options.output, draw_picture(drawing, options.size, options.transparent))
    reached = f": {reach(report, mesh)}" if "max_eigenvalue" in report else ""
    return report, f"{options.output}{reached}"


def _drawn(options: Namespace) -> Family | None:
    """Check the options; return the requested family, None for a mesh without a field."""
    _policy(options)
    if options.kind == NO_FIELD:
        return None
    if options.kind != HeatKernelSignature.name or options.time is None:
        return chosen_family(options, SWEPT, _LEAST)
    if options.index is not None:
        raise conflicting("--time and --index both choose a column", "leave one out")
    heat_kernel_bank([options.time])  # raises for an invalid time
    family = chosen_family(Namespace(**{**vars(options), "time": None}), SWEPT, _LEAST)
    assert isinstance(family, HeatKernelSignature)
    return replace(family, time=options.time)


def _missing(spectrum: Eigenpairs, family: Family, mesh: Mesh) -> str:
    """Describe the share of the columns of a family that is missing for lack of eigenpairs."""
    if not isinstance(family, BankFamily):
        return ""
    if isinstance(family, HeatKernelSignature):
        bank = heat_kernel_bank([family.time or 0.0])
    else:
        bank = family.bank(spectrum.eigenvalues)
    return missing_sentence(bank.columns, spectrum.missing_shares(bank, mesh.area))


# gallery and movie ----------------------------------------------------------------------------


def gallery(options: Namespace) -> int:
    """Draw columns of a family of fields side by side."""
    _chosen_swept(in_unit(options))
    check_output(options.output, "picture")
    return for_each(options, lambda mesh, _, own: _write_gallery(mesh, _chosen_swept(own), own))


def _write_gallery(mesh: Mesh, family: Family, options: Namespace) -> Report:
    from meshmash_viewer.app.view.picture import straight
    from meshmash_viewer.app.view.series import (
        ContactSheet,
        aspect,
        draw_series,
        series_view,
        shots_of,
    )

    mesh, family, spectrum, report = _swept(mesh, family, options)
    most, columns = n_columns(family, spectrum), options.columns
    chosen = evenly(most, _PICTURES) if columns is None else chosen_columns(columns, most)
    drawing = _drawing(mesh, options)
    drawing.annotated = False
    families = sweep(family, spectrum, chosen)
    shots = shots_of(families, spectrum, mesh, mesh.area_sample(), _AS_IT_COMES)
    requests = [each.request for each in shots if each.request is not None]
    titles = {each.description.title for each in requests}
    title = titles.pop() if len(titles) == 1 else family.label
    sheet = ContactSheet(
        [each.caption for each in requests],
        options.size,
        aspect(drawing),
        f"{mesh.name} · {title}" if mesh.name else title,
        dark=options.dark,
        ground="" if options.transparent else None,
    )
    drawing.view = series_view(drawing, sheet.picture_size)
    display = _display(options, requests)
    series = draw_series(drawing, sheet.picture_size, shots, display, transparent=True)
    with progress_bar(mesh) as bar:
        for at, picture in enumerate(series):
            assert drawing.caption is not None
            sheet.put(at, straight(picture), drawing.caption)
            _show(bar, at + 1, len(shots), "pictures")
    write_picture(options.output, sheet.pixels())
    report |= {"columns": list(chosen), "size": list(options.size)}
    return report, f"{options.output}: {counted(len(chosen), 'picture')}"


def movie(options: Namespace) -> int:
    """Write a movie of the columns of a family, or of the turning mesh."""
    check_movie(options.output, options.size, 1.0 if options.rate is None else options.rate)
    _chosen_swept(in_unit(options))
    check_output(options.output, "movie")
    return for_each(options, lambda mesh, _, own: _write_movie(mesh, _chosen_swept(own), own))


def _write_movie(mesh: Mesh, family: Family, options: Namespace) -> Report:
    from meshmash_viewer.app.view.series import (
        Shot,
        compute_shot,
        draw_series,
        series_view,
        shots_of,
        show_shot,
        turntable,
    )

    path, size = options.output, options.size
    mesh, family, spectrum, report = _swept(mesh, family, options)
    most = n_columns(family, spectrum)
    drawing = _drawing(mesh, options)
    rate, seconds, column = options.rate, options.seconds, options.column
    if options.sweep is not None:
        if column is not None:
            raise conflicting("--column is for --turntable", "give the columns with --sweep")
        columns = chosen_columns(options.sweep, most)
        families, rate = film(family, spectrum, columns, rate, seconds)
        shots = shots_of(families, spectrum, mesh, mesh.area_sample(), _AS_IT_COMES)
        display = _display(options, [each.request for each in shots])
    else:
        rate = TURN_RATE if rate is None else rate
        count = n_frames(rate, TURN_SECONDS if seconds is None else seconds)
        # without options, the default of the family for this mesh
        shown = family if options_of(type(family)) else family.for_other_mesh(mesh.n_components)
        if column is not None:
            shown = sweep(family, spectrum, chosen_columns(str(column), most))[0]
        one = shots_of([shown], spectrum, mesh, mesh.area_sample(), _AS_IT_COMES)[0]
        display = _display(options, [one.request])
        show_shot(drawing, one, compute_shot(one, display, LiveFeatures()), display)
        view = series_view(drawing, size, turning=True)
        shots = [Shot(view=each) for each in turntable(drawing, view, count)]
    check_movie(path, size, rate)
    length = f"{counted(len(shots), 'frame')}, {len(shots) / rate:.4g} s"
    with progress_bar(mesh) as bar, movie_file(path, size, rate) as add:
        for done, frame in enumerate(draw_series(drawing, size, shots, display), 1):
            add(frame)
            _show(bar, done, len(shots), "frames")
    report |= {
        "frames": len(shots),
        "rate": rate,
        "seconds": len(shots) / rate,
        "size": list(size),
        "bytes": path.stat().st_size,
    }
    return report, f"{path}: {length}, {written_bytes(report['bytes'])}"


def _chosen_swept(options: Namespace) -> Family:
    _policy(options)
    return chosen_family(options, SWEPT, _LEAST)


def _swept(
    mesh: Mesh, family: Family, options: Namespace
) -> tuple[Mesh, Family, Eigenpairs, dict[str, Any]]:
    """Return the mesh with maps, the family for this mesh, eigenpairs, and the report."""
    mesh = with_maps(mesh, options.map)
    family = family.at_vertices(mesh.vertex_of)
    report: dict[str, Any] = {"mesh": mesh.name, "output": str(options.output), "kind": family.name}
    return mesh, family, _solved(mesh, family, options, report), report


def _solved(mesh: Mesh, family: Family, options: Namespace, report: dict[str, Any]) -> Eigenpairs:
    """Return the eigenpairs that the family needs, and complete the report."""
    family.check_mesh(mesh)
    if not family.of_pairs:
        return Eigenpairs.without_pairs(mesh)
    pairs = solved(mesh, options, options.target)
    report |= pairs_report(pairs, mesh)
    return replace(pairs, mesh=mesh)


# shared by the commands ------------------------------------------------------------------------


def _policy(options: Namespace) -> LockedLimits | None:
    """Return the requested colour limits."""
    if options.limits is None:
        return None
    low, high = options.limits
    if not low < high:
        fault = f"The limits {low:g} and {high:g} leave no range"
        raise InputError("bounds-swapped", fault, "swap them")
    return LockedLimits(low, high)


def _display(options: Namespace, requests: Sequence[FieldRequest | None]) -> Display:
    """Return the limits and colour map of all pictures."""
    display, policy = Display(), _policy(options)
    for key in (each.family.limits_key for each in requests if each is not None):
        display.set_limits(policy, key)
        if options.color_scale != "automatic":
            display.set_log_scale(options.color_scale == "log", key)
    if options.colormap:
        display.sequential_colormap = display.diverging_colormap = options.colormap
    return display


def _drawing(mesh: Mesh, options: Namespace) -> Any:
    """Return a `MeshRenderer` with the mesh."""
    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer

    drawing = MeshRenderer(options.dark)
    drawing.set_mesh(mesh, mesh.vertex_normals)
    return drawing


def _show(bar: ProgressBar | None, done: int, of: int, what: str) -> None:
    if bar is not None:
        bar(Progress(what, done / of, message=f"{done} of {of} {what}"))

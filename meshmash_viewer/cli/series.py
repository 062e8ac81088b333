"""Galleries and movies without a window: many pictures of one mesh from one command."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshmash_viewer.cli.commands import with_maps
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.fields.sweep import chosen_columns, evenly, film, n_columns, n_frames, sweep
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Progress
from meshmash_viewer.units import counted

if TYPE_CHECKING:
    from meshmash_viewer.cli.commands import Solver

__all__ = ["write_gallery", "write_movie"]

#: Pictures of a gallery of which it is not said which.
_PICTURES = 24
#: Frames that the size of a movie is told from.
_MEASURED = 6
_AS_IT_COMES = {name: family() for name, family in FAMILIES.items()}


def write_gallery(
    mesh: Mesh,
    path: Path,
    family: Family,
    solver: Solver,
    *,
    columns: str | None = None,
    maps: Sequence[Path] = (),
    size: tuple[int, int] = (2400, 1800),
    colormap: str | None = None,
    limits: tuple[float, float] | None = None,
    transparent: bool = False,
    dark: bool = False,
) -> dict[str, Any]:
    """Draw columns of a family of fields side by side.

    Parameters
    ----------
    mesh : Mesh
    path : Path
        Ends in ".png".
    family : Family
        One of `meshmash_viewer.fields.sweep.SWEPT`, with its parameters.
    solver : Solver
    columns : str, optional
        "START:STOP:STEP" as in Python; None takes some two dozen, evenly spread.
    maps : sequence of Path
        Files with more maps of the mesh.
    size : (int, int)
        Of the sheet in pixels.
    colormap, limits, transparent, dark
        See `meshmash_viewer.app.view.picture.render_picture`.

    Returns
    -------
    dict
        JSON-able report.
    """
    from meshmash_viewer.app.view.contact_sheet import ContactSheet
    from meshmash_viewer.app.view.series import aspect, draw_series, series_view, shots_of
    from meshmash_viewer.io.write import write_picture

    mesh = with_maps(mesh, maps)
    spectrum, report = _solved(mesh, path, family, solver)
    most = n_columns(family, spectrum)
    chosen = evenly(most, _PICTURES) if columns is None else chosen_columns(columns, most)
    drawing, look = _drawing(mesh, colormap, limits, dark)
    drawing.annotated = False
    families = sweep(family, spectrum, chosen)
    shots = shots_of(families, spectrum, mesh, mesh.area_sample(), _AS_IT_COMES)
    requests = [each.request for each in shots if each.request is not None]
    captions = [each.caption for each in requests]
    titles = {each.family.title() for each in requests}
    title = titles.pop() if len(titles) == 1 else family.label
    title = f"{mesh.name} · {title}" if mesh.name else title
    sheet = ContactSheet(captions, size, aspect(drawing), title, dark=dark, transparent=transparent)
    drawing.view = series_view(drawing, sheet.picture_size)
    series = draw_series(drawing, sheet.picture_size, shots, look, transparent=True)
    for at, (_, picture) in enumerate(series):
        assert drawing.caption is not None
        sheet.put(at, picture.rgba(), drawing.caption)
        _tell(solver, at + 1, len(shots), "pictures")
    write_picture(path, sheet.pixels())
    return {**report, "columns": list(chosen), "size": list(size)}


def write_movie(
    mesh: Mesh,
    path: Path,
    family: Family,
    solver: Solver,
    *,
    columns: str | None = None,
    maps: Sequence[Path] = (),
    column: int | None = None,
    rate: float | None = None,
    seconds: float | None = None,
    size: tuple[int, int] = (1280, 720),
    colormap: str | None = None,
    limits: tuple[float, float] | None = None,
    dark: bool = False,
    announce: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Film a sweep through the columns of a family, or a turn of the mesh.

    Parameters
    ----------
    mesh : Mesh
    path : Path
        With one of `meshmash_viewer.io.movie.MOVIE_ENDINGS`.
    family, solver, maps, size, colormap, limits, dark
        See `write_gallery`.
    columns : str, optional
        "START:STOP:STEP" of the sweep; None turns the mesh.
    column : int, optional
        Which one is on it while it turns; None takes one that is not constant.
    rate, seconds : float, optional
        Frames a second, and length; see `meshmash_viewer.fields.sweep.film`.
    announce : callable, optional
        Told how long and how large the movie will be once a few frames are drawn.

    Returns
    -------
    dict
        JSON-able report.
    """
    from meshmash_viewer.app.view.series import (
        Shot,
        draw_series,
        dressed,
        series_view,
        shots_of,
        turntable,
    )
    from meshmash_viewer.io.movie import (
        TURN_RATE,
        TURN_SECONDS,
        check_movie,
        estimated_bytes,
        movie_file,
    )
    from meshmash_viewer.model.cost import written_bytes
    from meshmash_viewer.model.field import LiveFeatures

    mesh = with_maps(mesh, maps)
    spectrum, report = _solved(mesh, path, family, solver)
    most = n_columns(family, spectrum)
    drawing, look = _drawing(mesh, colormap, limits, dark)
    if columns is not None:
        if column is not None:
            raise InputError("--column is of --turntable; a sweep has those that it goes through.")
        families, rate = film(family, spectrum, chosen_columns(columns, most), rate, seconds)
        shots = shots_of(families, spectrum, mesh, mesh.area_sample(), _AS_IT_COMES)
    else:
        rate = TURN_RATE if rate is None else rate
        count = n_frames(rate, TURN_SECONDS if seconds is None else seconds)
        # what was asked for stays; of eigenfunctions the first that is not constant is shown
        shown = family if family.options else family.for_other_mesh(mesh.n_components)
        if column is not None:
            shown = sweep(family, spectrum, chosen_columns(str(column), most))[0]
        one = shots_of([shown], spectrum, mesh, mesh.area_sample(), _AS_IT_COMES)[0]
        dressed(one, look, LiveFeatures(), drawing).put_on(drawing)
        view = series_view(drawing, size, turning=True)
        shots = [Shot(view=each) for each in turntable(drawing, view, count)]
    check_movie(path, size, rate)
    length = f"{counted(len(shots), 'frame')}, {len(shots) / rate:.4g} s"
    frames: Iterator[Any] = (
        picture.pixels for _, picture in draw_series(drawing, size, shots, look)
    )
    if announce is not None:
        first = list(islice(frames, _MEASURED))
        about = estimated_bytes(path.suffix.lower(), first, rate, len(shots))
        announce(f"{length}, about {written_bytes(about)}")
        frames = chain(first, frames)
    with movie_file(path, size, rate, len(shots)) as add:
        for done, frame in enumerate(frames, 1):
            add(frame)
            _tell(solver, done, len(shots), "frames")
    return {
        **report,
        "frames": len(shots),
        "rate": rate,
        "seconds": len(shots) / rate,
        "size": list(size),
        "bytes": path.stat().st_size,
    }


def _solved(
    mesh: Mesh, path: Path, family: Family, solver: Solver
) -> tuple[Spectrum, dict[str, Any]]:
    """The eigenpairs, if the family is made of any, and what is reported of them."""
    family.check_mesh(mesh)
    report: dict[str, Any] = {"mesh": mesh.name, "output": str(path), "kind": family.name}
    if not family.of_pairs:
        return Spectrum.without_pairs(mesh), report
    pairs = solver(mesh)
    spectrum = Spectrum(
        pairs.eigenvalues,
        pairs.rows,
        pairs.residuals,
        total=pairs.n_components,
        certificate=pairs.certificate,
        operator=solver.operator,
        mesh=mesh,
    )
    report["proof"] = pairs.proof(mesh.unit)
    report["max_eigenvalue"] = float(pairs.eigenvalues[-1])
    return spectrum, report


def _drawing(
    mesh: Mesh,
    colormap: str | None,
    limits: tuple[float, float] | None,
    dark: bool,
) -> tuple[Any, Any]:
    """A `MeshRenderer` with the mesh, and the `Look` of all pictures."""
    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
    from meshmash_viewer.app.view.series import Look
    from meshmash_viewer.model.display import Display
    from meshmash_viewer.model.limits import LockedLimits

    if limits is not None and not limits[0] < limits[1]:
        raise InputError(f"The limits {limits[0]:g} and {limits[1]:g} leave no range: swap them.")
    usual = Display()
    policy = LockedLimits(*limits) if limits else None
    both = colormap or usual.sequential_colormap, colormap or usual.diverging_colormap
    drawing = MeshRenderer(dark)
    drawing.set_mesh(mesh, mesh.vertex_normals)
    return drawing, Look(both[0], policy, diverging=both[1])


def _tell(solver: Solver, done: int, of: int, what: str) -> None:
    if solver.progress is not None:
        solver.progress(Progress(what, done / of, message=f"{done} of {of} {what}"))

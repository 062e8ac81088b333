from __future__ import annotations

import numpy as np
import pytest
import shapes

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.nodal_lines import (
    level_lines,
    line_lengths,
    nodal_lines,
    nodal_segments,
)


def length(segments: np.ndarray) -> float:
    return float(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum())


def test_a_plane_cuts_a_sphere_in_a_circle() -> None:
    sphere = shapes.icosphere(5)
    segments = nodal_lines(sphere.vertices, sphere.faces, sphere.vertices[:, 2] - 0.3)
    np.testing.assert_allclose(segments[..., 2], 0.3, atol=1e-12)
    assert abs(length(segments) - 2 * np.pi * np.sqrt(1 - 0.09)) < 5e-3


def test_lines_on_a_closed_surface_are_closed(rng: np.random.Generator) -> None:
    sphere = shapes.icosphere(3)
    segments = nodal_lines(sphere.vertices, sphere.faces, rng.standard_normal(sphere.n_vertices))
    _, count = np.unique(segments.reshape(-1, 3).round(9), axis=0, return_counts=True)
    assert len(segments)
    assert (count % 2 == 0).all()


def test_zeros_at_vertices_leave_no_gap() -> None:
    # The equator of an icosphere runs along edges, and its values there are exactly zero.
    sphere = shapes.icosphere(3)
    segments = nodal_lines(sphere.vertices, sphere.faces, sphere.vertices[:, 0])
    assert np.isfinite(segments).all()
    assert abs(length(segments) - 2 * np.pi) < 0.02


def test_signs_do_not_matter_away_from_zero(rng: np.random.Generator) -> None:
    sphere = shapes.icosphere(2)
    values = rng.standard_normal(sphere.n_vertices)
    one = nodal_lines(sphere.vertices, sphere.faces, values)
    other = nodal_lines(sphere.vertices, sphere.faces, -values)
    assert abs(length(one) - length(other)) < 1e-12


def test_no_line_where_there_is_no_value_or_no_zero() -> None:
    sphere = shapes.icosphere(3)
    values = sphere.vertices[:, 2].copy()
    values[sphere.vertices[:, 0] < 0.0] = np.nan
    segments = nodal_lines(sphere.vertices, sphere.faces, values)
    assert len(segments)
    assert segments[..., 0].min() >= 0.0
    assert nodal_lines(sphere.vertices, sphere.faces, np.ones(sphere.n_vertices)).shape == (0, 2, 3)
    nothing = np.full(sphere.n_vertices, np.nan)
    assert nodal_lines(sphere.vertices, sphere.faces, nothing).shape == (0, 2, 3)


def test_the_size_of_the_values_does_not_matter() -> None:
    sphere = shapes.icosphere(3)
    values = (sphere.vertices @ [0.3, 0.5, 0.8]).astype(np.float32)
    plain = nodal_lines(sphere.vertices, sphere.faces, values)
    # 2**-100 keeps all digits of a float32; differences of such numbers would lose them.
    tiny = nodal_lines(sphere.vertices, sphere.faces, values * np.float32(2.0**-100))
    np.testing.assert_array_equal(plain, tiny)


def test_single_precision_stays_single() -> None:
    sphere = shapes.icosphere(1)
    points = sphere.vertices.astype(np.float32)
    assert nodal_lines(points, sphere.faces, points[:, 2]).dtype == np.float32


def test_each_line_has_its_own_length() -> None:
    sphere = shapes.icosphere(4)
    small = Mesh(0.25 * sphere.vertices + [5.0, 0.0, 0.0], sphere.faces)
    vertices = np.concatenate([sphere.vertices, small.vertices])
    faces = np.concatenate([sphere.faces, small.faces + sphere.n_vertices])
    segments = nodal_lines(vertices, faces, vertices[:, 2] - 0.01)
    lengths = line_lengths(segments)
    assert lengths.shape == (len(segments),)
    first = segments[:, 0, 0] < 2.0
    np.testing.assert_allclose(lengths[first], 2 * np.pi, rtol=5e-3)
    np.testing.assert_allclose(lengths[~first], 0.5 * np.pi, rtol=5e-3)
    assert line_lengths(segments[:0]).shape == (0,)


def test_levels_cut_a_sphere_in_circles() -> None:
    sphere, levels = shapes.icosphere(5), (-0.9, -0.25, 0.0, 0.5)
    z = sphere.vertices[:, 2]
    segments = level_lines(sphere.vertices, sphere.faces, z, levels)
    heights = segments[..., 2]
    nearest = np.asarray(levels)[np.abs(heights[..., None] - levels).argmin(axis=-1)]
    np.testing.assert_allclose(heights, nearest, atol=1e-12)
    for level in levels:
        there = segments[np.abs(nearest[:, 0] - level) < 1e-9]
        assert abs(length(there) - 2 * np.pi * np.sqrt(1 - level**2)) < 2e-2, level


def test_levels_are_the_nodal_lines_of_each(rng: np.random.Generator) -> None:
    sphere = shapes.icosphere(3)
    values = rng.standard_normal(sphere.n_vertices).astype(np.float32)
    values[5] = np.nan
    levels = (-0.5, 0.0, 0.25, 1.0)
    found = level_lines(sphere.vertices, sphere.faces, values, levels)
    wanted = [
        nodal_lines(sphere.vertices, sphere.faces, values - np.float64(level)) for level in levels
    ]
    np.testing.assert_array_equal(found, np.concatenate(wanted))
    assert level_lines(sphere.vertices, sphere.faces, values, ()).shape == (0, 2, 3)


def test_lines_at_round_values_are_seen_on_thin_branches_too() -> None:
    sphere, centre = shapes.icosphere(3), np.array([1.0, 2.0, 3.0])
    given = sphere.vertices, sphere.faces, sphere.vertices[:, 2], centre
    segments, widths = nodal_segments(*given)
    assert widths == pytest.approx(np.full(len(segments), 2.0), rel=0.02), "the sphere's width"
    marks, widths = nodal_segments(*given, (0.0, 0.5))
    assert np.isinf(widths).all()
    np.testing.assert_allclose(np.unique((marks + centre)[..., 2].round(5)), [0.0, 0.5])


def test_segments_are_told_from_a_centre_with_the_width_of_what_they_go_around() -> None:
    sphere = shapes.icosphere(5)
    centre = np.array([100.0, 0.0, 0.0])
    placed = sphere.vertices + centre
    segments, widths = nodal_segments(placed, sphere.faces, sphere.vertices[:, 2] - 0.3, centre)
    radius = np.sqrt(1 - 0.09)
    np.testing.assert_allclose(np.linalg.norm(segments[..., :2], axis=-1), radius, atol=2e-3)
    np.testing.assert_allclose(widths, 2 * radius, rtol=1e-3)

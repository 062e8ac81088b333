"""Errors of eigenvalues due to the mesh, against closed forms and finer meshes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.resolution import affordable_pairs, quick_error


def sheet(width, height, columns, rows):
    """A rectangle in the plane of x and y, with diagonals in one direction."""
    x, y = np.meshgrid(np.linspace(0, width, columns + 1), np.linspace(0, height, rows + 1))
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    above = corner + columns + 1
    faces = [[corner, corner + 1, above + 1], [corner, above + 1, above]]
    return vertices, np.stack(faces).transpose(0, 2, 1).reshape(-1, 3)


def products(first, second, count):
    """The lowest sums of two lists of eigenvalues: those of a product of two spaces."""
    return np.sort(np.add.outer(first, second).ravel())[:count]


def interval(length):
    return (np.pi * np.arange(60) / length) ** 2


def rectangle():
    return sheet(1.0, 1.3, 12, 15), products(interval(1.0), interval(1.3), 60)


def rims_only():
    """An open tube of height 10 with 48 sides, and vertices on its two rims only."""
    vertices, faces = sheet(2 * np.pi, 10.0, 48, 1)
    angle = vertices[:, 0]
    round_ = np.stack([np.cos(angle), np.sin(angle), vertices[:, 1]], axis=1)
    faces = np.where(faces % 49 == 48, faces - 48, faces)
    around = 2 * 48 * np.sin(np.pi / 48)
    circle = (2 * np.pi * np.repeat(np.arange(60), 2)[1:] / around) ** 2
    used = np.unique(faces)
    return (round_[used], np.searchsorted(used, faces)), products(circle, interval(10.0), 60)


def book():
    """Three pages that share an edge: non-manifold, a star times an interval."""
    vertices, faces, count = [], [], 0
    for angle in (0.0, 2.0, 4.0):
        page, of_page = sheet(1.0, 0.9, 9, 8)
        x = page[:, 0]
        vertices.append(np.stack([x * np.cos(angle), x * np.sin(angle), page[:, 1]], axis=1))
        faces.append(of_page + count)
        count += len(page)
    mesh = trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces))
    mesh.merge_vertices()
    odd = (np.pi * (np.arange(20) + 0.5)) ** 2
    star = np.concatenate([interval(1.0)[:20], odd, odd])
    return (mesh.vertices, mesh.faces), products(star, interval(0.9), 60)


def slivers():
    """The rectangle with each column of a row joined to the third one after it in the next row."""
    (vertices, _), exact = rectangle()
    faces = []
    for start in range(0, 13 * 15, 13):
        low, high = start, start + 13
        for step in "^^^" + 9 * "<^" + "<<<":
            end = low + 1 if step == "<" else high + 1
            faces.append([low, end, high])
            low, high = (end, high) if step == "<" else (low, end)
    return (vertices, np.array(faces)), exact


SHAPES = {"rectangle": rectangle, "slivers": slivers, "rims": rims_only, "book": book}


@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize("name", SHAPES)
def test_estimate_agrees_with_closed_form(name, robust):
    (vertices, faces), exact = SHAPES[name]()
    pairs = mv.solve(*mv.cotangent_laplacian((vertices, faces), robust=robust), 60)
    error = pairs.eigenvalues[1:] / exact[1:] - 1.0
    found = mv.resolution_error((vertices, faces), pairs)
    assert found[0] == 0.0
    wrong, right = np.abs(error) > 0.1, np.abs(error) < 0.01
    assert wrong.any()
    if name == "slivers" and not robust:  # one finer mesh is not sufficient
        return
    assert (np.abs(found[1:])[wrong] > 0.05).mean() >= 0.95
    assert not right.any() or (np.abs(found[1:])[right] > 0.05).mean() <= 0.05
    assert 0.4 < np.median(found[1:] / error) < 2.5
    # the estimate without a second solution
    known = replace(pairs, operator=OperatorOptions(robust=robust))
    quick = quick_error(mv.Mesh(vertices, faces), known)[1:]
    assert (np.abs(quick[wrong]) > 0.05).mean() >= 0.95
    assert not right.any() or (np.abs(quick[right]) > 0.05).mean() <= 0.05
    if name != "rims":
        assert 0.8 < np.median(quick / error) < 1.6


def test_ball_agrees_with_finer_ball():
    coarse = trimesh.creation.icosphere(2)
    fine = coarse.subdivide().subdivide().subdivide()
    pairs, truth = (
        mv.solve(*mv.cotangent_laplacian(each, robust=True), 100) for each in (coarse, fine)
    )
    error = pairs.eigenvalues[1:] / truth.eigenvalues[1:] - 1.0
    found = mv.resolution_error(coarse, pairs)[1:]
    assert np.abs(error).max() > 0.2
    np.testing.assert_allclose(found, error, rtol=0.25, atol=0.002)


def test_components_and_unreferenced_vertices():
    ball = trimesh.creation.icosphere(2)
    far = ball.copy().apply_translation([9.0, 0.0, 0.0]).apply_scale(1.5)
    both = trimesh.util.concatenate([ball, far])
    vertices = np.concatenate([[[50.0, 0.0, 0.0]], both.vertices])
    mesh = mv.Mesh(vertices, both.faces + 1)
    pairs = mv.solve(*mv.cotangent_laplacian(mesh, robust=True), 40)
    found, quick = mv.resolution_error(mesh, pairs), quick_error(mesh, pairs)
    assert not found[:2].any()
    assert not quick[:2].any()
    assert (found[2:] < 0.0).all()
    assert (quick[2:] < 0.0).all()
    scaled = mv.Mesh(vertices * 1e9, both.faces + 1)
    again = mv.solve(*mv.cotangent_laplacian(scaled, robust=True), 40)
    np.testing.assert_allclose(mv.resolution_error(scaled, again), found, rtol=1e-6)
    np.testing.assert_allclose(quick_error(scaled, again), quick, rtol=1e-4)


def test_laplacian_of_the_pairs_is_used_or_refused():
    vertices, faces = sheet(1.0, 1.0, 8, 8)
    vertices = vertices @ [[1.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    plain = mv.solve(*mv.cotangent_laplacian((vertices, faces)), 20)
    robust = mv.solve(*mv.cotangent_laplacian((vertices, faces), robust=True), 20)
    errors = [mv.resolution_error((vertices, faces), each) for each in (plain, robust)]
    assert np.abs(errors[0] - errors[1]).max() > 0.05
    with raises("other-mesh", "not those of a Laplacian of this mesh"):
        mv.resolution_error((vertices * [1.0, 2.0, 1.0], faces), robust)
    with raises("other-mesh", "give the mesh that was decomposed"):
        mv.resolution_error(trimesh.creation.icosphere(2), robust)
    ball = trimesh.creation.icosphere(2)
    inner = mv.solve(*mv.cotangent_laplacian(ball), 5, sigma=20.0)
    with raises("not-lowest-pairs", "around a shift"):
        mv.resolution_error(ball, inner)


def test_cancel_and_part():
    ball = trimesh.creation.icosphere(2)
    pairs = mv.solve(*mv.cotangent_laplacian(ball, robust=True), 30)
    with pytest.raises(Cancelled):
        mv.resolution_error(ball, pairs, cancel=lambda: True)
    assert affordable_pairs(162, pairs.eigenvalues) == 30
    assert affordable_pairs(10_000_000, pairs.eigenvalues) == 21

"""Masks of vertices on a plane and a sphere, with known results."""

from __future__ import annotations

import numpy as np
import pytest
import shapes

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.masks import filled, grown, parts, shrunk


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return Mesh(*shapes.icosphere(4))


def test_growing_adds_the_neighbours_and_shrinking_reverts_it(ball: Mesh) -> None:
    mask = np.zeros(ball.n_vertices, dtype=np.bool_)
    mask[7] = True
    ring = grown(ball, mask)
    assert ring.sum() == 1 + len(np.unique(ball.faces[(ball.faces == 7).any(axis=1)])) - 1
    assert np.array_equal(shrunk(ball, ring), mask)
    assert not shrunk(ball, mask).any()


def test_holes_are_the_parts_that_a_belt_separates_from_the_largest(ball: Mesh) -> None:
    height = ball.vertices[:, 2]
    belt = (height > 0.2) & (height < 0.5)
    assert np.array_equal(filled(ball, belt), height > 0.2)
    assert filled(ball, np.ones_like(belt)).all()
    assert not filled(ball, np.zeros_like(belt)).any()
    outside = parts(ball, ~belt)
    assert outside.max() == 1
    assert (outside[belt] == -1).all()
    assert len(np.unique(outside[height >= 0.5])) == 1


def test_another_component_is_no_hole(ball: Mesh) -> None:
    two = shapes.together(ball, shapes.moved(ball, 5.0, scale=0.5))
    height = two.vertices[:, 2]
    belt = (np.abs(height - 0.3) < 0.15) & (height < 2.0)
    assert np.array_equal(filled(two, belt), (height > 0.15) & (height < 2.0))

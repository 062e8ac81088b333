"""Samples included in the package."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import meshmash_viewer as mv
from meshmash_viewer.samples import SAMPLES, sample_path


@pytest.mark.parametrize("name", sorted(set(SAMPLES) - {"two_components"}))
def test_samples_are_closed_surfaces_of_genus_0_that_look_outwards(name: str) -> None:
    mesh = mv.read_mesh(sample_path(name))
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.euler_number == 2
    assert solid.volume > 0


@pytest.mark.parametrize(("name", "unit"), [("cow", "mm"), ("dendrite", "nm"), ("sphere", "")])
def test_samples_state_their_unit(name: str, unit: str) -> None:
    assert (mv.read_mesh(sample_path(name)).unit or "") == unit


def test_eigenvalues_of_the_sphere() -> None:
    mesh = mv.read_mesh(sample_path("sphere"))
    eigenvalues, _ = mv.decompose_mesh(mesh, n_components=25)
    exact = np.concatenate([np.full(2 * degree + 1, degree * (degree + 1)) for degree in range(5)])
    np.testing.assert_allclose(eigenvalues, exact, rtol=5e-3, atol=1e-9)


def test_the_cow_is_as_wide_to_the_left_as_to_the_right() -> None:
    vertices = mv.read_mesh(sample_path("cow")).vertices
    assert np.isclose(vertices[:, 1].min(), -vertices[:, 1].max(), rtol=0.02)

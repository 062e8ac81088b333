"""Six views along the axes, of brains and of other meshes."""

from __future__ import annotations

import numpy as np
import pytest
import shapes

from meshmash_viewer.app.view.camera import DIRECTIONS, view_axes, view_label
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.structures import brain_side

SPHERE = shapes.icosphere(1)


def mesh(structure: str = "", name: str = "", unit: str = "") -> Mesh:
    return Mesh(SPHERE.vertices, SPHERE.faces, unit=unit, name=name, structure=structure)


@pytest.mark.parametrize(
    ("structure", "name", "side"),
    [
        ("CortexLeft", "", "left"),
        ("HippocampusRight", "", "right"),
        ("Cortex", "lh.pial", ""),
        ("", "lh.pial", "left"),
        ("", "fsaverage5_pial_right", "right"),
        ("", "sub-01_hemi-L_midthickness", "left"),
        ("", "shoe_left", None),
        ("", "whitefish_l", None),
        ("", "cow", None),
        ("", "", None),
    ],
)
def test_the_side_of_a_brain(structure: str, name: str, side: str | None) -> None:
    assert brain_side(structure, name) == side


def test_lateral_is_from_outside_and_medial_from_inside() -> None:
    left, right = mesh("CortexLeft", unit="mm"), mesh("CortexRight", unit="mm")
    assert view_axes("lateral", left)[2].tolist() == [-1.0, 0.0, 0.0]
    assert view_axes("lateral", right)[2].tolist() == [1.0, 0.0, 0.0]
    assert view_axes("medial", left)[2].tolist() == [1.0, 0.0, 0.0]
    assert [view_label(name, left) for name in DIRECTIONS] == [
        "Lateral", "Medial", "Anterior", "Posterior", "Dorsal", "Ventral",
    ]  # fmt: skip
    whole = mesh("Cortex")
    assert view_label("lateral", whole) == "From the right"
    assert view_axes("lateral", whole)[2].tolist() == [1.0, 0.0, 0.0]


def test_views_are_upright() -> None:
    brain, body, other = mesh("CortexLeft"), mesh(unit="mm"), mesh()
    for each in (brain, body, other):
        upright = 1 if each is other else 2
        for name, (axis, _) in DIRECTIONS.items():
            axes = view_axes(name, each)
            np.testing.assert_array_equal(axes @ axes.T, np.eye(3))
            assert np.linalg.det(axes) == 1.0
            assert axis == upright or axes[1, upright] == 1.0
        assert view_axes("dorsal", each)[1].tolist() == [0.0, 1.0, 0.0]
    assert [view_label(name, other) for name in DIRECTIONS] == [
        "From +x", "From -x", "From +y", "From -y", "From +z", "From -z",
    ]  # fmt: skip

"""Sample meshes of the package, made by ``assets/make_samples.py``."""

from __future__ import annotations

from pathlib import Path

from meshmash_viewer.errors import unknown

#: Descriptions of the samples by name.
SAMPLES: dict[str, str] = {
    "dendrite": "a forking piece of spiny dendrite, one closed surface, in nm",
    "neuron": "a small neuron with soma, dendrites, spines and axon, one closed surface, in nm",
    "cow": "a four-legged body, one closed surface, in mm",
    "sphere": "the unit sphere, of no unit",
    "two_components": "two balls with a hole, a boundary and a non-manifold edge, for tests, in nm",
}


def sample_path(name: str = "dendrite") -> Path:
    """Return the path of a sample: an NPZ file with the mesh and its unit, if any.

    `InputError` is raised if `name` is not in `SAMPLES`.
    """
    if name not in SAMPLES:
        raise unknown("sample", name, SAMPLES)
    return Path(__file__).with_name(f"{name}.npz")


def labels_path(name: str = "dendrite") -> Path:
    """Return the path of the labels of a sample: shaft and spine; for the neuron soma and axon.

    `InputError` is raised if the sample has no labels.
    """
    path = sample_path(name).with_name(f"{name}_labels.npz")
    if not path.exists():
        raise unknown("sample with labels", name, ("dendrite", "neuron"))
    return path

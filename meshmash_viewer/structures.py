"""Names of brain structures of GIFTI files (``AnatomicalStructurePrimary``)."""

from __future__ import annotations

import re

from meshmash_viewer.errors import printable, unknown

_PAIRED = (
    "Cortex", "Accumbens", "Amygdala", "Caudate", "CerebellarWhiteMatter", "Cerebellum",
    "CerebralWhiteMatter", "DiencephalonVentral", "Hippocampus", "Pallidum", "Putamen", "Thalamus",
)  # fmt: skip

#: Structures of Connectome Workbench.
STRUCTURES: tuple[str, ...] = (
    *(f"{name}{side}" for name in _PAIRED for side in ("Left", "Right")),
    "Cortex", "Cerebellum", "BrainStem", "AllGreyMatter", "AllWhiteMatter", "OtherGreyMatter",
    "OtherWhiteMatter", "Other",
)  # fmt: skip

_SHORT = {"left": "CortexLeft", "lh": "CortexLeft", "l": "CortexLeft"}
_SHORT |= {"right": "CortexRight", "rh": "CortexRight", "r": "CortexRight"}
_KNOWN = {name.lower(): name for name in STRUCTURES} | _SHORT


def named_structure(text: str) -> str:
    """Return one of `STRUCTURES` for its name in any spelling, or "left", "right", "lh", "rh".

    `InputError` is raised if there is no such structure.

    Examples
    --------
    >>> named_structure("CORTEX_LEFT"), named_structure("rh")
    ('CortexLeft', 'CortexRight')
    """
    found = _KNOWN.get(re.sub(r"[\s_-]", "", text).lower())
    if found is None:
        raise unknown("structure", printable(text, 40), STRUCTURES)
    return found


def structure_of_file(name: str) -> str:
    """Return the hemisphere of a FreeSurfer file from its name, ``lh.pial``; "" for others."""
    found = re.match(r"[lr]h(?=\.)", name)
    return _SHORT[found[0]] if found else ""


def unstated_structure(file: str, structure: str) -> str:
    """Return a remark on a GIFTI file of a mesh without a structure; "" for others.

    Examples
    --------
    >>> unstated_structure("hks.func.gii", "")
    'hks.func.gii states no brain structure, which Connectome Workbench needs'
    >>> unstated_structure("hks.func.gii", "CortexLeft"), unstated_structure("hks.csv", "")
    ('', '')
    """
    if structure or not file.lower().endswith(".gii"):
        return ""
    return f"{file} states no brain structure, which Connectome Workbench needs"


#: Words in file names of brain surfaces, and of values on them.
_BRAIN_WORDS = frozenset(
    ["pial", "white", "inflated", "midthickness", "cortex", "hemi", "hemisphere", "brain",
     "smoothwm", "flat", "fsaverage", "fslr", "civet"]
)  # fmt: skip
_FIELD_WORDS = _BRAIN_WORDS.union(
    ["sulc", "curv", "curvature", "thickness", "area", "volume", "jacobian", "myelin", "myelinmap",
     "depth", "gyrification", "lgi", "bold", "aparc", "atlas", "parcellation", "parcels", "lobes",
     "sphere", "surf", "gii", "func", "shape", "label", "annot", "mgh", "mgz", "fs"]
)  # fmt: skip


def brain_side(structure: str, name: str, *, of_values: bool = False) -> str | None:
    """Return the side of a brain surface, "left", "right", or "" for both; None for other meshes.

    `structure` is one of `STRUCTURES`, or "" if unknown. In the `name` of the file, "lh" and "rh"
    denote a hemisphere; next to a word such as "pial", or "sulc" if the file is one `of_values`,
    "L" and "R", or else "left" and "right" do so.

    Examples
    --------
    >>> brain_side("CortexLeft", ""), brain_side("", "fsaverage5_pial_right"), brain_side("", "cow")
    ('left', 'right', None)
    >>> brain_side("", "s1.L.sulc.csv", of_values=True), brain_side("", "s1.L.sulc")
    ('left', None)
    """
    if structure:
        return next((side for side in ("left", "right") if structure.lower().endswith(side)), "")
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
    words, with_digits = re.split(r"[^a-z]+", name), re.split(r"[^a-z\d]+", name)
    known = {"lh": words, "l": with_digits, "left": words}  # r2 is no side
    if (_FIELD_WORDS if of_values else _BRAIN_WORDS).isdisjoint(words):
        del known["l"], known["left"]
    for left, found in known.items():
        right = {"lh": "rh", "l": "r", "left": "right"}[left]
        if left in found or right in found:
            return "" if left in found and right in found else "left" if left in found else "right"
    return None

"""Maps that are in no other file, written next to a session."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import written_whole
from meshmash_viewer.vertex_map import Label, VertexMap

#: Ending of the files.
KEPT_MAPS_ENDING = ".maps.npz"


@dataclass(frozen=True, eq=False)
class KeptMaps:
    """Maps of a mesh."""

    maps: tuple[VertexMap, ...]
    #: Content hash of the mesh.
    mesh: str
    #: Names of those that replace maps of files.
    edited: Sequence[str] = ()


def write_kept_maps(path: Path, kept: KeptMaps) -> None:
    """Write maps; `OSError` is raised if that fails, and an older file is left as it was."""
    named = [
        {"name": each.name, "unit": each.unit, "labels": [astuple(label) for label in each.labels]}
        for each in kept.maps
    ]
    about = json.dumps({"mesh": kept.mesh, "edited": list(kept.edited), "maps": named})
    values: dict[str, Any] = {f"values_{at}": each.values for at, each in enumerate(kept.maps)}
    with written_whole(path) as part, part.open("wb") as file:
        np.savez(file, about=np.array(about), **values)


def read_kept_maps(path: Path) -> KeptMaps:
    """Read maps; `InputError` is raised if the file is damaged or cannot be read."""
    try:
        with path.open("rb") as file, np.load(file) as stored:
            about = json.loads(str(stored["about"]))
            maps = tuple(
                VertexMap(
                    one["name"],
                    stored[f"values_{at}"],
                    tuple(Label(*each) for each in one.get("labels", ())),
                    one["unit"],
                )
                for at, one in enumerate(about["maps"])
            )
            return KeptMaps(maps, str(about["mesh"]), tuple(about.get("edited", ())))
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as fault:
        raise InputError(f"{path.name} cannot be read: {fault}") from fault

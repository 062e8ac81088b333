"""Serialization of a drawing, and of the actors that scripts have added to it, for a process."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkTypeUInt8Array
from vtkmodules.vtkRenderingCore import vtkProp

from meshmash_viewer.app.view.mesh_renderer import MeshRenderer


@dataclass(frozen=True, eq=False)
class SerializedDrawing:
    """A picklable description of a drawing; large arrays are shared with the drawing."""

    dark: bool
    #: A result of `MeshRenderer.contents`, whose mesh has no maps.
    contents: dict[str, Any]
    #: Numbers of the actors added by scripts, and states and arrays of all their VTK objects.
    actors: list[int] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    blobs: dict[str, npt.NDArray[np.uint8]] = field(default_factory=dict)

    def drawing(self) -> MeshRenderer:
        """Return the described drawing."""
        made = MeshRenderer(self.dark)
        for prop in self._props():
            made.renderer.AddViewProp(prop)
        made.restore(self.contents)
        return made

    def _props(self) -> list[vtkProp]:
        if not self.actors:
            return []
        manager = _object_manager()
        for name, content in self.blobs.items():
            array = vtkTypeUInt8Array()
            array.SetNumberOfValues(len(content))
            vtk_to_numpy(array)[:] = content
            manager.RegisterBlob(name, array)
        for state in self.states:
            manager.RegisterState(state)
        manager.UpdateObjectsFromStates()
        return [manager.GetObjectAtId(number) for number in self.actors]


def serialized(drawing: MeshRenderer) -> SerializedDrawing:
    """Return the description of a drawing."""
    contents, props = drawing.contents(), list(drawing.added())
    if contents["mesh"] is not None:
        contents["mesh"] = contents["mesh"].with_only_maps()
    if not props:
        return SerializedDrawing(drawing.dark, contents)
    manager = _object_manager()
    actors = [manager.RegisterObject(prop) for prop in props]
    manager.UpdateStatesFromObjects()
    known = manager.GetAllDependencies(0)
    states = [manager.GetState(each) for each in known]
    blobs = {each: vtk_to_numpy(manager.GetBlob(each)) for each in manager.GetBlobHashes(known)}
    return SerializedDrawing(drawing.dark, contents, actors, states, blobs)


def _object_manager() -> Any:
    # imported only for actors of scripts, because the import is slow
    from vtkmodules.vtkSerializationManager import vtkObjectManager

    manager = vtkObjectManager()
    manager.Initialize()
    return manager

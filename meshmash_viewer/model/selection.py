"""The selected and the hidden vertices of the open mesh."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
from psygnal import Signal

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.history import History
from meshmash_viewer.model.open_mesh import OpenMesh
from meshmash_viewer.surface.masks import Mask, grown, shrunk

#: How a mask changes the selection: replaces it, is added to it, or is removed from it.
How: TypeAlias = Literal["replace", "add", "remove"]


class MaskOfMesh:
    """A mask of vertices of the open mesh, recorded in the history and mapped by repairs."""

    changed = Signal()
    #: Name of the part of the history.
    part = ""

    def __init__(self, opened: OpenMesh, history: History) -> None:
        self._opened, self._history = opened, history
        #: Shape (n,), read-only; None for no vertex.
        self.mask: Mask | None = None
        history.keep(self.part, lambda: self.mask, self.put)

    def put(self, mask: Mask | None) -> None:
        """Replace the mask without a step of the history."""
        self.mask = checked_mask(mask, self._opened.mesh)
        self.changed.emit()

    def set(self, mask: Mask | None, label: str = "") -> None:
        """Replace the mask as one change; `label` completes "Undo …"."""
        mask = checked_mask(mask, self._opened.mesh)
        if not self._is(mask):
            self._history.record(label or self.part, self.part)
            self.put(mask)

    def follow(self, before: Mesh | None, now: Mesh) -> None:
        """Map the mask from the mesh before a repair, or remove it for another file (None).

        The caller emits `changed`.
        """
        mask = None if before is None else followed_mask(self.mask, before, now)
        self.mask = checked_mask(mask, now)

    def _is(self, mask: Mask | None) -> bool:
        if mask is None or self.mask is None:
            return mask is self.mask
        return np.array_equal(mask, self.mask)


class Hiding(MaskOfMesh):
    """The vertices hidden by the user, with their adjacent faces."""

    part = "hidden vertices"

    def hide(self, mask: Mask) -> None:
        """Hide more vertices."""
        self.set(mask if self.mask is None else self.mask | mask, "hiding of vertices")

    def isolate(self, mask: Mask) -> None:
        """Hide all vertices outside a mask."""
        self.set(~mask, "isolation")

    def show_all(self) -> None:
        """Show all vertices."""
        self.set(None, "showing of all vertices")


class Selection(MaskOfMesh):
    """The selected vertices; calls of `draw` until `finish` are recorded as one change."""

    part = "selection"
    _drawing = False

    def put(self, mask: Mask | None) -> None:
        self._drawing = False
        super().put(mask)

    def set(self, mask: Mask | None, label: str = "") -> None:
        self.finish()
        super().set(mask, label)

    def draw(self, mask: Mask, label: str) -> None:
        """Replace the selection as a part of one change, which `finish` ends."""
        if not self._drawing:
            if self._is(checked_mask(mask, self._opened.mesh)):
                return
            self._history.record(label, self.part)
        super().put(mask)
        self._drawing = True

    def finish(self) -> None:
        """End the change that `draw` began."""
        if self._drawing:
            self._drawing = False
            self._history.changed.emit()

    def take(self, mask: Mask, how: How = "replace", label: str = "selection") -> None:
        """Replace the selection by a mask, add the mask or remove it, as one change."""
        self.set(combined(self.mask, mask, how), label)

    def grow(self) -> None:
        """Select the neighbours of the selected vertices as well."""
        if self._opened.mesh is not None and self.mask is not None:
            self.set(grown(self._opened.mesh, self.mask), "growing of the selection")

    def shrink(self) -> None:
        """Deselect the vertices at the border of the selection."""
        if self._opened.mesh is not None and self.mask is not None:
            self.set(shrunk(self._opened.mesh, self.mask), "shrinking of the selection")

    def invert(self) -> None:
        """Select the other vertices of the surface."""
        if (mesh := self._opened.mesh) is not None:
            rest = mesh.referenced if self.mask is None else mesh.referenced & ~self.mask
            self.set(rest, "inversion of the selection")

    def clear(self) -> None:
        """Select nothing."""
        self.set(None, "clearing of the selection")


def combined(before: Mask | None, mask: Mask, how: How) -> Mask:
    """Return the selection replaced by a mask, or with the mask added or removed."""
    if how == "replace":
        return mask
    if how == "add":
        return mask if before is None else before | mask
    return np.zeros_like(mask) if before is None else before & ~mask


def checked_mask(mask: Mask | None, mesh: Mesh | None) -> Mask | None:
    """Return a read-only mask, copied if it was writable; None for an empty mask.

    `ValueError` is raised if the mask is not an array of one bool for each vertex.
    """
    if mask is None:
        return None
    n = 0 if mesh is None else mesh.n_vertices
    if mask.dtype != np.bool_ or mask.shape != (n,):
        raise ValueError(
            f"A selection is one bool for each of {n:,} vertices, not {mask.dtype} of shape"
            f" {mask.shape}."
        )
    if not mask.any():
        return None
    if mask.flags.writeable:
        mask = mask.copy()
        mask.flags.writeable = False
    return mask


def mask_in_file(mesh: Mesh, mask: Mask) -> Mask:
    """Convert a mask to the vertices of the file, shape (n_file,), merged vertices included."""
    if mesh.numbering is None:
        return mask
    here = mesh.numbering.here
    return (here >= 0) & mask[here]


def mask_of_file(mesh: Mesh, in_file: Mask) -> Mask:
    """Convert a mask of the vertices of the file to the vertices of the mesh, shape (n,)."""
    if mesh.numbering is None:
        return in_file
    here = mesh.numbering.here
    result = np.zeros(mesh.n_vertices, dtype=np.bool_)
    result[here[in_file & (here >= 0)]] = True
    return result


def followed_mask(mask: Mask | None, before: Mesh, now: Mesh) -> Mask | None:
    """Map a mask to the vertices of the mesh of the same file after other repairs."""
    return None if mask is None else mask_of_file(now, mask_in_file(before, mask))

"""Overwrites a buffer on the graphics card where it is.

VTK takes a new buffer for every upload, of any size: its allocation costs several times the copy.
It has no call for writing into one that is there, but the OpenGL function for that is loaded by
VTK itself, and its own pointer to it is used here.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import vtkmodules
from vtkmodules.vtkRenderingCore import vtkRenderWindow
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLVertexBufferObject

__all__ = ["overwrite"]

_ARRAY_BUFFER = 0x8892
#: VTK's loader of OpenGL, as its wheels bring it on Linux, macOS and Windows.
_LIBRARIES = ("libvtkglad*.so*", ".dylibs/libvtkglad*.dylib", "vtkglad*.dll")
_POINTER = "vtk_glad_glBufferSubData"


def overwrite(
    window: vtkRenderWindow | None,
    buffer: vtkOpenGLVertexBufferObject | None,
    values: npt.NDArray[np.generic],
) -> bool:
    """Write an array into a buffer of the same size.

    Parameters
    ----------
    window : vtkRenderWindow or None
        That the buffer belongs to.
    buffer : vtkOpenGLVertexBufferObject or None
    values : ndarray
        In C order.

    Returns
    -------
    bool
        False if there is no such buffer yet, or no such function in this build of VTK: VTK has to
        upload the array itself then.
    """
    if window is None or buffer is None or buffer.GetSize() != values.nbytes:
        return False
    pointer = _pointer()
    if pointer is None:
        return False
    window.MakeCurrent()
    if pointer.value is None or not buffer.Bind():
        return False
    write = _PROTOTYPE(pointer.value)
    write(_ARRAY_BUFFER, 0, values.nbytes, values.__array_interface__["data"][0])
    buffer.Release()
    return True


_PROTOTYPE: Any = getattr(ctypes, "WINFUNCTYPE", ctypes.CFUNCTYPE)(
    None, ctypes.c_uint, ctypes.c_ssize_t, ctypes.c_ssize_t, ctypes.c_void_p
)


@cache
def _pointer() -> ctypes.c_void_p | None:
    """Where VTK keeps the address of the function, None if it is not known."""
    folder = Path(vtkmodules.__file__).parent
    for pattern in _LIBRARIES:
        for path in folder.glob(pattern):
            try:
                return ctypes.c_void_p.in_dll(ctypes.CDLL(str(path)), _POINTER)
            except (OSError, ValueError):  # not a library, or without this function
                continue
    return None

"""NPY files as growing, memory-mapped arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy_format

__all__ = ["create_rows", "grow_rows", "map_rows"]


def create_rows(
    path: Path, shape: tuple[int, ...], dtype: npt.DTypeLike, fill: float | None = None
) -> None:
    """Make a C-ordered NPY file; without a fill value it is zeros that take no room yet."""
    with path.open("wb") as file:
        description = np.lib.format.dtype_to_descr(np.dtype(dtype))
        npy_format.write_array_header_1_0(
            file, {"descr": description, "fortran_order": False, "shape": shape}
        )
        if fill is None:
            file.truncate(file.tell() + np.dtype(dtype).itemsize * int(np.prod(shape)))
        else:
            file.write(np.full(shape, fill, dtype=dtype).tobytes())


def grow_rows(path: Path, n_rows: int, fill: float | None = None) -> None:
    """Lengthen the first axis in place; maps of the old length stay valid.

    NumPy leaves room in the header for the number of rows to grow.

    Raises
    ------
    ValueError
        If the file is not an NPY file of ours.
    """
    with path.open("rb+") as file:
        npy_format.read_magic(file)
        shape, fortran, dtype = npy_format.read_array_header_1_0(file)
        start = file.tell()
        if fortran or not shape:
            raise ValueError(f"{path.name} is not an array of rows")
        if shape[0] >= n_rows:
            return
        end = start + dtype.itemsize * int(np.prod(shape))
        grown = (n_rows, *shape[1:])
        # Content first: whoever reads the new header finds what it promises.
        if fill is None:
            file.truncate(start + dtype.itemsize * int(np.prod(grown)))
        else:
            file.seek(end)
            file.write(np.full((n_rows - shape[0], *shape[1:]), fill, dtype=dtype).tobytes())
            file.flush()
        file.seek(0)
        npy_format.write_array_header_1_0(
            file,
            {
                "descr": npy_format.dtype_to_descr(dtype),
                "fortran_order": False,
                "shape": grown,
            },
        )
        if file.tell() != start:
            raise ValueError(f"{path.name} has no room in its header to grow")


def map_rows(
    path: Path, mode: Literal["r", "r+"], shape: tuple[int | None, ...]
) -> npt.NDArray[Any]:
    """Map an NPY file whose shape has to be `shape`, None standing for any length.

    Raises
    ------
    ValueError
        If it is another array, or the file is shorter than its header says.
    """
    try:
        array = np.load(path, mmap_mode=mode, allow_pickle=False)
    except EOFError:
        raise ValueError(f"{path.name} is empty") from None
    if len(array.shape) != len(shape) or any(
        wanted is not None and wanted != found
        for wanted, found in zip(shape, array.shape, strict=False)
    ):
        raise ValueError(f"{path.name} has shape {array.shape}")
    mapped: npt.NDArray[Any] = array
    return mapped

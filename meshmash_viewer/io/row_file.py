"""The file of eigenvectors: rows of float64 one after the other, nothing else.

One file for all rows of a spectrum, so that whoever reads maps one array. Rows that have been given
out are final; more are added behind them, which leaves maps of the old length valid.
"""

from __future__ import annotations

import errno
import os
import zlib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np
import numpy.typing as npt

from meshmash_viewer.progress import CancelCallback

__all__ = ["StoredRows", "make_room"]

FloatArray = npt.NDArray[np.float64]

#: Zeros written at a time.
_CHUNK = 1 << 20
#: Threads that compare checksums.
_THREADS = 2
#: What a file system answers that cannot allocate blocks beforehand.
_NOT_SUPPORTED = (errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS)


@dataclass(frozen=True, eq=False)
class StoredRows:
    """Rows in a file, as they are told of between processes.

    Parameters
    ----------
    path : Path
    n_vertices : int
        Length of a row.
    checksums : ndarray of uint32, shape (k,)
        CRC-32 of each row, where they are to be compared with the file; empty for rows that have
        just been written.
    """

    path: Path
    n_vertices: int
    checksums: npt.NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))

    @property
    def row_bytes(self) -> int:
        """Bytes of a row."""
        return 8 * self.n_vertices

    def map(self, count: int) -> FloatArray:
        """The first rows, shape (count, n), mapped read-only.

        Raises
        ------
        OSError, ValueError
            If there are fewer, or none.
        """
        return np.memmap(self.path, np.float64, "r", shape=(count, self.n_vertices))

    def damaged(self, indices: Iterable[int], cancel: CancelCallback | None = None) -> list[int]:
        """Which of some rows do not agree with their checksums.

        Parameters
        ----------
        indices : iterable of int
        cancel : callable, optional
            Asked before each row; once it returns True the rest goes unread.

        Returns
        -------
        list of int
            Rows that cannot be read included.
        """

        def is_whole(index: int) -> bool:
            if cancel is not None and cancel():
                return True
            try:
                with self.path.open("rb") as file:
                    file.seek(index * self.row_bytes)
                    row = file.read(self.row_bytes)
            except OSError:
                return False
            return len(row) == self.row_bytes and zlib.crc32(row) == self.checksums[index]

        indices = list(indices)
        with ThreadPoolExecutor(_THREADS) as threads:  # zlib lets go of the interpreter's lock
            whole = list(threads.map(is_whole, indices))
        return [index for index, flag in zip(indices, whole, strict=True) if not flag]


def make_room(path: Path, size: int) -> None:
    """Lengthen a file to so many bytes by zeros, or make it; blocks of the disk are behind them.

    Raises
    ------
    OSError
        If the disk is full. Without the blocks a full disk would end the process, by a signal
        where it writes into a map.
    """
    with path.open("ab", buffering=0) as file:
        before = file.tell()
        try:
            _fill(file, before, size - before)
            os.fsync(file.fileno())
        except BaseException:
            file.truncate(before)
            raise


def _fill(file: IO[bytes], start: int, size: int) -> None:
    if size > 0 and hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(file.fileno(), start, size)
        except OSError as fault:
            if fault.errno not in _NOT_SUPPORTED:
                raise
        else:
            return
    zeros = bytes(min(max(size, 0), _CHUNK))
    while size > 0:
        size -= file.write(zeros[:size])

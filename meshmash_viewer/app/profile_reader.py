"""Values of all eigenfunctions at the pinned vertices, read off the interface thread."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shiboken6
from PySide6.QtCore import QObject, QThreadPool, Signal

from meshmash_viewer.model.spectrum import Spectrum

__all__ = ["ProfileReader"]

#: Rows read at a time. Each may be a page of a file that is not in memory, and NumPy holds the
#: interpreter's lock while it copies: few at a time let the window breathe.
_CHUNK = 8


class ProfileReader(QObject):
    """Keeps what has been read for the spectrum in force; reads what is missing.

    A vertex's values are a column of the rows, one value a page: cheap in memory, slow from disk.

    Signals
    -------
    changed()
        More values are there.
    """

    changed = Signal()
    arrived = Signal(object, object, object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.wanted: Spectrum | None = None
        self._spectrum: Spectrum | None = None
        self._values: dict[int, npt.NDArray[np.float64]] = {}
        self._pending: set[int] = set()
        self._pool = QThreadPool(self)
        self._pool.setMaxThreadCount(1)
        self.arrived.connect(self._take)

    def want(self, spectrum: Spectrum | None, vertices: tuple[int, ...]) -> None:
        """Say what is to be shown; old values stay until new ones come."""
        if spectrum is not self.wanted:
            self.wanted = spectrum
            self._pending.clear()
        if spectrum is None:
            self._values.clear()
            self._spectrum = None
            return
        known = self._values.keys() if self._spectrum is spectrum else set()
        missing = tuple(v for v in vertices if v not in known and v not in self._pending)
        if missing:
            self._pending.update(missing)
            # a function, not a `QRunnable`: the pool's wrapper would keep each for good
            self._pool.start(lambda: self._read(spectrum, missing))

    def _read(self, spectrum: Spectrum, vertices: tuple[int, ...]) -> None:
        """Read in the pool; give up as soon as something newer is wanted."""
        values: npt.NDArray[np.float64] | Exception
        try:
            values = np.empty((len(spectrum), len(vertices)))
            for start in range(0, len(spectrum), _CHUNK):
                if self.wanted is not spectrum:
                    return
                stop = min(start + _CHUNK, len(spectrum))
                for column, vertex in enumerate(vertices):
                    values[start:stop, column] = spectrum.shown_rows[start:stop, vertex]
        except Exception as fault:  # noqa: BLE001  raised again where it is waited for
            values = fault
        if shiboken6.isValid(self):
            self.arrived.emit(spectrum, vertices, values)

    def values(self, vertex: int) -> npt.NDArray[np.float64] | None:
        """Values at a vertex, shape (k,); of fewer pairs while newer ones are being read."""
        return self._values.get(vertex)

    def wait(self) -> None:
        """Wait for what is being read."""
        self._pool.waitForDone()

    def close(self) -> None:
        """Give up what is being read, and wait until nothing looks at the spectrum any more."""
        self.want(None, ())
        self.wait()

    def _take(
        self,
        spectrum: Spectrum,
        vertices: tuple[int, ...],
        values: npt.NDArray[np.float64] | Exception,
    ) -> None:
        if spectrum is not self.wanted:
            return
        if isinstance(values, Exception):
            self._pending.difference_update(vertices)
            raise values
        if self._spectrum is not spectrum:
            self._spectrum = spectrum
        for column, vertex in enumerate(vertices):
            self._values[vertex] = values[:, column]
            self._pending.discard(vertex)
        self.changed.emit()

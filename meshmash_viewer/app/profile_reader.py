"""Values of all eigenfunctions at the pinned vertices, read off the interface thread."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QObject, Signal

from meshmash_viewer.app.latest_thread import LatestThread
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.progress import CancelCallback

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
        self._wanted: Spectrum | None = None
        self._spectrum: Spectrum | None = None
        self._values: dict[int, npt.NDArray[np.float64]] = {}
        self._asked: tuple[int, ...] = ()
        self.thread_ = LatestThread(self._read, parent=self)
        self.thread_.start()
        self.arrived.connect(self._take)

    def want(self, spectrum: Spectrum | None, vertices: tuple[int, ...]) -> None:
        """Say what is to be shown; old values stay until new ones come."""
        if spectrum is not self._wanted:
            self._wanted, self._asked = spectrum, ()
            self.thread_.drop()
        if spectrum is None:
            self._values.clear()
            self._spectrum = None
            return
        known = self._values.keys() if self._spectrum is spectrum else set()
        missing = tuple(vertex for vertex in vertices if vertex not in known)
        if not set(missing) <= set(self._asked):
            self._asked = missing
            self.thread_.ask((spectrum, missing))

    def _read(self, request: tuple[Spectrum, tuple[int, ...]], cancel: CancelCallback) -> None:
        spectrum, vertices = request
        values: npt.NDArray[np.float64] | Exception
        try:
            values = np.empty((len(spectrum), len(vertices)))
            for start in range(0, len(spectrum), _CHUNK):
                if cancel():
                    return
                stop = min(start + _CHUNK, len(spectrum))
                for column, vertex in enumerate(vertices):
                    values[start:stop, column] = spectrum.shown_rows[start:stop, vertex]
        except Exception as fault:  # noqa: BLE001  raised again where it is waited for
            values = fault
        self.arrived.emit(spectrum, vertices, values)

    def values(self, vertex: int) -> npt.NDArray[np.float64] | None:
        """Values at a vertex, shape (k,); of fewer pairs while newer ones are being read."""
        return self._values.get(vertex)

    def close(self) -> None:
        """Give up what is being read, and wait until nothing looks at the spectrum any more."""
        self.want(None, ())
        self.thread_.close()

    def _take(
        self,
        spectrum: Spectrum,
        vertices: tuple[int, ...],
        values: npt.NDArray[np.float64] | Exception,
    ) -> None:
        if spectrum is not self._wanted:
            return
        if isinstance(values, Exception):
            self._asked = ()
            raise values
        self._spectrum = spectrum
        self._values.update(zip(vertices, values.T, strict=True))
        self.changed.emit()

"""Stored eigenpairs compared with their checksums, behind what is already on the screen."""

from __future__ import annotations

import time

import shiboken6
from PySide6.QtCore import QObject, QRunnable, QThreadPool, QTimer, Signal

from meshmash_viewer.app.listening import listen
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.spectrum import Spectrum

__all__ = ["RowCheck"]

#: Milliseconds until it begins: the first picture comes first.
_AFTER = 1500
#: Seconds of rest after each row, so that whoever scrolls goes first.
_REST = 0.004


class RowCheck(QObject):
    """Looks at all rows of a spectrum that was found in the store, once.

    Exports check what they write themselves; this is for what is only looked at.
    """

    found = Signal(object, int)

    def __init__(self, document: Document, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self.wanted: Spectrum | None = None
        self._pool = QThreadPool(self)
        self._pool.setMaxThreadCount(1)
        self._timer = QTimer(self, singleShot=True)
        self._timer.timeout.connect(self._start)
        self.found.connect(self._tell)
        listen(document.spectrum_changed, self._refresh)
        self._refresh()

    def close(self) -> None:
        """Give up, and wait for the thread."""
        self._timer.stop()
        self.wanted = None
        self._pool.waitForDone()

    def _refresh(self) -> None:
        spectrum = self._document.spectrum
        stored = None if spectrum is None else spectrum.stored
        if stored is None or not len(stored.checksums):
            spectrum = None
        if spectrum is not self.wanted:
            self.wanted = spectrum
            self._timer.stop()
            if spectrum is not None:
                self._timer.start(_AFTER)

    def _start(self) -> None:
        if self.wanted is not None:
            self._pool.start(_Check(self, self.wanted))

    def _tell(self, spectrum: Spectrum, index: int) -> None:
        self._document.leave_out_damaged(spectrum, index)


class _Check(QRunnable):
    """One pass over the rows; gives up as soon as another spectrum is shown."""

    def __init__(self, check: RowCheck, spectrum: Spectrum) -> None:
        super().__init__()
        self._check = check
        self._spectrum = spectrum

    def run(self) -> None:
        """Compare row by row; the first that is damaged ends it."""
        spectrum, check = self._spectrum, self._check
        stored = spectrum.stored
        assert stored is not None
        for index in range(len(spectrum)):
            if check.wanted is not spectrum:
                return
            if stored.damaged([index], lambda: check.wanted is not spectrum, n_threads=1):
                if shiboken6.isValid(check):
                    check.found.emit(spectrum, index)
                return
            time.sleep(_REST)

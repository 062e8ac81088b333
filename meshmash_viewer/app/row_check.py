"""Stored eigenpairs compared with their checksums, behind what is already on the screen."""

from __future__ import annotations

import time

from PySide6.QtCore import QObject, QThread

from meshmash_viewer.app.latest_thread import LatestThread
from meshmash_viewer.app.listening import listen
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.io.stored_spectrum import Compared
from meshmash_viewer.model.document import Document
from meshmash_viewer.progress import CancelCallback, Cancelled

__all__ = ["RowCheck"]

#: Seconds until it begins: the first picture comes first.
_AFTER = 1.5
#: Seconds of rest after each row, and of the longer one while somebody changes what is drawn: few
#: frames of a slider meet a row that is read.
_REST, _REST_IN_USE = 0.004, 0.25
#: Seconds without a change after which nobody is at it.
_QUIET = 1.0


class RowCheck(QObject):
    """Looks at all rows of a spectrum that was found in the store, once.

    For what is only looked at. Exports compare what they write themselves, but for rows that have
    been found whole here while nobody has written to their file since.
    """

    def __init__(self, document: Document, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self._wanted: Spectrum | None = None
        self._used = -_QUIET
        low = QThread.Priority.LowPriority
        self.thread_ = LatestThread(self._check, self._take, _AFTER, self, priority=low)
        listen(document.display.events, self._note_use)
        listen(document.spectrum_changed, self._refresh)
        self._refresh()

    def close(self) -> None:
        """Give up, and wait for the thread."""
        self.thread_.close()

    def _note_use(self) -> None:
        self._used = time.monotonic()

    def _refresh(self) -> None:
        spectrum = self._document.spectrum
        stored = None if spectrum is None else spectrum.stored
        if stored is None or not len(stored.checksums):
            spectrum = None
        if spectrum is not self._wanted:
            self._wanted = spectrum
            self.thread_.drop()
            if spectrum is not None:
                self.thread_.ask(spectrum)

    def _check(self, spectrum: Spectrum, cancel: CancelCallback) -> int | Compared:
        """Compare row by row; the first that is damaged ends it, and is the answer."""
        stored = spectrum.stored
        assert stored is not None
        state = stored.state  # of before, so that nothing is missed
        for index in range(len(spectrum)):
            damaged = stored.damaged([index], cancel)
            if damaged:
                return index
            in_use = time.monotonic() - self._used < _QUIET
            if not self.thread_.stays(_REST_IN_USE if in_use else _REST):
                raise Cancelled
        return Compared(stored.checksums[: len(spectrum)], state)

    def _take(self, spectrum: Spectrum, found: int | Compared | Exception) -> None:
        if isinstance(found, Exception):
            raise found
        if isinstance(found, Compared):
            self._document.compared = found
        else:
            self._document.leave_out_damaged(spectrum, found)

"""Background comparison of stored eigenpairs with their checksums."""

from __future__ import annotations

import time

from PySide6.QtCore import QObject

from meshmash_viewer.app.latest_thread import LatestThread
from meshmash_viewer.app.listening import listen
from meshmash_viewer.io.stored_spectrum import Compared
from meshmash_viewer.model.document import Document
from meshmash_viewer.progress import CancelCallback, Cancelled
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

#: Seconds until it begins, after the first frame.
_DELAY = 1.5
#: Seconds of rest after each row, and while the display is being changed, where reading would
#: delay frames.
_REST, _REST_IN_USE = 0.004, 0.25
#: Seconds without a change after which the display is not in use.
_QUIET = 1.0


class RowCheck(QObject):
    """Checks all rows of a spectrum from the store, once.

    Exports check the rows that they write themselves, except those found undamaged here in a file
    that has not changed since.
    """

    def __init__(self, document: Document, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self._wanted: Eigenpairs | None = None
        self._used = -_QUIET
        self.thread_ = LatestThread(self._check, self._take, _DELAY, self)
        listen(document.display.events, self._note_use)
        listen(document.spectrum_changed, self._refresh)
        self._refresh()

    def close(self) -> None:
        """Stop, and wait for the thread."""
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

    def _check(self, spectrum: Eigenpairs, cancel: CancelCallback) -> int | Compared:
        """Compare row by row; returns the index of the first damaged row, if there is one."""
        stored = spectrum.stored
        assert stored is not None
        state = stored.state  # read before the rows, so that later changes are noticed
        for index in range(len(spectrum)):
            damaged = stored.damaged([index], cancel)
            if damaged:
                return index
            in_use = time.monotonic() - self._used < _QUIET
            if not self.thread_.stays(_REST_IN_USE if in_use else _REST):
                raise Cancelled
        return Compared(stored.checksums[: len(spectrum)], state)

    def _take(self, spectrum: Eigenpairs, found: int | Compared | Exception) -> None:
        if isinstance(found, Exception):
            raise found
        if isinstance(found, Compared):
            self._document.compared = found
        else:
            self._document.leave_out_damaged(spectrum, found)

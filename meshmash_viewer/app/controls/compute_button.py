"""Button that computes as many eigenpairs as a remark asks for, and what that costs."""

from __future__ import annotations

from PySide6.QtWidgets import QPushButton

from meshmash_viewer.app import theme
from meshmash_viewer.app.listening import follow
from meshmash_viewer.model.document import Document
from meshmash_viewer.spectral import cost
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import counted


def written_cost(document: Document, target: Target) -> str:
    """Estimate what a decomposition takes: "about 1.2 GB of memory and 12 s"."""
    assert document.solved is not None
    pairs, _ = document.solve.translation().count(target)
    n_bytes = cost.decomposition_bytes(document.solved.health.n_vertices, pairs)
    time = cost.written_duration(document.solve.expected_seconds(target))
    return f"about {cost.written_bytes(n_bytes)} of memory and {time}"


class ComputeButton(QPushButton):
    """Computes the pairs that a remark is about; hidden while there are none."""

    def __init__(self, document: Document, name: str) -> None:
        super().__init__()
        theme.named(self, name, "Compute these pairs", role="link")
        self._document = document
        self._target: Target | None = None
        self.hide()
        self.clicked.connect(self._compute)
        follow(document.work.changed, self._refresh)

    def show_target(self, target: Target | None) -> None:
        """Offer to compute a part of the spectrum, or nothing."""
        self._target = target
        self._refresh()

    def _refresh(self) -> None:
        target, document = self._target, self._document
        offered = target is not None and document.ready is not None
        if offered and target is not None:
            count, exact = document.solve.translation().count(target)
            which = "all" if count >= document.solve.translation().n_vertices else "these"
            about = "" if exact or which == "all" else "≈ "
            self.setText(f"Compute {which} {about}{counted(count, 'pair')}")
            self.setAccessibleName(self.text())
            self.setToolTip(f"Takes {written_cost(document, target)}")
            self.setEnabled(document.work.job is None)
        self.setVisible(offered)

    def _compute(self) -> None:
        if self._target is not None:
            self._document.solve.target = self._target
            self._document.solve.compute()

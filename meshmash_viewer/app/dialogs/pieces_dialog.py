"""Dialog that computes a feature piece by piece."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from PySide6.QtWidgets import QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.dialogs.files import FileRow, SaveDialog
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields import FEATURES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.io.writers import WRITERS
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.pieces import LEAST, PiecesJob, in_pieces, usual_pieces
from meshmash_viewer.units import counted, format_quantity


class PiecesDialog(SaveDialog):
    """Asks for a feature, the number of pieces, and the file.

    The feature has the parameters of its tab; those that depend on the spectrum of the whole mesh
    are taken from Weyl's law. The spectrum of each piece is computed up to the target of the Mesh
    panel.
    """

    def __init__(self, document: Document, folder: Path, parent: QWidget | None = None) -> None:
        mesh = document.mesh
        assert mesh is not None
        self._document, self._mesh = document, mesh
        self._families: dict[str, Family] = {}
        for name in FEATURES:
            try:
                found = in_pieces(self._as_shown(name), mesh, document.solve.target)
            except InputError:
                continue  # needs the spectrum of the whole mesh
            self._families[name] = found
        patterns = " ".join(f"*{ending}" for ending in WRITERS)
        path = folder / f"{mesh.name or 'mesh'}_pieces.npz"
        row = FileRow(path, f"Tables ({patterns})", ".npz")
        accept = "Compute", "pieces_compute_button"
        super().__init__("features", "Compute in pieces", row, parent, accept)
        theme.named(self, "pieces_dialog")
        labels = {name: family.label for name, family in self._families.items()}
        self.family_combo = make.combo("pieces_family_combo", "Feature", entries=labels)
        shown = self.family_combo.findData(document.display.kind)
        self.family_combo.setCurrentIndex(max(shown, 0))
        n = mesh.n_vertices - len(mesh.unreferenced)
        most = max(n // LEAST, 1)
        self.count_spin = make.spin(
            "pieces_count_spin",
            "Number of pieces",
            minimum=1,
            maximum=most,
            value=usual_pieces(n),
            keyboardTracking=True,
        )
        self.size_label = make.label("pieces_size_label", wordWrap=True, role="muted")
        self._arrange_rows(
            ("Feature", self.family_combo), ("Pieces", self.count_spin), ("", self.size_label)
        )
        self.setMinimumWidth(560)
        self.count_spin.valueChanged.connect(self._show_size)
        self._show_size()
        self._refresh_remark()

    def _as_shown(self, name: str) -> Family:
        """The parameters of a family, with the position that is shown for the known pairs."""
        fields, spectrum = self._document.display.fields, self._document.scaled_spectrum
        chosen = fields[name]
        if spectrum is None:
            return chosen
        known = chosen.resolved(spectrum, fields)
        return replace(chosen, **{each: getattr(known, each) for each in chosen.position})

    def _show_size(self) -> None:
        document, count = self._document, self.count_spin.value()
        size = round(self._mesh.n_vertices / count)
        top, _ = document.solve.translation().eigenvalue(document.solve.target)
        self.size_label.setText(
            f"About {counted(size, 'vertex')} each, plus the overlap, up to"
            f" λ = {format_quantity(top, document.unit, -2)}, the target of the Mesh panel."
        )

    def job(self) -> PiecesJob:
        """The chosen job."""
        document = self._document
        family = self._families[self.family_combo.currentData()]
        return PiecesJob(
            self._mesh, self.path, family, self.count_spin.value(), document.solve.target,
            document.solve.operator, document.repairs,
        )  # fmt: skip

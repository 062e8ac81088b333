"""Controls of the eigenfunction on the render."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QPushButton,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import Facts, format_wavelength, note, show_note
from meshmash_viewer.app.tabs.field_stepper import FieldStepper
from meshmash_viewer.app.tabs.play_button import PlayButton
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.spectrum import Spectrum, first_nonzero
from meshmash_viewer.units import counted, format_quantity, subscript

__all__ = ["EigenfunctionTab"]


class EigenfunctionTab(FieldStepper):
    """Scroll the eigenfunctions that have converged, and read what each one is."""

    family = Eigenfunctions

    def _build(self) -> None:
        column = self._build_head(
            ("eigenvalue_label", "Eigenvalue"), ("eigenvector_slider", "Eigenfunction")
        )
        self.slider.setToolTip("Wheel or arrow keys: one eigenfunction; Ctrl + wheel or PgDn: ten")

        row = QHBoxLayout()
        row.setSpacing(theme.GAP)
        self.spin = self._index_spin(
            "eigenvector_spin", "Index of the eigenfunction, counted from 0"
        )
        self.play_button = PlayButton(self._document, "eigenvector_play_button", self)
        self.flip_button = QPushButton("Flip sign", self)
        self.flip_button.setObjectName("flip_button")
        self.flip_button.setAccessibleName("Draw the eigenfunction with the other sign")
        self.flip_button.setToolTip("Draw it with the other sign, which is as good (F)")
        self.flip_button.setCheckable(True)
        self.flip_button.clicked.connect(self._flip)
        row.addWidget(self.spin)
        row.addWidget(self.play_button)
        row.addStretch(1)
        row.addWidget(self.flip_button)
        column.addLayout(row)

        self.facts = Facts(
            {
                "wavelength_label": "Wavelength 2π/√λ",
                "residual_label": "Relative residual",
                "converged_label": "Eigenpairs",
            },
            self,
        )
        column.addWidget(self.facts)
        self.nodal_check = QCheckBox("Nodal lines, where it is zero", self)
        self.nodal_check.setObjectName("nodal_lines_check")
        self.nodal_check.setAccessibleName("Draw nodal lines")
        self.nodal_check.toggled.connect(self._toggle_nodal)
        column.addWidget(self.nodal_check)
        self.multiplet_note = note("multiplet_label", "muted", self)
        self.preview_note = note("preview_label", "warning", self)
        column.addWidget(self.multiplet_note)
        column.addWidget(self.preview_note)
        column.addStretch(1)

    # -- from the person --------------------------------------------------------------------

    def _flip(self) -> None:
        self._document.flip()

    def _toggle_nodal(self, on: bool) -> None:
        self._document.display.nodal_lines = on

    # -- from the model ---------------------------------------------------------------------

    def refresh(self) -> None:
        """Show what the model holds."""
        spectrum, display = self._document.spectrum, self._document.display
        length = 0 if spectrum is None else len(spectrum)
        chosen = display[Eigenfunctions]
        index = min(chosen.index, max(length - 1, 0))
        for control in (self.slider, self.spin):
            with QSignalBlocker(control):
                if control.maximum() != max(length - 1, 0):
                    control.setRange(0, max(length - 1, 0))
                control.setValue(index)
        suffix = f" of {length - 1}" if length else ""
        if self.spin.suffix() != suffix:
            self.spin.setSuffix(suffix)
        self.flip_button.setChecked(index in chosen.flipped)
        with QSignalBlocker(self.nodal_check):
            self.nodal_check.setChecked(display.nodal_lines)
        if spectrum is not None and length:
            self._describe(spectrum, index)
        else:
            self.title.setText("λ")
            for name in ("wavelength_label", "residual_label", "converged_label"):
                self.facts.show_value(name, "")
            show_note(self.multiplet_note, "")
            show_note(self.preview_note, "")

    def _describe(self, spectrum: Spectrum, index: int) -> None:
        mesh = self._document.mesh
        unit = mesh.unit if mesh is not None else ""
        value = float(spectrum.eigenvalues[index])
        zeros = first_nonzero(spectrum)
        exact = spectrum.is_exact(index)
        approximate = "=" if exact else "≈"
        if index < zeros:
            text, value = "0", 0.0
        else:
            text = format_quantity(value, unit, -2)
        self.title.setText(f"λ{subscript(index)} {approximate} {text}")
        self.facts.show_value("wavelength_label", format_wavelength(value, unit))
        residual = float(spectrum.residuals[index]) if index < len(spectrum.residuals) else None
        self.facts.show_value(
            "residual_label",
            "" if residual is None or not exact else f"{residual:.1e}",
        )
        self.facts.show_value("converged_label", _converged(spectrum))
        show_note(self.multiplet_note, _multiplet(spectrum, index, zeros))
        show_note(
            self.preview_note,
            ""
            if exact
            else f"Preview: from a coarse mesh, λ within about {100.0 * spectrum.error:.0f} %. "
            "The exact eigenfunctions take its place as they converge.",
        )


def _converged(spectrum: Spectrum) -> str:
    if spectrum.preview and not spectrum.n_exact:
        return f"{len(spectrum):,} approximate"
    if spectrum.preview and spectrum.complete:
        return f"{spectrum.n_exact:,}, complete; {len(spectrum):,} with a preview"
    if spectrum.preview:
        return f"{spectrum.n_exact:,} of {spectrum.total or len(spectrum):,} so far"
    if spectrum.complete:
        return f"{len(spectrum):,}, complete"
    of = f" of {spectrum.total:,}" if spectrum.total else ""
    return f"{len(spectrum):,}{of} so far"


def _multiplet(spectrum: Spectrum, index: int, zeros: int) -> str:
    if index < zeros:
        if zeros == 1:
            return "Zero mode: constant over the surface, which is in one piece."
        return (
            f"λ₀…λ{subscript(zeros - 1)} are zero: one constant function for each of "
            f"{counted(zeros, 'component')}; any mixture of them is as good."
        )
    found = spectrum.multiplet(index)
    if found is None:
        return ""
    return (
        f"λ{subscript(found.first)}…λ{subscript(found.last)} within {found.gap:.0e}: "
        "any rotation of these is as good."
    ).replace("e-0", "e-")

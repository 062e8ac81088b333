"""The Mesh panel: facts and health of the mesh, the Laplacian, the decomposition and its proof."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QSizePolicy,
    QStackedLayout,
    QVBoxLayout,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import native_keys
from meshmash_viewer.app.arrangement import progress_text, show_progress
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.document_controls import UnitCombo, written_cost
from meshmash_viewer.app.controls.make import Part, column, grid, row
from meshmash_viewer.app.controls.number_field import NumberField, has_refused
from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.panels.health_table import HealthTable
from meshmash_viewer.app.panels.target_box import TargetBox, quarter_steps
from meshmash_viewer.io.links import shown_path
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import expected_bytes
from meshmash_viewer.spectral import cost
from meshmash_viewer.units import counted, format_lengths, format_quantity

#: Least width in pixels.
_WIDTH = 280


class MeshPanel(QWidget):
    """Left panel; its foot with the Compute button and the proof does not scroll."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "mesh_panel", "Mesh")
        self._document = document
        self._refused = False

        self.target_box = TargetBox(document)
        self.health = HealthTable(document)
        self.cost_label = make.reserved_note("cost_label", 2, "muted", "Estimated memory and time")
        self.undo_button = make.button(
            "Undo repair",
            "undo_repair_button",
            "Undo the last repair",
            document.undo_repair,
            role="link",
        )
        make.keep_room(self.undo_button)
        margins = theme.MARGIN, theme.GAP, theme.MARGIN, theme.MARGIN
        self._content = make.holder(
            column(
                *self._build_facts(),
                self._heading("Decomposition"),
                self.target_box,
                self._build_part(),
                self.cost_label,
                self._heading("Health", self.undo_button),
                self.health,
                self._heading("Laplacian"),
                self._build_operator(),
                None,
                spacing=6,
                margins=margins,
            )
        )
        scroll = make.scroll(self._content)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setLayout(column((scroll,), make.line(), self._build_foot(), spacing=0))
        self._content.installEventFilter(self)

        work, solve = document.work.changed, document.solve.changed
        signals = document.mesh_changed, solve, document.spectrum_changed
        for each, refresh in (
            (document.mesh_changed, self._refresh_facts),
            (solve, self._refresh_operator),
            (document.history.changed, self._refresh_undo),
            (signals, self._refresh_cost),
            ((*signals, work), self._refresh_job),
            ((*signals, document.selection.changed, work), self._refresh_part),
        ):
            follow(each, refresh)
            refresh()
        self._fit()

    def _fit(self) -> None:
        """Set a width that cuts off no row, as the contents scroll only vertically."""
        self.setMinimumWidth(max(_WIDTH, self._content.minimumSizeHint().width() + 16))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Adapt the width to the contents, which change with counts, unit and style."""
        if watched is self._content and event.type() == QEvent.Type.LayoutRequest:
            self._fit()
        return super().eventFilter(watched, event)

    # -- facts --------------------------------------------------------------------------------

    def _heading(self, text: str, *widgets: QWidget) -> QHBoxLayout:
        return row((make.heading(text),), *widgets, margins=(0, theme.GAP, 0, 0))

    def _build_facts(self) -> tuple[Part, ...]:
        self.name_label = make.label("mesh_name_label", "Name of the mesh", role="heading")
        self.path_label = make.label("mesh_path_label", "Path of the mesh", role="muted")
        # the text may be shortened, so it cannot be selected
        make.offer_copy(
            self.path_label, lambda: self.path_label.toolTip() or self.path_label.text()
        )
        self._facts: dict[str, QLabel] = {}
        for name in ("Vertices", "Faces", "Area", "Extent"):
            label = make.label(
                f"mesh_{name.lower()}_label",
                name,
                "–",
                selectable=True,
                alignment=Qt.AlignmentFlag.AlignRight,
            )
            # a long value is cut off and does not widen the panel; the tooltip shows it whole
            label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
            self._facts[name] = label
        self.unit_combo = UnitCombo(self._document)
        facts = ((QLabel(name), label) for name, label in self._facts.items())
        unit = QLabel("Unit"), row(None, self.unit_combo)
        return self.name_label, self.path_label, grid(*facts, unit, spacing=(theme.GAP, 3))

    def _refresh_undo(self) -> None:
        steps = self._document.undo_repair_steps
        later, more = counted(steps - 1, "later change"), steps > 1
        self.undo_button.setText("Undo repair" + (f" and {steps - 1} more" if more else ""))
        self.undo_button.setToolTip(f"Undo the last repair and {later}" if more else "")
        self.undo_button.setVisible(steps > 0)

    def _refresh_facts(self) -> None:
        ready = self._document.ready
        if ready is None:
            self.name_label.setText("No mesh open")
            self.path_label.setText(f"Drop one on the window, or press {native_keys('Ctrl+O')}.")
            self.path_label.setToolTip("")
            for label in self._facts.values():
                label.setText("–")
            return
        mesh, health = ready.mesh, ready.health
        self.name_label.setText(mesh.name or "Mesh in memory")
        where = shown_path(ready.path) if ready.path else "in memory, not in a file"
        self.path_label.setToolTip(where)
        self.path_label.setText(
            self.path_label.fontMetrics().elidedText(where, Qt.TextElideMode.ElideMiddle, 244)
        )
        extent = mesh.bounds[1] - mesh.bounds[0]
        left = "" if mesh.numbering is None else f" of {mesh.n_file_vertices:,} in the file"
        self._facts["Vertices"].setText(f"{health.n_vertices:,}{left}")
        self._facts["Faces"].setText(f"{health.n_faces:,}")
        self._facts["Area"].setText(format_quantity(health.area, mesh.unit, 2, 4))
        self._facts["Extent"].setText(format_lengths(extent, mesh.unit))
        for label in self._facts.values():
            label.setToolTip(label.text())

    # -- the part that is computed ------------------------------------------------------------

    def _build_part(self) -> QVBoxLayout:
        document = self._document
        self.part_label = make.label("part_label", "Vertices with eigenpairs", role="muted")
        self.part_label.setToolTip("Selected vertices without a selected face are left out.")
        self.selection_button = make.button(
            "Compute on the selection",
            "compute_selection_button",
            "Compute eigenpairs on the selected vertices",
            lambda: document.take_part(document.selection.mask, then_compute=True),
            role="link",
            tip="The boundary of the part is free; other vertices have no value",
        )
        self.whole_button = make.button(
            "On the whole mesh",
            "compute_whole_button",
            "Return to the eigenpairs of the whole mesh, and compute the missing ones",
            lambda: document.take_part(None, then_compute=True),
            role="link",
        )
        # stacked, so that they do not widen the panel
        buttons = row(self.selection_button, None), row(self.whole_button, None)
        return column(self.part_label, *buttons, spacing=0)

    def _refresh_part(self) -> None:
        document = self._document
        part, selected, idle = document.part_mesh, document.selection.mask, not document.work.job
        self.part_label.setVisible(part is not None)
        if part is not None:
            total = counted(part.n_vertices, "vertex")
            self.part_label.setText(f"On {document.solve.n_vertices:,} of {total}")
        other = selected is not None and (part is None or (selected != part.referenced).any())
        offered = ((self.whole_button, part is not None), (self.selection_button, bool(other)))
        for button, shown in offered:
            if button.hasFocus() and not (shown and idle):
                self.window().setFocus()  # Qt would focus the next control, and scroll to it
            button.setVisible(shown)
            button.setEnabled(idle)

    # -- the Laplacian ------------------------------------------------------------------------

    def _build_operator(self) -> QHBoxLayout:
        self.robust_check = make.check(
            "Robust",
            "robust_check",
            "Robust Laplacian",
            self._choose_operator,
            tip="Sharp & Crane 2020: right for any triangle mesh, also non-manifold ones. "
            "Without it, the plain cotangent Laplacian, for clean meshes only",
        )
        self.mollify_spin = NumberField(
            "mollify_spin",
            "Mollify factor",
            step=quarter_steps,
            share=True,
            tip="Length added to edges, relative to the mean edge length, so that no triangle is "
            "degenerate (no unit; 1e-05 suits nearly every mesh)",
        )
        self.mollify_spin.setFixedWidth(96)
        self.mollify_spin.bounds = (1e-15, 1.0)
        self.mollify_label = QLabel("Mollify")
        self.mollify_spin.edited.connect(self._choose_operator)
        return row(self.robust_check, None, self.mollify_label, self.mollify_spin)

    def _choose_operator(self) -> None:
        robust, factor = self.robust_check.isChecked(), self.mollify_spin.value
        assert factor is not None  # the field is never empty
        self._document.solve.operator = OperatorOptions(robust, factor)

    def _refresh_operator(self) -> None:
        operator = self._document.solve.operator
        make.show_quietly(self.robust_check, operator.robust)
        self.mollify_spin.show_value(operator.mollify_factor)
        self.mollify_spin.setEnabled(operator.robust)
        self.mollify_label.setEnabled(operator.robust)

    # -- cost, progress and proof -------------------------------------------------------------

    def _refresh_cost(self) -> None:
        ready, target = self._document.solved, self._document.solve.target
        if ready is None or not ready.health.area > 0.0:
            self.cost_label.setText("")
            return
        n = ready.health.n_vertices
        translation = self._document.solve.translation()
        if self._document.solve.is_computed:
            self.cost_label.setText(f"Computed: {counted(len(translation.eigenvalues), 'pair')}.")
            return
        shown = self._document.display.fields.values()
        columns = sum(getattr(each, each.counted) for each in shown if each.counted)
        window = cost.written_bytes(expected_bytes(n, columns))
        self.cost_label.setText(
            f"Takes {written_cost(self._document, target)}. Live features then take {window}."
        )

    def _build_foot(self) -> QWidget:
        self.compute_button = make.button(
            "Compute",
            "compute_button",
            "Compute eigenpairs",
            self._compute,
            role="primary",
            tip=f"Decompose the mesh ({native_keys('Ctrl+Return')})",
        )
        self.compute_button.pressed.connect(self._note_refusal)
        self.cancel_button = make.button(
            "Cancel",
            "cancel_button",
            "Cancel the running task",
            self._document.work.cancel,
            tip=f"Stop, and keep converged eigenpairs ({native_keys('Esc')})",
        )
        buttons = row(self.compute_button, self.cancel_button)
        buttons.setStretch(0, 2)
        buttons.setStretch(1, 1)
        self.progress_bar = QProgressBar(textVisible=False)
        theme.named(self.progress_bar, "progress_bar", "Progress")
        make.keep_room(self.progress_bar)
        # both labels share one place of fixed size, so that the buttons above do not move
        self.progress_label = make.reserved_note("progress_label", 4, "muted", "Running task")
        self.proof_label = make.reserved_note("proof_label", 4, "proof", "Proof of the eigenpairs")
        self.proof_label.setToolTip(
            "Pairs computed, whether the count is certified complete, the worst residual "
            "‖Lφ − λMφ‖ / λ‖Mφ‖, and the largest entry of |ΦᵀMΦ − I|"
        )
        self.proof_label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        make.offer_copy(self.proof_label)
        self.resolution_button = make.button(
            "Measure the resolution",
            "resolution_button",
            "Measure on a finer mesh which eigenvalues the mesh resolves",
            self._document.solve.measure,
            role="link",
        )
        self._status_stack = QStackedLayout()
        self._status_stack.addWidget(self.proof_label)
        self._status_stack.addWidget(self.progress_label)
        measure = row(self.resolution_button, None)
        parts = buttons, self.progress_bar, self._status_stack, measure
        foot = make.holder(column(*parts, spacing=6, margins=(theme.MARGIN,) * 4))
        return theme.named(foot, "mesh_panel_foot")

    def _note_refusal(self) -> None:
        """Record whether pressing the button ended the typing of an invalid number."""
        self._refused = has_refused(self)

    def _compute(self) -> None:
        if not self._refused:  # the user has not seen yet that the number was replaced
            self._document.solve.compute()

    def _refresh_job(self) -> None:
        state = self._document.work.job
        for button, usable in (
            (self.compute_button, self._document.solve.can_compute),
            (self.cancel_button, state is not None and not state.cancelling),
        ):
            if not usable and button.hasFocus():
                self.window().setFocus()  # Qt would focus the next control, which takes keys
            button.setEnabled(usable)
        self.progress_bar.setVisible(state is not None)
        self._status_stack.setCurrentIndex(0 if state is None else 1)
        if state is not None:
            show_progress(self.progress_bar, state)
            self.progress_label.setText(progress_text(state))
        self._refresh_proof()

    def _refresh_proof(self) -> None:
        spectrum, state = self._document.spectrum, self._document.work.job
        text, role, mesh = "", "muted", self._document.mesh
        exact = 0 if spectrum is None else len(spectrum.exact)
        more = 0 if spectrum is None else len(spectrum) - exact
        previewed = f" · {more:,} more from a preview" if more else ""
        if mesh is not None and spectrum is not None and spectrum.certificate.method != "none":
            text = spectrum.exact.proof(mesh.unit) + previewed
            role = "proof" if spectrum.complete else "warning"
        elif spectrum is not None and state is None and more and not exact:
            text = f"A preview of {counted(more, 'pair')}: Compute makes them exact."
        elif spectrum is not None and state is None and len(spectrum):
            requested = f" of {spectrum.total:,}" if spectrum.total else ""
            solve = self._document.solve
            text = f"{counted(exact, 'pair')}{requested}, stopped early"
            if spectrum.target == solve.asked and spectrum.operator == solve.operator:
                text += ": Compute resumes here"
            text += f"{previewed}."
            role = "warning"
        elif state is None and self._document.ready is None:
            text = "Open a mesh to compute its eigenfunctions."
        elif state is None and spectrum is None:
            text = "Nothing computed yet."
        self.proof_label.setText(text)
        count = self._document.solve.measurable
        if not count and self.resolution_button.hasFocus():
            self.window().setFocus()  # Qt would focus the next control, and scroll to it
        self.resolution_button.setEnabled(count > 0)
        if spectrum is not None and count:
            which = "" if count == exact else f"Of the first {counted(count, 'pair')}. "
            self.resolution_button.setToolTip(
                f"{which}The proof is about the matrices, and the number of resolved pairs an"
                " estimate. This solves the mesh with every face cut in four, which takes several"
                " times as long as the decomposition"
            )
        theme.change_role(self.proof_label, role)

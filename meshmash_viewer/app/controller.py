"""Controller of one mesh: computes the displayed field in a thread and draws it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from PySide6.QtCore import QObject, QTimer, Signal

from meshmash_viewer.app.executor import Call, Slot
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.view.caption import Caption, caption_of
from meshmash_viewer.errors import InputError
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, FieldRequest, LiveFeatures, compute_field, request_of
from meshmash_viewer.model.limits import Limits
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.progress import Cancelled

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView
    from meshmash_viewer.app.view.style import ColorMap

#: Seconds without a newer request after which the table for the last request is built.
_REST = 0.15
#: Milliseconds after which the title indicates that a field is being computed.
_LATE = 200


class Link(Protocol):
    """Interface of `app.second_view.SecondView`, which links the fields of two meshes."""

    def draw(self, source: Controller) -> None: ...

    def adapted(
        self, source: Controller, field: Field, limits: Limits, colormap: ColorMap
    ) -> tuple[Field, Limits, ColorMap]: ...


class Colored(NamedTuple):
    """A field with its colours and caption, for a look (`Display.look`)."""

    field: Field
    look: tuple[Any, ...]
    limits: Limits
    colormap: ColorMap
    caption: Caption


class Controller(QObject):
    """Controller that draws the mesh, the pins and the displayed field of a document.

    A tick of a slider changes the document's display, whose signal calls `refresh`. A thread
    computes the newest requested field with limits and caption (`_computed`). `_take` receives it,
    and drops a field of another mesh or family. `show` calls `draw`, through `link` if two meshes
    are compared. `draw` passes the field to the view. Another thread builds tables that make
    the next fields fast; a field computed without its table is then computed again.
    """

    #: The field passed to the view, or None, and its limits (low, high).
    drawn = Signal(object, object)

    def __init__(self, document: Document, view: MeshView, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document, self._view = document, view
        #: The last computed field, with its colours.
        self._colored: Colored | None = None
        self.live = LiveFeatures()
        #: Whether the requested field takes long or cannot be computed.
        self.late = False
        #: Link to another mesh; None if no meshes are compared.
        self.link: Link | None = None
        self._wanted: FieldRequest | None = None
        self._shown: tuple[Field, Caption] | None = None
        self._patience = QTimer(self, singleShot=True, interval=_LATE)
        self._patience.timeout.connect(self._announce)
        self._fields = Slot(self, "fields", one_core=True)
        self._tables = Slot(self, "tables")
        listen(document.mesh_changed, self.show_mesh)
        listen(document.pins.changed, self._show_pins)
        listen(document.selection.changed, self._show_selection)
        events = document.display.events
        requested = (
            events.kind, events.fields, document.spectrum_changed, document.mesh_changed,
            document.pins.changed,
        )  # fmt: skip
        listen(requested, self.refresh)
        colors = events.policies, events.diverging_colormap, events.sequential_colormap
        listen((events.hide_small, document.hiding.changed), self._hide)
        listen(events.cut, self._show_cut)
        listen((*colors, events.log_scales, events.nodal_lines), self.show)

    @property
    def field(self) -> Field | None:
        """The last computed field."""
        return None if self._colored is None else self._colored.field

    @property
    def comes(self) -> bool:
        """Whether the requested field is not ready yet."""
        field = self.field
        return self._wanted is not None and (field is None or field.request != self._wanted)

    @property
    def idle(self) -> bool:
        """Whether the requested field is ready, and nothing is being computed."""
        busy = self._fields.working or self._tables.working or self.comes
        return not busy and (self._wanted is not None or self.field is None)

    # -- a tick -------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Request the field selected in the document, unless it is requested already."""
        request = request_of(self._document)
        if request == self._wanted:
            return
        before, self._wanted = self._wanted, request
        if request is None or (before is not None and not before.same_mesh(request)):
            self._fields.drop()
            self._tables.drop()
            self.live.forget()
            self._accept(None)
        if request is not None:
            if not self._patience.isActive():
                self._patience.start()
            self._compute_field(request)

    def _compute_field(self, request: FieldRequest) -> None:
        self._fields.submit(
            lambda _: self._computed(request), partial(self._take, request), self._fail
        )

    def _computed(self, request: FieldRequest) -> Colored | None:
        """Compute a field with limits and caption; runs in a thread."""
        field = compute_field(request, self.live)
        return None if field is None else self._color(field)

    def _color(self, field: Field) -> Colored:
        """Compute limits and caption of a field, unless the field has cached them."""
        display = self._document.display
        look = display.look  # read first: it may change meanwhile if this runs in a thread
        limits, colormap = field.colors(display)
        caption = caption_of(field, limits, colormap, lined=display.nodal_lines)
        return Colored(field, look, limits, colormap, caption)

    def _take(self, request: FieldRequest, answer: Colored | None) -> None:
        """Receive a field; the answer is None if its table has to be built first."""
        wanted, shown = self._wanted, self.field
        assert wanted is not None  # else the calls are dropped
        if not self.live.prepared(wanted):
            self._prepare_table(wanted)
        if request != wanted and shown is not None and shown.request == wanted:
            return  # the wanted field is still displayed
        # show the field of an earlier slider position, but no field of another family
        if answer is not None and request.family.name == wanted.family.name:
            self._accept(answer)
            if request != wanted:
                self._patience.start()

    def _accept(self, colored: Colored | None) -> None:
        self._colored, self.late = colored, False
        self._patience.stop()
        self._view.set_awaited("")
        self.show()

    def show(self) -> None:
        """Draw the last computed field, through `link` if two meshes are compared."""
        if self.link is None:
            self.draw()
        else:
            self.link.draw(self)

    def draw(self) -> None:
        """Pass the field to the view, if it has changed."""
        colored, mesh, display = self._colored, self._document.mesh, self._document.display
        if colored is None or mesh is None or len(colored.field.values) != mesh.n_vertices:
            self._shown = None
            self._view.set_field(None)
            self.drawn.emit(None, Limits(0.0, 1.0))
            return
        if colored.look != display.look:
            colored = self._colored = self._color(colored.field)
        field, _, limits, colormap, caption = colored
        if self.link is not None:
            field, limits, colormap = self.link.adapted(self, field, limits, colormap)
            caption = caption_of(field, limits, colormap, lined=display.nodal_lines)
        if (field, caption) != self._shown:
            self._shown = field, caption
            self._view.set_field(field, limits, colormap, caption)
            self.drawn.emit(field, limits)

    # -- slow fields, and faults --------------------------------------------------------------

    def _announce(self) -> None:
        """Show that the requested field is being computed."""
        if self._wanted is not None:
            try:
                title = self._wanted.description.title
            except InputError:  # reported by the thread
                title = self._wanted.family.label
            self._view.set_awaited(title)
            self._give_up_waiting()

    def _fail(self, fault: Exception) -> None:
        self._patience.stop()
        self._view.set_awaited("")
        named = "" if isinstance(fault, InputError) else f" ({type(fault).__name__})"
        text = f"The field cannot be computed{named}: {fault}"
        wanted = self._wanted
        self._document.notices.show(
            Notice(text, Severity.ERROR, holds=lambda: self._wanted is wanted)
        )
        self._give_up_waiting()

    def _give_up_waiting(self) -> None:
        self.late = True
        if self.link is not None:
            self.link.draw(self)

    # -- tables -------------------------------------------------------------------------------

    def _prepare_table(self, request: FieldRequest) -> None:
        """Build the table for a request once no newer one has come for a while."""

        def prepare(call: Call) -> None:
            if not call.stays(_REST):
                raise Cancelled
            self.live.prepare(request, call.cancelled)

        self._tables.submit(prepare, lambda _: self._improve(request), self._fail)

    def _improve(self, request: FieldRequest) -> None:
        """Compute the field again if it was computed without the new table."""
        wanted, field = self._wanted, self.field
        assert wanted is not None  # else the calls are dropped
        if wanted.family.name == request.family.name and (
            field is None or field.draft or field.request != wanted
        ):
            self._compute_field(wanted)

    # -- the mesh -----------------------------------------------------------------------------

    def show_mesh(self) -> None:
        """Draw the mesh; keep the camera if only the unit has changed."""
        ready, before = self._document.ready, self._view.mesh
        if ready is not None:
            camera, turned = self._view.camera(), self._view.turned_by_hand
            self._view.set_mesh(ready.mesh, ready.normals, self._document.hidden)
            self._show_pins()
            self._show_selection()
            self._show_cut()
            self._shown = None
            if before is not None and before.vertices is ready.mesh.vertices and camera:
                self._view.set_camera(camera)
                # a new colour bar refits the view only if the user has not moved the camera
                self._view.turned_by_hand = turned
                self.draw()

    def _hide(self) -> None:
        """Update the hidden vertices, and the limits, which depend on visible vertices only."""
        hidden = self._document.hidden
        if self._document.is_shown(self._view.mesh) and self._view.renderer.hidden is not hidden:
            self._view.set_hidden(hidden)
            self.refresh()

    def _show_pins(self) -> None:
        self._view.set_pins(self._document.pins.placed)

    def _show_selection(self) -> None:
        if self._document.is_shown(self._view.mesh):
            self._view.set_selected(self._document.selection.mask)

    def _show_cut(self) -> None:
        mesh = self._document.mesh
        if mesh is not None and self._document.is_shown(self._view.mesh):
            self._view.set_cut(self._document.display.cut.plane(mesh.bounds))

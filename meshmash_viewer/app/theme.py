"""Light and dark theme: colours, spacing, fonts and icons of widgets, plots and render.

Panels read `palette` and `is_dark`, redraw on ``notifier().changed``, and set roles of labels
instead of styles: ``with_role(QLabel("Health"), "heading")``. The roles are "heading" (of a
section), "muted" (an explanation), "value" (a number in a column), "proof" and "warning".
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, lru_cache
from pathlib import Path
from string import Template
from typing import Any, ClassVar, Generic, TypeVar
from weakref import WeakKeyDictionary

import shiboken6
from PySide6.QtCore import QByteArray, QObject, QRectF, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor, QFont, QIcon, QPainter, QPalette, QPixmap
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLabel,
    QListView,
    QStyle,
    QStyleFactory,
    QWidget,
)

#: Gap between controls and margin of a panel, in logical pixels.
GAP = 8
MARGIN = 12

_FOLDER = Path(__file__).parent
#: Pixels of an icon per logical pixel.
_RATIO = 2
WidgetType = TypeVar("WidgetType", bound=QWidget)
Kind = TypeVar("Kind")


class Mode(StrEnum):
    """Choice of the theme: the system's theme, light or dark."""

    SYSTEM = "system"
    LIGHT = "light"
    DARK = "dark"


class _Color(Generic[Kind]):
    """A colour, or a tuple of colours, for the light and for the dark theme."""

    def __init__(self, light: Kind, dark: Kind) -> None:
        self._pair = light, dark

    def __get__(self, palette: Palette, owner: object) -> Kind:
        return self._pair[palette.dark]


@dataclass(frozen=True)
class Palette:
    """Colours of the theme by their use, as ``#rrggbb``."""

    dark: bool

    window = _Color("#f3f5f7", "#1a1e24")
    surface = _Color("#ffffff", "#21262d")
    raised = _Color("#ffffff", "#2a3038")
    field = _Color("#ffffff", "#1a1e24")
    border = _Color("#dde2e8", "#353c46")
    border_strong = _Color("#bcc5cf", "#505a67")
    text = _Color("#1b232d", "#e3e8ee")
    muted = _Color("#5a6675", "#9ca8b6")
    disabled = _Color("#a2abb6", "#626d7a")
    accent = _Color("#1c66a8", "#5ba7e4")
    accent_hover = _Color("#17578f", "#78b9ee")
    on_accent = _Color("#ffffff", "#0d141b")
    selection = _Color("#d6e6f5", "#264663")
    scene = _Color("#eceff3", "#14171c")
    missing = _Color("#b9bfc7", "#59616b")
    information = _Color("#1c66a8", "#7cbcf0")
    information_back = _Color("#e8f1fa", "#1f3245")
    warning = _Color("#8a5a00", "#f0bd58")
    warning_back = _Color("#fdf3dc", "#3b3017")
    error = _Color("#b3261e", "#ff9b92")
    error_back = _Color("#fdebe9", "#45201f")
    good = _Color("#1b7a4b", "#62c793")
    # in plots
    axis = _Color("#3c4855", "#b4bfcb")
    reference = _Color("#8a95a2", "#7f8b99")
    marker = _Color("#d5530b", "#ff9a57")
    hatch = _Color("#c9a227", "#d8b74a")
    series = _Color(
        ("#1c66a8", "#d5530b", "#1b7a4b", "#a3428b", "#8a6d00", "#0b7f99", "#5b4db0"),
        ("#5ba7e4", "#ff9a57", "#62c793", "#dd8ac8", "#e0c34f", "#55c5dc", "#a79bf0"),
    )


class _Notifier(QObject):
    """Object whose signal `changed` is emitted when the colours have changed."""

    changed = Signal()


class _State:
    """Global state of the theme."""

    mode = Mode.SYSTEM
    dark = False
    #: Whether the application was made by this package.
    ours = False
    style: QStyle | None = None
    #: Whether each styled object (the application, or a window) is dark; None before styling.
    styled: ClassVar[WeakKeyDictionary[Any, bool | None]] = WeakKeyDictionary()
    notifier = _Notifier()


def notifier() -> _Notifier:
    """Return the object whose ``changed`` signal is emitted after every change of the theme."""
    return _State.notifier


def mode() -> Mode:
    """Return the chosen mode."""
    return _State.mode


def is_dark() -> bool:
    """Return whether the current theme is dark."""
    return _State.dark


def palette() -> Palette:
    """Return the current colours."""
    return Palette(_State.dark)


@contextmanager
def light() -> Iterator[None]:
    """Use the light palette for pictures within the context; widgets are not restyled."""
    before, _State.dark = _State.dark, False
    try:
        yield
    finally:
        _State.dark = before


def pad_fields(parent: QWidget) -> None:
    """Add margins to spin boxes and lists of combo boxes; style sheets cannot set these margins."""
    for spin in parent.findChildren(QAbstractSpinBox):
        spin.lineEdit().setTextMargins(5, 0, 8 if spin.property("role") == "bare" else 0, 0)
    for combo in parent.findChildren(QComboBox):
        view = combo.view()
        if isinstance(view, QListView):
            view.setSpacing(3)


def with_role(widget: WidgetType, role: str) -> WidgetType:
    """Set the role of a widget; return the widget."""
    widget.setProperty("role", role)
    if isinstance(widget, QLabel):
        # labels with a style sheet are indented by default, unlike other labels
        widget.setIndent(0)
    return widget


def change_role(widget: QWidget, role: str) -> None:
    """Change the role of a displayed widget."""
    if widget.property("role") != role:
        restyle(with_role(widget, role))


def restyle(widget: QWidget) -> None:
    """Apply the style after a change of properties."""
    widget.style().unpolish(widget)
    widget.style().polish(widget)


def named(
    widget: WidgetType, name: str, accessible: str = "", *, role: str = "", tip: str = ""
) -> WidgetType:
    """Set ``objectName``, accessible name, role and tooltip of a widget; return the widget.

    Empty arguments are ignored.
    """
    widget.setObjectName(name)
    if accessible:
        widget.setAccessibleName(accessible)
    if tip:
        widget.setToolTip(tip)
    return with_role(widget, role) if role else widget


def tabular(font: QFont) -> QFont:
    """Return a copy of a font with digits of equal width."""
    copy = QFont(font)
    copy.setFeature(QFont.Tag("tnum"), 1)
    return copy


def set_mode(chosen: Mode | str) -> None:
    """Choose the mode."""
    _State.mode = Mode(chosen)
    if _State.style is not None:
        _refresh()


def apply(application: QApplication) -> None:
    """Style an application made by this package, and follow changes of the system's theme."""
    _State.ours = True
    _begin(application)


def style_window(window: QWidget) -> None:
    """Style a window. If the application was made by other code, nothing else is styled."""
    if not _State.ours:
        _begin(window)
    _refresh()


def _begin(target: QApplication | QWidget) -> None:
    if _State.style is None:
        _State.style = QStyleFactory.create("Fusion")
        QApplication.styleHints().colorSchemeChanged.connect(lambda _: _refresh())
    if isinstance(target, QApplication):
        target.setStyle("Fusion")
    else:
        target.setStyle(_State.style)
    target.setFont(tabular(target.font()))
    _State.styled[target] = None
    _refresh()


def _refresh() -> None:
    hints = QApplication.styleHints()
    wanted = {
        Mode.SYSTEM: Qt.ColorScheme.Unknown,
        Mode.LIGHT: Qt.ColorScheme.Light,
        Mode.DARK: Qt.ColorScheme.Dark,
    }[_State.mode]
    # also changes the desktop's title bars; X11 without a desktop has no colour scheme
    if _State.ours:
        with QSignalBlocker(hints):
            hints.setColorScheme(wanted)
    if _State.mode is Mode.SYSTEM:
        wanted = hints.colorScheme()
    _State.dark = wanted == Qt.ColorScheme.Dark
    changed = False
    for target, before in list(_State.styled.items()):
        if before == _State.dark or not shiboken6.isValid(target):
            continue
        changed = True
        _State.styled[target] = _State.dark
        colors, sheet = palette(), _style_sheet(palette(), target.font())
        if not _State.ours:
            # widgets with a style sheet use the application's palette, not the window's
            basics = f"QWidget {{ color: {colors.text}; }} QDialog, QTabBar QToolButton "
            basics += f"{{ background: {colors.window}; }} "
            basics += f"QMainWindow QTabBar {{ background: {colors.window}; }} "
            basics += f"QWidget:disabled {{ color: {colors.disabled}; }} "
            sheet = basics + sheet
        target.setPalette(_qt_palette(_State.dark))
        target.setStyleSheet(sheet)
    if changed:
        notifier().changed.emit()


@cache
def _qt_palette(dark: bool) -> QPalette:
    """Return the palette for Qt, cached because Qt caches drawings by palette."""
    colors = Palette(dark)
    role = QPalette.ColorRole
    result = QPalette()
    for which, color in {
        role.Window: colors.window,
        role.WindowText: colors.text,
        role.Base: colors.surface,
        role.AlternateBase: colors.window,
        role.Text: colors.text,
        role.PlaceholderText: colors.muted,
        role.Button: colors.raised,
        role.ButtonText: colors.text,
        role.BrightText: colors.error,
        role.Highlight: colors.accent,
        role.HighlightedText: colors.on_accent,
        role.Link: colors.accent,
        role.LinkVisited: colors.accent,
        role.ToolTipBase: colors.raised,
        role.ToolTipText: colors.text,
        role.Light: colors.raised,
        role.Midlight: colors.border,
        role.Mid: colors.border_strong,
        role.Dark: colors.border_strong,
        role.Shadow: colors.border_strong,
        role.Accent: colors.accent,
    }.items():
        result.setColor(which, QColor(color))
    for which in (role.WindowText, role.Text, role.ButtonText):
        result.setColor(QPalette.ColorGroup.Disabled, which, QColor(colors.disabled))
    result.setColor(QPalette.ColorGroup.Disabled, role.Highlight, QColor(colors.border_strong))
    return result


def _style_sheet(colors: Palette, font: QFont) -> str:
    points = font.pointSizeF() if font.pointSizeF() > 0 else 9.0
    names = [name for name, each in vars(Palette).items() if isinstance(each, _Color)]
    values = {name: getattr(colors, name) for name in names}
    values |= {"small": f"{points * 0.92:.2f}pt", "large": f"{points * 1.5:.2f}pt"}
    values |= {"mode": "dark" if _State.dark else "light", "folder": _FOLDER.as_posix()}
    sheet = (_FOLDER / "style.qss").read_text(encoding="utf-8")
    return Template(sheet).safe_substitute(values)


#: SVG content of 24 × 24 drawings by name.
ICONS: dict[str, str] = {
    "open": '<path d="M3 18V6a1 1 0 0 1 1-1h5l2 3h8a1 1 0 0 1 1 1v2"/>'
    '<path d="M3 18l3-7h16l-3 7a1 1 0 0 1-1 1H4a1 1 0 0 1-1-1z"/>',
    "export": '<path d="M12 15V4M8 8l4-4 4 4"/><path d="M5 14v5h14v-5"/>',
    "picture": '<rect x="3" y="5" width="18" height="14" rx="1.5"/>'
    '<circle cx="8.5" cy="10" r="1.6"/><path d="M4 18l6-5 3.5 3 3-2.5L20 17"/>',
    "reset": '<path d="M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5"/><circle cx="12" cy="12" r="2.5"/>',
    "select": '<path d="M4 8V4h4M16 4h4v4M20 16v4h-4M8 20H4v-4" stroke-dasharray="3 2"/>'
    '<path d="M9 8l8 5-3.6.9L11.7 17z"/>',
    "help": '<circle cx="12" cy="12" r="8.5"/><path d="M9.4 9.6a2.7 2.7 0 1 1 3.9 2.5'
    'c-.9.5-1.3 1-1.3 2"/><path d="M12 17v.3"/>',
    "close": '<path d="M6 6l12 12M18 6L6 18"/>',
    "copy": '<rect x="8" y="8" width="12" height="12" rx="1.5"/><path d="M16 8V4H4v12h4"/>',
    "information": '<circle cx="12" cy="12" r="8.5"/><path d="M12 11v6M12 7.2v.3"/>',
    "warning": '<path d="M12 4L2.8 19.5h18.4z"/><path d="M12 10v4.5M12 17v.3"/>',
    "error": '<circle cx="12" cy="12" r="8.5"/><path d="M8.8 8.8l6.4 6.4M15.2 8.8l-6.4 6.4"/>',
    "mesh": '<path d="M12 3l8.5 5v8L12 21l-8.5-5V8z"/><path d="M3.5 8l8.5 5 8.5-5M12 13v8"/>'
    '<path d="M12 3v10"/>',
    "eye": '<path d="M2.5 12c5-8 14-8 19 0-5 8-14 8-19 0z"/><circle cx="12" cy="12" r="3"/>',
    "closed eye": '<path d="M2.5 10.5c5 7 14 7 19 0M12 16v3.5M5.5 14l-2 3M18.5 14l2 3"/>',
    "lock": '<rect x="5.5" y="11" width="13" height="9" rx="1.5"/>'
    '<path d="M8.5 11V8a3.5 3.5 0 0 1 7 0v3"/>',
    "good": '<path d="M5 12.5l4.5 4.5L19 7.5"/>',
}


@lru_cache(maxsize=256)
def pixmap(name: str, color: str, size: int = 20) -> QPixmap:
    """Draw an icon: a key of `ICONS` or SVG content, stroke colour, size in logical pixels."""
    drawing = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 24 24" fill="none" '
        f'stroke="{color}" stroke-width="1.6" stroke-linecap="round" stroke-linejoin="round">'
        f"{ICONS.get(name, name)}</svg>"
    )
    image = QPixmap(_RATIO * size, _RATIO * size)
    image.fill(Qt.GlobalColor.transparent)
    painter = QPainter(image)
    QSvgRenderer(QByteArray(drawing.encode())).render(painter, QRectF(image.rect()))
    painter.end()
    image.setDevicePixelRatio(_RATIO)
    return image


def icon(name: str) -> QIcon:
    """Return an icon in the colours of the current theme."""
    colors = palette()
    result = QIcon(pixmap(name, colors.text))
    result.addPixmap(pixmap(name, colors.disabled), QIcon.Mode.Disabled)
    return result


@lru_cache(maxsize=1)
def application_icon() -> QIcon:
    """Return the icon of the program, drawn by assets/make_icon.py."""
    picture = QPixmap()
    picture.loadFromData((_FOLDER / "icon.png").read_bytes())
    return QIcon(picture)

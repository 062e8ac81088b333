"""Icons drawn from SVG paths in the colours of the theme."""

from __future__ import annotations

from functools import lru_cache
from importlib.resources import files

from PySide6.QtCore import QByteArray, QRectF, Qt
from PySide6.QtGui import QIcon, QPainter, QPixmap
from PySide6.QtSvg import QSvgRenderer

from meshmash_viewer.app import theme

#: SVG content of 24 × 24 drawings by name.
PATHS: dict[str, str] = {
    "open": '<path d="M3 18V6a1 1 0 0 1 1-1h5l2 3h8a1 1 0 0 1 1 1v2"/>'
    '<path d="M3 18l3-7h16l-3 7a1 1 0 0 1-1 1H4a1 1 0 0 1-1-1z"/>',
    "export": '<path d="M12 15V4M8 8l4-4 4 4"/><path d="M5 14v5h14v-5"/>',
    "picture": '<rect x="3" y="5" width="18" height="14" rx="1.5"/>'
    '<circle cx="8.5" cy="10" r="1.6"/><path d="M4 18l6-5 3.5 3 3-2.5L20 17"/>',
    "reset": '<path d="M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5"/><circle cx="12" cy="12" r="2.5"/>',
    "nodal": '<circle cx="12" cy="12" r="8.5"/><path d="M4 10c4-3.5 6 5 16 1.5"/>'
    '<path d="M11 3.6c-2 5 3 8 1 16.8"/>',
    "select": '<path d="M4 8V4h4M16 4h4v4M20 16v4h-4M8 20H4v-4" stroke-dasharray="3 2"/>'
    '<path d="M9 8l8 5-3.6.9L11.7 17z"/>',
    "flip": '<path d="M12 3v18"/><path d="M9 7L3.5 17H9z"/><path d="M15 7l5.5 10H15z"/>',
    "play": '<path d="M7 4.5v15l12-7.5z"/>',
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
def pixmap(name: str, color: str, size: int = 20, ratio: float = 2.0) -> QPixmap:
    """Draw an icon: a key of `PATHS` or SVG content, stroke colour, size in logical pixels."""
    drawing = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 24 24" fill="none" '
        f'stroke="{color}" stroke-width="1.6" stroke-linecap="round" stroke-linejoin="round">'
        f"{PATHS.get(name, name)}</svg>"
    )
    image = QPixmap(round(size * ratio), round(size * ratio))
    image.fill(Qt.GlobalColor.transparent)
    painter = QPainter(image)
    QSvgRenderer(QByteArray(drawing.encode())).render(painter, QRectF(image.rect()))
    painter.end()
    image.setDevicePixelRatio(ratio)
    return image


def icon(name: str) -> QIcon:
    """An icon in the colours of the current theme."""
    colors = theme.palette()
    result = QIcon(pixmap(name, colors.text))
    result.addPixmap(pixmap(name, colors.disabled), QIcon.Mode.Disabled)
    return result


@lru_cache(maxsize=1)
def application_icon() -> QIcon:
    """Icon of the program, made by assets/make_icon.py."""
    picture = QPixmap()
    picture.loadFromData(files("meshmash_viewer.app").joinpath("icon.png").read_bytes())
    return QIcon(picture)

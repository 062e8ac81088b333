"""Bar over the render that shows notices."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QSize, Qt, QTimer
from PySide6.QtGui import QGuiApplication, QIcon
from PySide6.QtWidgets import QBoxLayout, QFrame, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import row
from meshmash_viewer.model.notices import Notice, Severity

#: Milliseconds for which a notice without `Notice.holds` is shown: without and with a button.
_STAY, _OFFER = 7_000, 20_000
#: Largest width of the bar in pixels, and smallest width to the right of the title.
_WIDEST, _NARROWEST = 620, 360
#: Smallest width at which the bar leaves the colour bar uncovered.
_TIGHTEST = 180
#: Smallest width at which the buttons are next to the text, not below it.
_STACKED = 330


class MessageBar(QFrame):
    """Bar at the top of its parent that shows one notice at a time."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        theme.named(self, "message_bar", "Message")
        self.notice: Notice | None = None
        self._title, self._bar, self._head = QSize(0, 0), 0, 0

        plain = Qt.TextFormat.PlainText
        self._icon = make.label("message_icon")
        self._text = make.label(
            "message_text", "Message text", selectable=True, wordWrap=True, textFormat=plain
        )
        self._copy = make.button(
            "Copy details",
            "copy_details",
            "Copy details of the message",
            self._copy_details,
            role="link",
            tip="Copy the message and its technical details to the clipboard",
        )
        action = "Undo", "message_action", "Action of the message"
        self._action = make.button(*action, self._act, role="link")
        self._dismiss = make.icon_button(
            "dismiss_message", "Dismiss the message", self.dismiss, tip="Dismiss", size=14
        )
        top = Qt.AlignmentFlag.AlignTop
        self._middle = row((self._text,), self._action, self._copy)
        for button in (self._action, self._copy):
            self._middle.setAlignment(button, top | Qt.AlignmentFlag.AlignLeft)
        line = row(self._icon, (self._middle,), self._dismiss, margins=(12, 8, 8, 8))
        for widget in (self._icon, self._dismiss):
            line.setAlignment(widget, top)
        self.setLayout(line)

        self._timer = QTimer(self, singleShot=True)
        self._timer.timeout.connect(self.dismiss)
        parent.installEventFilter(self)
        theme.notifier().changed.connect(self._refresh)
        self.hide()

    def show_notice(self, notice: Notice | None) -> None:
        """Replace the displayed notice; None removes it."""
        if notice is None:
            self.dismiss()
            return
        self.notice = notice
        self._text.setText(notice.text)
        self._copy.setText("Copy details")
        self._copy.setVisible(bool(notice.details) or notice.severity is Severity.ERROR)
        self._action.setText(notice.button)
        self._action.setAccessibleName(notice.button)
        self._action.setVisible(notice.action is not None)
        self.setProperty("severity", notice.severity.value)
        self._refresh()
        self.show()
        self._place()
        self.raise_()
        self._timer.stop()
        if notice.holds is None:
            self._timer.start(_STAY if notice.action is None else _OFFER)

    def dismiss(self) -> None:
        self._timer.stop()
        self.notice = None
        self.hide()

    def _act(self) -> None:
        notice = self.notice
        self.dismiss()
        if notice is not None and notice.action is not None:
            notice.action()

    def keep_clear(self, title: QSize, bar: int) -> None:
        """Leave a title at the upper left, and `bar` pixels of a colour bar at the right, clear."""
        if (title, bar) != (self._title, self._bar):
            self._title, self._bar = title, bar
            if self.isVisible():
                self._place()

    def keep_below(self, head: int) -> None:
        """Leave heads of this height above two renders uncovered; 0 for a single render."""
        self._head = head
        if self.isVisible():
            self._place()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self.parent() and event.type() == QEvent.Type.Resize and self.isVisible():
            self._place()
        return super().eventFilter(watched, event)

    def _place(self) -> None:
        parent = self.parentWidget()
        assert parent is not None
        top = margin = theme.MARGIN
        right = parent.width() - margin
        free, remaining = right - margin, right - self._title.width()
        if not (self._title.isEmpty() or self._head) and remaining >= _NARROWEST:
            free = remaining
        elif not self._title.isEmpty():
            top = self._head + self._title.height()
            if free - self._bar >= _TIGHTEST:
                free, right = free - self._bar, right - self._bar
        width = min(free, _WIDEST)
        ways = QBoxLayout.Direction
        self._middle.setDirection(ways.TopToBottom if width < _STACKED else ways.LeftToRight)
        self.ensurePolished()
        self.setGeometry(right - width, top, width, self.heightForWidth(width))

    def _refresh(self) -> None:
        theme.restyle(self)
        colors = theme.palette()
        self._dismiss.setIcon(QIcon(theme.pixmap("close", colors.text, 14)))
        if self.notice is not None:
            severity = self.notice.severity.value
            self._icon.setPixmap(theme.pixmap(severity, getattr(colors, severity), 18))

    def _copy_details(self) -> None:
        if self.notice is not None:
            parts = [self.notice.text, self.notice.details]
            QGuiApplication.clipboard().setText("\n\n".join(part for part in parts if part))
            self._copy.setText("Copied")

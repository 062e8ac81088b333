"""Contrast of the colours of both themes. No window is open: a theme restyles all windows."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from meshmash_viewer.app import theme


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours by WCAG 2."""

    def luminance(color: str) -> float:
        channels = [int(color[at : at + 2], 16) / 255 for at in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))

    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("mode", [theme.Mode.LIGHT, theme.Mode.DARK])
def test_text_can_be_read_in_both_themes(qapp: QApplication, mode: theme.Mode) -> None:
    theme.set_mode(mode)
    colors = plot = theme.palette()
    for back in (colors.window, colors.surface, colors.raised, colors.selection):
        assert contrast(colors.text, back) > 7
    for back in (colors.window, colors.surface):
        assert contrast(colors.muted, back) > 4.5
        assert contrast(colors.good, back) > 4.5
        assert contrast(colors.warning, back) > 4.5
        assert contrast(colors.accent, back) > 4.5
    assert contrast(colors.on_accent, colors.accent) > 4.5
    for severity in ("information", "warning", "error"):
        back = getattr(colors, f"{severity}_back")
        assert contrast(colors.text, back) > 7
        assert contrast(getattr(colors, severity), back) > 4
    assert contrast(plot.axis, plot.surface) > 4.5
    for line in (plot.accent, plot.marker, *plot.series):
        assert contrast(line, plot.surface) > 3
    theme.set_mode(theme.Mode.SYSTEM)

"""What draws on this machine: the name and version of its OpenGL."""

from __future__ import annotations

import subprocess
import sys

from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.app.view.picture import new_window

__all__ = ["asked_graphics", "graphics"]

#: Seconds that a driver may take to answer.
_PATIENCE = 30.0
_TOLD = ("OpenGL renderer string", "OpenGL version string")


def graphics(window: vtkRenderWindow) -> str:
    """Renderer and version of OpenGL behind a window that has drawn."""
    told = dict(
        line.split(":", 1) for line in window.ReportCapabilities().splitlines() if ":" in line
    )
    return ", ".join(told[name].strip() for name in _TOLD if name in told) or "none"


def asked_graphics() -> str:
    """The same without a window, asked in a process of its own: some drivers end it."""
    command = [sys.executable, "-m", __name__]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE)
    except subprocess.TimeoutExpired:
        return f"no answer within {_PATIENCE:.0f} s"
    return answer.stdout.strip() or f"none (its test ended with status {answer.returncode})"


if __name__ == "__main__":
    window = new_window()
    window.SetOffScreenRendering(True)
    window.Render()
    sys.stdout.write(graphics(window))

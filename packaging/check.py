"""Check of the stand-alone program: compute, draw and open the window from an empty home.

    python packaging/check.py FOLDER MESH     (needs a display)

The PATH of the program has no Python. Prints the size of the folder and the time until the window.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

WINDOW = """
import sys
import time

began = time.perf_counter()
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application

app = application()
window = MainWindow(fresh=True)
window.show()
app.processEvents()
print(f"window after {time.perf_counter() - began:.1f} s")
window.open_mesh(sys.argv[1])
window.wait(60.0)
window.document.solve.compute()
window.wait(120.0)
assert window.document.spectrum.complete, window.stage.message_bar.notice
assert not window.grab().toImage().isNull()
window.close()
"""

#: Environment variables that a program needs to start and to find the screen.
KEPT = ("DISPLAY", "XAUTHORITY", "SYSTEMROOT", "COMSPEC")


def check(folder: Path, mesh: Path, home: Path) -> None:
    """Run the program in `folder` on `mesh` with `home` as its home; raise if anything fails."""
    (home / "none").mkdir()
    environment = {name: os.environ[name] for name in KEPT if name in os.environ}
    environment |= {"HOME": str(home), "PATH": str(home / "none"), "LANG": "C.UTF-8"}
    if sys.platform.startswith("linux"):
        environment["QT_QPA_PLATFORM"] = "xcb"
    if os.name == "nt":
        environment |= {"USERPROFILE": str(home), "LOCALAPPDATA": str(home), "TEMP": str(home)}
    program = folder / ("meshmash-viewer.exe" if os.name == "nt" else "meshmash-viewer")

    def alone(*arguments: str | Path) -> None:
        subprocess.run([program, *arguments], env=environment, check=True)

    features, picture, window = home / "hks.npz", home / "picture.png", home / "window.py"
    window.write_text(WINDOW, encoding="utf-8")
    alone("--version")
    alone("features", mesh, "--kind", "hks", "--count", "60", "-o", features)
    alone("render", mesh, "--count", "60", "-o", picture)
    alone(window, mesh)
    for made in (features, picture):
        if not made.stat().st_size:
            raise SystemExit(f"{made.name} is empty")
    size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    print(f"{size / 1e6:,.0f} MB in all")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as made:
        check(Path(sys.argv[1]).absolute(), Path(sys.argv[2]).absolute(), Path(made))

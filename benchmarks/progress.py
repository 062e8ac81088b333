"""Progress and time left that the window displays during a solve, against the true times.

    ./dev bench progress MESH... [--pairs 300] [--plot FILE]

Each mesh is opened in the real window, without stored pairs, and its pairs are computed. The
signals of the window give the displayed fraction, the ratio of displayed and true time left, and
the time of the first exact pairs. The exit status is 1 if a displayed time left was wrong by more
than a factor of two, after a fifth of the time and more than a second before the end.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

#: Share of the time after which displayed times must be right within the factor, until `LAST`
#: seconds before the end.
SETTLED, FACTOR, LAST = 0.2, 2.0, 1.0


def main() -> int:
    """Read the command line, and measure each mesh in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", type=Path, nargs="+", metavar="MESH")
    parser.add_argument("--pairs", type=int, default=300)
    parser.add_argument("--plot", type=Path, help="PNG to draw")
    parser.add_argument("--told", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.told:
        np.save(options.told, _watch(options.meshes[0], options.pairs))
        return 0
    told = {path.stem: _measured(path, options.pairs) for path in options.meshes}
    print("| mesh | seconds | first pairs at | off after a fifth, at most | reports within 2 |")
    print("|---|---|---|---|---|")
    most = 0.0
    for name, reports in told.items():
        seconds, _, remaining, exact = reports.T
        ends = seconds[-1]
        judged = (seconds > SETTLED * ends) & (seconds < ends - LAST)
        off = remaining[judged] / (ends - seconds[judged])
        off = np.append(np.maximum(off, 1.0 / np.maximum(off, 1e-9)), 1.0)  # the end is exact
        most = max(most, np.nanmax(off))
        first = seconds[np.argmax(exact > 0)] if exact.any() else np.nan
        print(
            f"| {name} | {ends:.1f} | {first:.1f} s | {np.nanmax(off):.1f}× |"
            f" {np.mean(off <= FACTOR):.0%} |"
        )
    if options.plot:
        _draw(told, options.plot)
    return int(most > FACTOR)


def _measured(mesh: Path, pairs: int) -> Any:
    with tempfile.TemporaryDirectory(prefix="progress-") as folder:
        told = Path(folder) / "told.npy"
        environment = {**os.environ, "XDG_CACHE_HOME": folder, "XDG_CONFIG_HOME": folder}
        command = [sys.executable, __file__, str(mesh), "--pairs", str(pairs), "--told", str(told)]
        subprocess.run(command, check=True, env=environment)
        return np.load(told)


def _watch(mesh: Path, pairs: int) -> Any:
    """Return rows of seconds, displayed fraction, displayed seconds left, exact pairs."""
    from PySide6.QtCore import QEventLoop, QTimer

    from meshmash_viewer.app.main_window import MainWindow
    from meshmash_viewer.app.run import application
    from meshmash_viewer.model.jobs import DecomposeJob
    from meshmash_viewer.spectral.weyl import Target

    application()
    window = MainWindow(fresh=True)
    window.resize(1400, 900)
    window.show()
    document, loop = window.document, QEventLoop()
    rows: list[tuple[float, float, float, float]] = []
    started = 0.0

    def note() -> None:
        job, spectrum = document.work.job, document.spectrum
        if job is None or not isinstance(job.job, DecomposeJob):
            if rows and spectrum is not None and spectrum.complete:
                rows.append((time.perf_counter() - started, 1.0, 0.0, spectrum.n_exact))
                loop.quit()
            return
        told = job.progress
        nan = float("nan")
        rows.append((
            time.perf_counter() - started,
            nan if told.fraction is None else told.fraction,
            nan if told.remaining is None else told.remaining,
            0 if spectrum is None else spectrum.n_exact,
        ))  # fmt: skip

    def opened() -> None:
        nonlocal started
        if document.ready is None or document.work.job is not None:
            return
        document.work.changed.disconnect(opened)
        started = time.perf_counter()
        document.work.changed.connect(note)
        document.spectrum_changed.connect(note)
        document.solve.target = Target("count", pairs)
        document.solve.compute()

    document.work.changed.connect(opened)
    QTimer.singleShot(500, lambda: window.open_mesh(mesh))
    loop.exec()
    document.work.changed.disconnect(note)
    document.spectrum_changed.disconnect(note)
    window.close()
    return np.array(rows)


def _draw(told: dict[str, Any], file: Path) -> None:
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, len(told), figsize=(4.2 * len(told), 6.0), squeeze=False)
    for (name, reports), (above, below) in zip(told.items(), axes.T, strict=True):
        seconds, fraction, remaining, _ = reports.T
        ends = seconds[-1]
        above.plot([0.0, ends], [0.0, 1.0], color="0.7", label="true")
        above.plot(seconds, fraction, label="told")
        above.set(title=name, ylabel="fraction", ylim=(0.0, 1.0))
        above.legend()
        below.axhspan(1.0 / FACTOR, FACTOR, color="0.9")
        below.semilogy(seconds[:-1], remaining[:-1] / np.maximum(ends - seconds[:-1], 1e-3))
        below.set(xlabel="seconds", ylabel="told time left over true", ylim=(0.1, 10.0))
    figure.tight_layout()
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    sys.exit(main())

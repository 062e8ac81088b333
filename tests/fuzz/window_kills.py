"""Windows killed during changes, and the state restored when the file is opened again.

Each window opens the file of the previous, killed window, reports the restored state, and makes
changes until it is killed. Each restored part must be less than a second older than the kill.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import shapes
from fuzz.kills import cache_at

from meshmash_viewer.health import repair_mesh
from meshmash_viewer.io.spectrum import obtain_eigenpairs
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.engine.request import Request

#: Maximum time until a window has opened its file (s).
_PATIENCE = 120.0
#: Script of a window that opens a file and makes a change every 30 ms. It writes a line with the
#: time and the state after each change; the first line has the restored state.
_WINDOW = """
import hashlib, json, os, random, sys, time
from dataclasses import astuple
from functools import partial
from pathlib import Path
import numpy as np
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from meshmash_viewer.app.run import application, run_app
from meshmash_viewer.model.limits import LockedLimits
from meshmash_viewer.vertex_map import VertexMap

log = os.open(sys.argv[2], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
rng = random.Random(int(sys.argv[3]))

def digest(each):
    return each.name, each.unit, hashlib.sha256(each.values.tobytes()).hexdigest()

def state(window):
    document, mesh = window.document, window.document.mesh
    parts = document.history.read()
    del parts["mesh"]
    parts["unit"] = document.unit_text
    parts["repairs"] = document.repairs
    parts["maps"] = [digest(each) for each in mesh.maps]
    parts["pins"] = [(mesh.file_index(pin.vertex), *astuple(pin)[1:]) for pin in parts["pins"]]
    parts["camera"] = f"{window.scene.camera()['half_size']:.6g}"
    return {
        name: repr(sorted(part.items() if hasattr(part, "items") else part))
        if name in ("policies", "log_scales", "signs", "pins") else repr(part)
        for name, part in parts.items()
    }

def write(window, _job=None):
    line = {"at": time.monotonic(), "state": state(window)}
    os.write(log, (json.dumps(line) + chr(10)).encode())

def write_idle(window):
    if window.document.work.job is None:
        write(window)

def change(window):
    document, display = window.document, window.document.display
    vertex = rng.randrange(document.mesh.n_vertices)
    what = rng.randrange(12)
    if what < 4:
        document.pins.toggle(vertex)
    elif what == 4:
        document.pins.change("name", vertex, name=f"spine {vertex}")
    elif what == 5:
        display.kind = "eigenfunction"
        document.flip()
    elif what == 6:
        display.set_limits(LockedLimits(0.0, rng.random()))
    elif what == 7:
        display.sequential_colormap = rng.choice(["viridis", "magma", "cividis"])
    elif what == 8:
        document.set_unit(rng.choice(["nm", "8 nm"]))
    elif what == 9:
        camera = window.scene.camera()
        half_size = camera["half_size"] * rng.uniform(0.9, 1.1)
        window.scene.set_camera({**camera, "half_size": half_size})
    elif what == 10 and len(document.mesh.maps) < 5:
        values = np.random.rand(document.mesh.n_vertices).astype(np.float32)
        document.maps.add(document.mesh, [VertexMap("map", values)], shown=False)
    elif what == 10:
        document.maps.remove(document.mesh.maps[0].name)
    elif document.repairs:
        document.undo_repair()
    else:
        document.repair("keep_largest_component")

known, idle = [], [0]

def look():
    for window in QApplication.topLevelWidgets():
        document = getattr(window, "document", None)
        if document is None or not window.loaded or document.ready is None:
            continue
        if not known:
            rests = document.work.job is None and window.scene.camera() and window.controller.idle
            idle[0] = idle[0] + 1 if rests else 0
            if idle[0] > 5:
                known.append(window)
                document.work.changed.connect(partial(write_idle, window))
                # a repair may fit the view anew, later than its job ends
                window.scene.camera_changed.connect(partial(write, window))
                write(window)
        elif document.work.job is None:
            change(window)
            if document.work.job is None:
                write(window)

if __name__ == "__main__":
    application()
    timer = QTimer(interval=30)
    timer.timeout.connect(look)
    timer.start()
    sys.exit(run_app(Path(sys.argv[1])))
"""


class KilledWindows:
    """Windows that open the same file one after the other, each until it is killed."""

    def __init__(self, folder: Path, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.folder, self.mesh = folder, folder / "balls.npz"
        small, large = shapes.icosphere(1), shapes.icosphere(2)
        vertices = np.concatenate([small.vertices + 9.0, large.vertices])
        faces = np.concatenate([small.faces, large.faces + 42])
        np.savez(self.mesh, vertices=vertices, faces=faces)
        (folder / "window.py").write_text(_WINDOW)
        with cache_at(folder / "cache"):
            whole = Mesh(vertices, faces)
            for mesh in (whole, repair_mesh(whole, "keep_largest_component")):
                obtain_eigenpairs(mesh, OperatorOptions(), Request(10))
        #: Lines written by the last window, and the time of its kill (s).
        self.log: list[dict[str, Any]] = []
        self.killed_at = 0.0
        #: Number of changes, and the seconds of work lost at each kill.
        self.changes, self.lost = 0, [0.0]

    def kill_once(self) -> None:
        """Open a window, compare what it restores, and kill it at a random moment."""
        file = self.folder / "log.jsonl"
        file.unlink(missing_ok=True)
        with self._window(file) as process:
            ends = time.monotonic() + _PATIENCE
            while not file.exists() or b"\n" not in file.read_bytes():
                assert process.poll() is None, (process.returncode, self._said())
                assert time.monotonic() < ends, "the window has not opened the file"
                time.sleep(0.05)
            restored = json.loads(file.read_bytes().splitlines()[0])["state"]
            if self.log:
                self.lost.append(self._lost(restored))
            time.sleep(float(self.rng.uniform(0.1, 4.0)))
            family = psutil.Process(process.pid).children(recursive=True)
            self.killed_at = time.monotonic()
            process.send_signal(signal.SIGKILL)
            process.wait(60)
            _, alive = psutil.wait_procs(family, timeout=20)
            assert not alive
        lines = file.read_bytes().splitlines()
        self.log = [json.loads(line) for line in lines]
        self.changes += len(self.log) - 1

    def _lost(self, restored: dict[str, str]) -> float:
        """Return how many seconds before the kill the oldest restored part was replaced."""
        lost = 0.0
        ends = [each["at"] for each in self.log[1:]] + [self.killed_at]
        for part, value in restored.items():
            current = [
                end
                for each, end in zip(self.log, ends, strict=True)
                if each["state"][part] == value
            ]
            assert current, (part, value, self.log[-1]["state"][part])
            lost = max(lost, self.killed_at - current[-1])
        return lost

    def _said(self) -> str:
        """Return the output of the window, such as the location of a crash."""
        return (self.folder / "said.txt").read_text(errors="replace")

    @contextmanager
    def _window(self, log: Path) -> Iterator[subprocess.Popen[bytes]]:
        folders = ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "MESHMASH_CACHE")
        own = {name: str(self.folder / "cache") for name in folders}
        program = [sys.executable, "-X", "faulthandler", str(self.folder / "window.py")]
        command = [*program, str(self.mesh), str(log)]
        command.append(str(self.rng.integers(1 << 30)))
        with (
            (self.folder / "said.txt").open("wb") as said,
            subprocess.Popen(command, env=os.environ | own, stdout=said, stderr=said) as process,
        ):
            try:
                yield process
            finally:
                process.kill()

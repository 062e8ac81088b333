"""Set-up, tests and builds of a clone, on Linux, macOS and Windows.

    python dev.py run [MESH]           open the window on MESH, or on the sample dendrite
    python dev.py test [PYTEST ARGS]   ruff, mypy and the quick tests, with real windows
    python dev.py test --all           the slow tests, the pages and the bundle as well
    python dev.py bench [NAME] [ARGS]  benchmarks/NAME.py: eigensolver (the default), pieces, ...
    python dev.py shots [DIR]          pictures of the window, of each algorithm, of the gallery
    python dev.py docs [DIR]           the pages in DIR (build/site); warnings are errors
    python dev.py bundle [DIR]         a program that needs no Python in DIR (build/bundle), tried

Every command first makes .venv and installs what is missing. ``./dev`` finds a Python for it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import venv
from ctypes.util import find_library
from functools import partial
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
PYTHON = HERE / ".venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
LINUX = sys.platform.startswith("linux")
SAMPLE = HERE / "meshmash_viewer" / "samples" / "dendrite.npz"

#: Installs what Qt, VTK, the virtual screen and PyInstaller need, on Debian and its relatives.
INSTALL = """apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
--no-install-recommends libgl1 libegl1 libglib2.0-0 libfontconfig1 libdbus-1-3 libxkbcommon-x11-0 \
libxcb-cursor0 libxcb-icccm4 libxcb-keysyms1 libxcb-shape0 xvfb xauth binutils python3-venv"""
LIBRARIES = ("GL", "EGL", "glib-2.0", "fontconfig", "dbus-1", "xkbcommon-x11")
LIBRARIES += tuple(f"xcb-{each}" for each in ("cursor", "icccm", "keysyms", "shape"))

#: Compiles the kernels, unless they are in numba's cache.
COMPILE = "import meshmash_viewer as mv, meshmash_viewer.spectral.engine.multifrontal as _; \
mv.geodesic_distance(([[0] * 3, [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), 0)"
MOST_REPEATED = 20  # failed tests: more are not due to a busy machine


def say(message: str) -> None:
    """Print a message of this script to stderr."""
    print(f"dev: {message}", file=sys.stderr, flush=True)


def call(*command: object, **environment: str) -> int:
    """Run a command in the clone and return its exit status."""
    words = [str(each) for each in command]
    return subprocess.run(words, cwd=HERE, env=os.environ | environment, check=False).returncode


def with_windows(*arguments: object) -> int:
    """Run the Python of .venv with windows: on Linux on a virtual screen."""
    if not LINUX:
        return call(PYTHON, *arguments)
    screen = "--server-args=-screen 0 1920x1200x24 +extension GLX -nolisten tcp"
    command = ("xvfb-run", "--auto-servernum", screen, PYTHON, *arguments)
    return call(*command, QT_QPA_PLATFORM="xcb", WAYLAND_DISPLAY="")


def prepare(extras: str = "test", modules: str = "meshmash_viewer") -> None:
    """Install the system packages, if permitted, and the package with extras, if missing."""
    there = [*map(shutil.which, ("xvfb-run", "xauth", "objdump")), *map(find_library, LIBRARIES)]
    if LINUX and not all([*there, find_spec("ensurepip")]):
        sudo = ("sudo", "-n") if os.geteuid() else ()
        if not shutil.which("apt-get") or call(*sudo, "sh", "-c", INSTALL) != 0:
            say(f"system packages are missing; run this line as root:\n    {INSTALL}")
    stamp = HERE / ".venv" / "installed-from"
    files = [HERE / name for name in ("pyproject.toml", "constraints.txt")]
    wanted = "\n".join([str(HERE), *(file.read_text(encoding="utf-8") for file in files)])
    current = stamp.exists() and stamp.read_text(encoding="utf-8") == wanted
    if not current and (not PYTHON.exists() or call(PYTHON, "-m", "pip", "--version") != 0):
        say(f"making .venv with {sys.executable} ({sys.version.split()[0]})")
        venv.create(HERE / ".venv", with_pip=True, clear=True, symlinks=os.name != "nt")
    if not current or call(PYTHON, "-c", f"import {modules}", PYTHONWARNINGS="ignore") != 0:
        say("installing the package and what it needs")
        pip = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-input")
        # --no-compile: Python compiles a module at its first import; most are never imported
        options = ("--no-compile", "--constraint", "constraints.txt", "--editable", f".[{extras}]")
        if status := call(PYTHON, *pip, *options):
            sys.exit(status)
        stamp.write_text(wanted, encoding="utf-8")


def run(mesh: str | Path = SAMPLE) -> int:
    """Open the window; without a display, draw a picture of the mesh."""
    prepare()
    viewer = ("-m", "meshmash_viewer")
    if not LINUX or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return call(PYTHON, *viewer, Path(mesh).absolute())
    picture = HERE / "build" / "picture.png"
    say(f"no display here: drawing {picture}")
    picture.parent.mkdir(exist_ok=True)
    return with_windows(*viewer, "render", Path(mesh).absolute(), "--count", "100", "-o", picture)


def repeating(alone: list[str], *tests: str) -> int:
    """Run pytest, and few failed tests again in one process; add those to `alone` if all pass."""
    status = with_windows("-m", "pytest", "--cache-clear", *tests)
    kept = HERE / ".pytest_cache" / "v" / "cache" / "lastfailed"
    failed = sorted(json.loads(kept.read_text())) if status == 1 and kept.exists() else []
    if not 0 < len(failed) <= MOST_REPEATED:
        return status
    say(f"pytest once more for what failed in parallel: {len(failed)}")
    status = with_windows("-m", "pytest", "--last-failed", "-n", "0")
    alone += [] if status else failed
    return status


def test(*arguments: str) -> int:
    """Run ruff, mypy and tests, all of them even if one fails; with --all the builds as well."""
    prepare()
    everything, alone = arguments[:1] == ("--all",), []
    given = arguments[everything:]
    tests = given or ("-n", "logical", "--maxprocesses", "4", "--dist", "worksteal")
    tests += () if given or everything else ("-m", "not slow")
    once, module = partial(with_windows, "-m", "pytest"), partial(call, PYTHON, "-m")
    pytest = partial(repeating, alone) if everything and not given else once
    steps = {
        "kernels": partial(call, PYTHON, "-c", COMPILE),  # else each process would compile them
        "ruff check": partial(module, "ruff", "check", "."),
        "ruff format": partial(module, "ruff", "format", "--check", "--quiet", "."),
        "mypy": partial(module, "mypy"),
        f"pytest {' '.join(tests)}": partial(pytest, *tests),
    }
    for system in ("win32", "darwin") if everything else ():  # a common cache would be emptied
        asked = ("--platform", system, "--cache-dir", f".mypy_cache/{system}")
        steps[f"mypy for {system}"] = partial(module, "mypy", *asked)
    steps |= {"docs": docs, "bundle": bundle} if everything else {}
    results: list[str] = []
    for name, step in steps.items():
        say(name)
        began = time.monotonic()
        word = "FAILED" if step() else "passed"
        results.append(f"{word}  {name} ({time.monotonic() - began:.0f} s)")
    results += [f"{len(alone)} failed in parallel and passed alone:", *alone] if alone else []
    print("", *results, sep="\n", flush=True)
    return int(any(line.startswith("FAILED") for line in results))


def bench(name: str = "eigensolver", *arguments: str) -> int:
    """Run a benchmark; that of the eigensolver if the first argument is a mesh."""
    prepare()
    if not (HERE / "benchmarks" / f"{name}.py").exists():
        name, arguments = "eigensolver", (name, *arguments)
    return with_windows(f"benchmarks/{name}.py", *arguments)


def shots(out: str | Path = HERE / "shots") -> int:
    """Take the pictures of the tour, of the algorithms and of the gallery."""
    prepare()
    places = {"tour": ".", "algorithms": "algorithms", "gallery": "gallery"}
    out = Path(out).absolute()
    return int(any(with_windows(f"assets/{name}.py", out / at) for name, at in places.items()))


def docs(out: str | Path = HERE / "build/site") -> int:
    """Build the pages of the documentation."""
    prepare("test,docs", "material, mkdocstrings, latex2mathml")
    build = ("-m", "mkdocs", "build", "--strict", "--site-dir", Path(out).absolute())
    return call(PYTHON, *build, NO_MKDOCS_2_WARNING="1")


def bundle(out: str | Path = HERE / "build/bundle") -> int:
    """Build the program that needs no Python, and test it."""
    prepare("test,bundle", "PyInstaller")
    program = Path(out).absolute() / "meshmash-viewer"
    build = ("-m", "PyInstaller", "--noconfirm", "--log-level", "ERROR", "--distpath")
    where = (program.parent, "--workpath", "build/pyinstaller", "packaging/meshmash-viewer.spec")
    if status := call(PYTHON, *build, *where):
        return status
    files = [*HERE.glob("packaging/*.desktop"), *HERE.glob("packaging/*.xml")]
    for file in (*files, HERE / "meshmash_viewer/app/icon.png") if LINUX else ():
        shutil.copy(file, program / f"meshmash-viewer{file.suffix}")
    return with_windows("packaging/check.py", program, SAMPLE)


COMMANDS = {each.__name__: each for each in (run, test, bench, shots, docs, bundle)}


def main(name: str = "help", *arguments: str) -> int:
    """Run the command with this name."""
    if name not in COMMANDS:
        print(__doc__)
        return 0 if name in ("help", "-h", "--help") else 2
    # Keep compiled modules, since some hundred processes import the package and its libraries.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if name not in ("run", "bench"):  # parallel processes would compete
        for which in ("OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "NUMBA_NUM", "VECLIB_MAXIMUM"):
            os.environ[f"{which}_THREADS"] = "1"
    return COMMANDS[name](*arguments)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

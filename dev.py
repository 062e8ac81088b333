"""Set-up, tests and builds of a clone, on Linux, macOS and Windows.

    python dev.py run [MESH]           open the window on MESH, or on the sample dendrite
    python dev.py test [PYTEST ARGS]   ruff, mypy and the quick tests, with real windows
    python dev.py test --all           the slow tests, the pages and the bundle as well
    python dev.py bench [NAME] [ARGS]  benchmarks/NAME.py: eigensolver (the default), stores, ...
    python dev.py shots [DIR]          pictures of the window, of each algorithm, of the gallery
    python dev.py docs [DIR]           the pages in DIR (build/site); warnings are errors
    python dev.py bundle [DIR]         a program that needs no Python in DIR (build/bundle), tried

Every command first makes .venv and installs what is missing. On Linux and macOS ``./dev`` finds a
Python of version 3.11 or newer and calls this file with it.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
VENV = HERE / ".venv"
PYTHON = VENV / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
STAMP = VENV / "installed-from"
LINUX = sys.platform.startswith("linux")

#: Libraries that Qt and VTK load on Linux, with the Debian package of each. They are looked up by
#: file, because package names differ between releases.
SYSTEM_LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libglib-2.0.so.0": "libglib2.0-0",
    "libfontconfig.so.1": "libfontconfig1",
    "libdbus-1.so.3": "libdbus-1-3",
    "libxcb-cursor.so.0": "libxcb-cursor0",
    "libxcb-icccm.so.4": "libxcb-icccm4",
    "libxcb-keysyms.so.1": "libxcb-keysyms1",
    "libxcb-shape.so.0": "libxcb-shape0",
    "libxcb-xkb.so.1": "libxcb-xkb1",
    "libxkbcommon-x11.so.0": "libxkbcommon-x11-0",
}
#: Programs of the virtual screen; PyInstaller needs objdump.
SYSTEM_PROGRAMS = {"Xvfb": "xvfb", "xauth": "xauth", "objdump": "binutils"}

#: Largest number of failed tests that are repeated: more are not due to a busy machine.
MOST_REPEATED = 20

#: Compiles the kernels of the eigensolver unless they are in numba's cache.
COMPILE = "from meshmash_viewer.spectral.engine import multifrontal, symbolic"

#: Benchmarks that open windows.
WITH_WINDOWS = ("mutations", "progress", "walk")


def say(message: str) -> None:
    """Print a message of this script to stderr."""
    bold, plain = ("\033[1m", "\033[0m") if sys.stderr.isatty() else ("", "")
    print(f"{bold}dev: {message}{plain}", file=sys.stderr, flush=True)


def fail(message: str) -> SystemExit:
    """Return the exception that ends this script with a message."""
    return SystemExit(f"dev: {message}")


def call(*command: str | Path, **environment: str) -> int:
    """Run a command in the clone and return its exit status."""
    words = [str(word) for word in command]
    return subprocess.run(
        words, cwd=HERE, env={**os.environ, **environment}, check=False
    ).returncode


def begin(*command: str | Path) -> subprocess.Popen[bytes]:
    """Start a command in the clone; `finish` shows what it has printed."""
    words = [str(word) for word in command]
    return subprocess.Popen(words, cwd=HERE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def finish(process: subprocess.Popen[bytes]) -> int:
    """Wait for a command that was started, show its output and return its exit status."""
    print(process.communicate()[0].decode(errors="replace"), end="", flush=True)
    return process.returncode


def must(*command: str | Path, **environment: str) -> None:
    """Run a command in the clone; end with its exit status if it fails."""
    if status := call(*command, **environment):
        raise SystemExit(status)


# -------------------------------------------------------------------------------- environment


def install_system_libraries() -> None:
    """Install packages for Qt, VTK and the virtual screen on Linux by apt, if permitted."""
    if not LINUX or not (ldconfig := shutil.which("ldconfig", path=_with_sbin())):
        return
    known = subprocess.run([ldconfig, "-p"], capture_output=True, text=True, check=False).stdout
    missing = [package for file, package in SYSTEM_LIBRARIES.items() if f"{file} " not in known]
    missing += [package for name, package in SYSTEM_PROGRAMS.items() if not shutil.which(name)]
    if not missing:
        return
    if not shutil.which("apt-get"):
        say(f"missing system libraries; install what your system calls: {' '.join(missing)}")
        return
    root = os.geteuid() == 0
    line = f"sudo apt-get update && sudo apt-get install -y {' '.join(missing)}"
    if not root and call("sudo", "-n", "true") != 0:
        say(f"missing system libraries; run this line, then ./dev again:\n    {line}")
        return
    say(f"installing system libraries: {' '.join(missing)}")
    apt = ("apt-get",) if root else ("sudo", "-n", "DEBIAN_FRONTEND=noninteractive", "apt-get")
    install = (*apt, "install", "-y", "-qq", "--no-install-recommends", *missing)
    updated = call(*apt, "update", "-qq") == 0
    if not updated or call(*install, DEBIAN_FRONTEND="noninteractive") != 0:
        say(f"apt could not install them; run this line, then ./dev again:\n    {line}")


def _with_sbin() -> str:
    return os.pathsep.join([os.environ.get("PATH", ""), "/sbin", "/usr/sbin"])


def fingerprint() -> str:
    """Return a digest of requirements, versions and this folder, which define the environment."""
    files = (HERE / name for name in ("pyproject.toml", "constraints.txt"))
    digest = hashlib.sha256(str(HERE).encode())
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def install(extras: str) -> None:
    """Install the package with extras into .venv, under constraints.txt."""
    pip = (PYTHON, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-input")
    # --no-compile: Python compiles a module at its first import; most are never imported
    must(*pip, "--no-compile", "--constraint", "constraints.txt", "--editable", f".[{extras}]")


def make_environment() -> None:
    """Make .venv and install the package in it, unless .venv is up to date."""
    if PYTHON.exists() and STAMP.exists() and STAMP.read_text() == fingerprint():
        return
    if not PYTHON.exists() or call(PYTHON, "-m", "pip", "--version") != 0:
        say(f"making .venv with {sys.executable} ({sys.version.split()[0]})")
        try:
            venv.create(VENV, with_pip=True, clear=True, symlinks=os.name != "nt")
        except (OSError, subprocess.CalledProcessError) as fault:
            shutil.rmtree(VENV, ignore_errors=True)
            remedy = ": sudo apt-get install -y python3-venv" if LINUX else ""
            raise fail(f"this Python cannot make a virtual environment ({fault}){remedy}") from None
    say("installing the package and what it needs")
    STAMP.unlink(missing_ok=True)
    install("test")
    STAMP.write_text(fingerprint())


def install_if_missing(modules: str, extras: str) -> None:
    """Install extras whose modules cannot be imported yet."""
    if call(PYTHON, "-c", f"import {modules}", PYTHONWARNINGS="ignore") != 0:
        install(extras)


def has_display() -> bool:
    """Return whether a window can be shown."""
    return not LINUX or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def with_windows(*command: str | Path) -> int:
    """Run a command that opens windows; on Linux on a virtual screen, for which xvfb is needed."""
    if not LINUX:
        return call(*command)
    if not shutil.which("xvfb-run"):
        raise fail("xvfb-run is missing: sudo apt-get install -y xvfb xauth")
    screen = "-screen 0 1920x1200x24 +extension GLX -nolisten tcp"
    virtual = ("xvfb-run", "--auto-servernum", f"--server-args={screen}")
    return call(*virtual, *command, QT_QPA_PLATFORM="xcb", WAYLAND_DISPLAY="")


def one_thread_each() -> None:
    """Let every process compute with one thread, so that processes do not compete."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "NUMBA"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    os.environ["VECLIB_MAXIMUM_THREADS"] = "1"


def folder(arguments: list[str], default: str) -> Path:
    """Return the folder of the first argument, or the default folder in the clone."""
    return Path(arguments[0]).absolute() if arguments else HERE / default


# ----------------------------------------------------------------------------------- commands


def run(arguments: list[str]) -> int:
    """Open the window; without a display, compute features and a picture of the mesh."""
    make_environment()
    install_system_libraries()
    if arguments:
        mesh = str(Path(arguments[0]).absolute())
    else:
        code = "from meshmash_viewer.samples import sample_path; print(sample_path())"
        found = subprocess.run([PYTHON, "-c", code], capture_output=True, text=True, check=True)
        mesh = found.stdout.strip()
    if has_display():
        return call(PYTHON, "-m", "meshmash_viewer", mesh)
    out = HERE / "shots" / "without-display"
    say("no display here: computing features and a picture with the command line")
    out.mkdir(parents=True, exist_ok=True)
    viewer = (PYTHON, "-m", "meshmash_viewer")
    features, picture = out / "hks.npz", out / "picture.png"
    must(*viewer, "features", mesh, "--kind", "hks", "--count", "100", "-o", features)
    render = (*viewer, "render", mesh, "--count", "100", "-o", picture)
    if status := with_windows(*render) if shutil.which("xvfb-run") else call(*render):
        return status
    print(
        f"\nheat kernel signature of 100 eigenpairs: {features}\na picture of the mesh: {picture}"
    )
    return 0


def run_in_parallel(tests: list[str], passed_alone: list[str]) -> int:
    """Run pytest; if few tests fail, run these tests again in one process.

    If all of them pass then, add them to `passed_alone` and return 0.
    """
    status = with_windows(PYTHON, "-m", "pytest", "--cache-clear", *tests)
    kept = HERE / ".pytest_cache" / "v" / "cache" / "lastfailed"
    failed = sorted(json.loads(kept.read_text())) if status == 1 and kept.exists() else []
    if not 0 < len(failed) <= MOST_REPEATED:
        return status
    say(f"pytest once more for what failed in parallel: {len(failed)}")
    status = with_windows(PYTHON, "-m", "pytest", "--last-failed", "-n", "0")
    if status == 0:
        passed_alone += failed
    return status


def test(arguments: list[str]) -> int:
    """Run ruff, mypy and the quick tests, all of them even if one fails.

    With --all, run the slow tests, build the pages and build and try the bundle as well, and repeat
    tests that failed in parallel.
    """
    make_environment()
    install_system_libraries()
    one_thread_each()
    everything = "--all" in arguments[:1]
    given = arguments[1:] if everything else arguments
    tests = given or ["-n", "logical", "--maxprocesses", "4", "--dist", "worksteal"]
    if not given and not everything:
        tests += ["-m", "not slow"]
    passed_alone: list[str] = []
    mypy = begin(PYTHON, "-m", "mypy")  # while the tests wait for windows
    steps = {
        # once, since the processes of the tests would each compile them
        "kernels": lambda: call(PYTHON, "-c", COMPILE),
        "ruff check": lambda: call(PYTHON, "-m", "ruff", "check", "."),
        "ruff format": lambda: call(PYTHON, "-m", "ruff", "format", "--check", "--quiet", "."),
        f"pytest {' '.join(tests)}": lambda: (
            run_in_parallel(tests, passed_alone)
            if everything and not given
            else with_windows(PYTHON, "-m", "pytest", *tests)
        ),
        "mypy": lambda: finish(mypy),
    }
    if everything:
        # in separate caches, since each change of platform would empty a common cache
        for platform in ("win32", "darwin"):
            asked = ("--platform", platform, "--cache-dir", f".mypy_cache/{platform}")
            steps[f"mypy for {platform}"] = lambda asked=asked: call(PYTHON, "-m", "mypy", *asked)
        steps |= {"docs": lambda: docs([]), "bundle": lambda: bundle([])}
    results = []
    for name, step in steps.items():
        say(name)
        began = time.monotonic()
        status = step()
        word = "FAILED" if status else "passed"
        results.append(f"{word}  {name} ({time.monotonic() - began:.0f} s)")
    if passed_alone:
        results += [f"{len(passed_alone)} failed in parallel and passed alone:", *passed_alone]
    print("", *results, sep="\n", flush=True)
    return int(any(line.startswith("FAILED") for line in results))


def bench(arguments: list[str]) -> int:
    """Run the benchmark named by the first argument, by default that of the eigensolver."""
    name = "eigensolver"
    if arguments and (HERE / "benchmarks" / f"{arguments[0]}.py").exists():
        name, *arguments = arguments
    make_environment()
    command = (PYTHON, HERE / "benchmarks" / f"{name}.py", *arguments)
    if name not in WITH_WINDOWS:
        return call(*command)
    install_system_libraries()
    one_thread_each()
    return with_windows(*command)


def shots(arguments: list[str]) -> int:
    """Take the pictures of the tour, of the algorithms and of the gallery."""
    out = folder(arguments, "shots")
    make_environment()
    install_system_libraries()
    one_thread_each()
    status = (
        with_windows(PYTHON, "assets/tour.py", out)
        or with_windows(PYTHON, "assets/algorithms.py", out / "algorithms")
        or with_windows(PYTHON, "assets/gallery.py", out / "gallery")
    )
    say(f"pictures are in {out}")
    return status


def docs(arguments: list[str]) -> int:
    """Build the pages of the documentation."""
    out = folder(arguments, "build/site")
    make_environment()
    install_if_missing("material, mkdocstrings, latex2mathml", "test,docs")
    build = (PYTHON, "-m", "mkdocs", "build", "--strict", "--site-dir", out)
    status = call(*build, NO_MKDOCS_2_WARNING="1")
    say(f"pages are in {out}")
    return status


def bundle(arguments: list[str]) -> int:
    """Build the program that needs no Python, and test it."""
    out = folder(arguments, "build/bundle")
    make_environment()
    install_system_libraries()
    install_if_missing("PyInstaller", "test,bundle")
    must(
        *(PYTHON, "-m", "PyInstaller", "--noconfirm", "--log-level", "ERROR", "--distpath", out),
        *("--workpath", "build/pyinstaller", "packaging/meshmash-viewer.spec"),
    )
    program = out / "meshmash-viewer"
    if LINUX:
        for ending in ("desktop", "xml"):
            shutil.copy(HERE / "packaging" / f"meshmash-viewer.{ending}", program)
        icon = HERE / "meshmash_viewer" / "app" / "icon.png"
        shutil.copy(icon, program / "meshmash-viewer.png")
    one_thread_each()
    sample = HERE / "meshmash_viewer" / "samples" / "dendrite.npz"
    status = with_windows(PYTHON, "packaging/check.py", program, sample)
    say(f"the program is in {program}")
    return status


COMMANDS = {each.__name__: each for each in (run, test, bench, shots, docs, bundle)}


def main(arguments: list[str]) -> int:
    """Run the command named by the first argument."""
    if sys.version_info < (3, 11):  # noqa: UP036  (any Python can call this file)
        raise fail("Python 3.11 or newer is needed: /path/to/python3.11 dev.py ...")
    if not arguments or arguments[0] in ("help", "-h", "--help"):
        print(__doc__)
        return 0
    # Keep compiled modules, since some hundred processes import the package and its libraries.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if arguments[0] not in COMMANDS:
        print(__doc__, file=sys.stderr)
        return 2
    return COMMANDS[arguments[0]](arguments[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

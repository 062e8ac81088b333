"""Distributed packages: source archive and wheel, installed away from the checkout."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from email import message_from_bytes
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from meshmash_viewer.fields import FAMILIES

ROOT = Path(__file__).resolve().parent.parent
BUILD = "from setuptools import build_meta as b; b.build_{kind}({folder!r})"
INSTALLED = """
import json, sys, meshmash_viewer as mv
from pathlib import Path
from importlib.metadata import entry_points, version
from meshmash_viewer.samples import SAMPLES, sample_path
meshes = [mv.read_mesh(sample_path(name)) for name in SAMPLES]
script, = entry_points(group="console_scripts", name="meshmash-viewer")
print(json.dumps({
    "place": mv.__file__, "version": version("meshmash-viewer"),
    "samples": [mesh.n_vertices for mesh in meshes], "script": script.value,
}))
"""


def run(*command: str | Path, cwd: Path) -> str:
    environment = {key: text for key, text in os.environ.items() if not key.startswith("PYTHON")}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Build the source archive, and the wheel from its content."""
    pytest.importorskip("setuptools", "77", reason="older ones cannot build it")
    folder = tmp_path_factory.mktemp("packages")
    checkout = folder / "checkout"  # a copy, since builds leave folders
    shutil.copytree(
        ROOT,
        checkout,
        ignore=shutil.ignore_patterns(".*", "build", "dist", "shots", "*.egg-info", "__pycache__"),
    )
    run(sys.executable, "-c", BUILD.format(kind="sdist", folder=str(folder)), cwd=checkout)
    (source,) = folder.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    run(sys.executable, "-c", BUILD.format(kind="wheel", folder=str(folder)), cwd=unpacked)
    (wheel,) = folder.glob("*.whl")
    return source, wheel


@pytest.fixture(scope="module")
def installed(archives: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel in a new environment, with dependencies by path; return its scripts."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=os.name != "nt")
    scripts = folder / ("Scripts" if os.name == "nt" else "bin")
    python = scripts / Path(sys.executable).name
    place = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder)
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "--quiet")
    run(*pip, "--no-deps", "--no-index", archives[1], cwd=folder)
    # Folders in a .pth file add packages, but not the editable installs of other environments.
    needed = [path for path in sys.path if path.endswith("-packages")]
    Path(place.strip(), "needed.pth").write_text("\n".join(needed), encoding="utf-8")
    return scripts


@pytest.mark.slow
def test_the_wheel_holds_the_package_whole(archives: tuple[Path, Path]) -> None:
    tracked = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "meshmash_viewer").rglob("*")
        if path.is_file() and path.suffix not in (".pyc", ".nbi", ".nbc")
    }
    with zipfile.ZipFile(archives[1]) as wheel:
        held = {name for name in wheel.namelist() if ".dist-info/" not in name}
        pages = {name for name in held if ".data/data/share/doc/meshmash-viewer/" in name}
        (about,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = message_from_bytes(wheel.read(about))
        assert any(name.endswith("licenses/LICENSE") for name in wheel.namelist())
    assert held - pages == tracked
    shown = {family.page for family in FAMILIES.values()}
    assert shown <= {Path(name).stem for name in pages}
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert metadata["License-Expression"] == "MIT"
    assert {"draco", "html", "movie"} <= set(metadata.get_all("Provides-Extra", []))


@pytest.mark.slow
def test_the_source_archive_holds_examples_pages_and_tests(archives: tuple[Path, Path]) -> None:
    with tarfile.open(archives[0]) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    for folder in ("docs", "examples", "tests"):
        wanted = {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob("*.py")}
        assert wanted <= held
    assert {"dev", "mkdocs.yml", "docs/index.md", "examples/plugin/pyproject.toml"} <= held


@pytest.mark.skipif(find_spec("twine") is None, reason="twine is not installed")
def test_the_description_can_be_shown(archives: tuple[Path, Path]) -> None:
    run(sys.executable, "-m", "twine", "check", "--strict", *archives, cwd=ROOT)


@pytest.mark.slow
def test_what_is_installed_is_whole(installed: Path, tmp_path: Path) -> None:
    told = json.loads(run(installed / Path(sys.executable).name, "-c", INSTALLED, cwd=tmp_path))
    assert Path(told["place"]).is_relative_to(installed.parent)
    assert told["script"] == "meshmash_viewer.cli.main:main"
    assert min(told["samples"]) > 100


@pytest.mark.slow
def test_the_installed_command_computes_features(installed: Path, tmp_path: Path) -> None:
    sample = ROOT / "meshmash_viewer" / "samples" / "dendrite.npz"
    command = ("features", sample, "--kind", "hks", "--count", "40", "--no-cache")
    run(installed / "meshmash-viewer", *command, "-o", "out.npz", cwd=tmp_path)
    with np.load(sample) as mesh, np.load(tmp_path / "out.npz") as made:
        assert made["features"].shape == (len(mesh["vertices"]), 32)
        assert len(made["eigenvalues"]) == 40
        assert np.isfinite(made["features"]).all()

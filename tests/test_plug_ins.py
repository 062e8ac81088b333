"""Plug-ins by entry points: the installed example, and unusable packages."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapes

from meshmash_viewer.mesh import Mesh

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "examples" / "plugin"
#: Invalid entry points of a package, with a part of the message for each.
BROKEN = {
    "fields": {
        "hks": ("broken:no", "the name is taken"),
        "lost": ("nowhere:Lost", "No module named 'nowhere'"),
        "number": ("math:pi", "it is not a subclass of BankColumns"),
        "bare": ("broken:Bare", "a text is missing"),
        "twin": ("broken:Twin", "exported as another family is"),
    },
    "readers": {".ply": ("math:floor", "the name is taken"), "end": ("math:floor", "lower-case")},
}
#: An entry point that fails only when it is used.
LATE = {"writers": {".end": ("broken.ending:gone", "leaving")}}


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("setuptools", "77", reason="older ones cannot build it")
    folder = tmp_path_factory.mktemp("good")
    shutil.copytree(EXAMPLE, folder / "source")  # a copy, since builds leave folders
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps")
    place = ("--no-build-isolation", "--target", folder / "packages", folder / "source")
    subprocess.run([*pip, *place], check=True, capture_output=True)
    return folder / "packages"


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("broken")
    (folder / "broken").mkdir()
    (folder / "broken" / "__init__.py").write_text(
        "from meshmash_viewer.fields.bank_columns import BankColumns\n"
        "class Bare(BankColumns):\n    name = 'bare'\n"
        "class Twin(BankColumns):\n    name = 'twin'\n    label = short = tip = 'Twin'\n"
        "    export = 'hks'\n"
    )
    (folder / "broken" / "ending.py").write_text("raise SystemExit('leaving')")
    about = folder / "broken-0.3.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 0.3\n")
    lines = []
    for group, entries in {**BROKEN, **LATE}.items():
        lines.append(f"[meshmash_viewer.{group}]")
        lines += [f"{name}={at}" for name, (at, _) in entries.items()]
    (about / "entry_points.txt").write_text("\n".join(lines))
    return folder


def run(packages: Path, *command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(packages), str(ROOT)])}
    return subprocess.run(
        [sys.executable, "-m", "meshmash_viewer", *command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
    )


def write_medit(path: Path, mesh: Mesh) -> None:
    lines = ["MeshVersionFormatted 2", "Dimension 3"]
    for name, rows in (("Vertices", mesh.vertices), ("Triangles", mesh.faces + 1)):
        lines += [name, str(len(rows)), *(f"{a!r} {b!r} {c!r} 0" for a, b, c in rows.tolist())]
    path.write_text("\n".join([*lines, "End"]))


def test_a_plug_in_reads_computes_and_writes(good: Path, tmp_path: Path) -> None:
    ball = shapes.icosphere(3)
    write_medit(tmp_path / "ball.mesh", ball)
    command = ("features", "ball.mesh", "--kind", "wavelets", "--n-components", "5")
    options = ("--count", "36", "--no-cache", "--json", "-o", "out.tsv")
    done = run(good, *command, *options, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    values = np.loadtxt(tmp_path / "out.tsv", skiprows=1)
    assert values.shape == (ball.n_vertices, 5)
    # On a sphere all vertices are equivalent, and d (d + 1) has multiplicity 2 d + 1.
    degrees = np.arange(6.0)
    scaled = degrees * (degrees + 1.0) / np.geomspace(2.0, 30.0, 5)[:, np.newaxis]
    wanted = (scaled * np.exp(1.0 - scaled)) @ (2.0 * degrees + 1.0) / (4.0 * np.pi)
    np.testing.assert_allclose(values.mean(axis=0), wanted, rtol=0.02)
    assert json.loads(done.stdout)["kind"] == "wavelets"


@pytest.mark.slow
def test_the_report_lists_them(good: Path, tmp_path: Path) -> None:
    told = " ".join(run(good, "--info", cwd=tmp_path).stdout.split())
    for name in ("fields : wavelets", "readers : .mesh", "writers : .tsv"):
        assert f"Plug-in, {name} of meshmash-wavelets 1.0" in told


@pytest.mark.slow
def test_what_cannot_be_used_costs_a_line_each(broken: Path, tmp_path: Path) -> None:
    sample = str(ROOT / "meshmash_viewer" / "samples" / "two_components.npz")
    options = ("features", sample, "--count", "8", "--no-cache", "-o")
    done = run(broken, *options, "out.npz", cwd=tmp_path)
    assert done.returncode == 0
    assert (tmp_path / "out.npz").exists()
    lines = [each for each in done.stderr.splitlines() if "plug-in" in each]
    for entries in BROKEN.values():
        for name, (_, why) in entries.items():
            (line,) = (each for each in lines if f"plug-in {name} of broken 0.3" in each)
            assert line.startswith("meshmash-viewer: The plug-in")
            assert why in line
            lines.remove(line)
    assert not lines


def test_a_script_may_begin_with_the_plug_in(good: Path, tmp_path: Path) -> None:
    code = "import meshmash_wavelets; from meshmash_viewer.fields import FAMILIES\n"
    code += "assert FAMILIES['wavelets'] is meshmash_wavelets.Wavelets"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(good), str(ROOT)])}
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")

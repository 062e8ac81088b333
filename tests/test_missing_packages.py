"""Missing optional packages: the rest works, and messages name the package to install."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapes
from tiers import slow

from meshmash_viewer.model.notices import failure_of

ROOT = Path(__file__).resolve().parent.parent
#: Start-up code of every interpreter with this folder in its path, also of child processes.
BLOCK = """
import os, sys
from importlib import machinery
blocked, find = set(os.environ["BLOCKED"].split()), machinery.PathFinder.find_spec
def find_unblocked(name, path=None, target=None):
    return None if name in blocked else find(name, path, target)
machinery.PathFinder.find_spec = find_unblocked
"""
FEATURES = ("features", "ball.off", "--count", "12", "--no-cache", "-o")
PYTHON = "import meshmash_viewer as mv; mesh = mv.read_mesh('ball.off'); "
SURFACE = """<?xml version="1.0"?><GIFTI Version="1.0" NumberOfDataArrays="0"></GIFTI>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("missing")
    (folder / "sitecustomize.py").write_text(BLOCK)
    ball = shapes.icosphere(2)
    lines = ["OFF", f"{ball.n_vertices} {ball.n_faces} 0"]
    lines += [" ".join(map(repr, each)) for each in ball.vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in ball.faces.tolist()]
    (folder / "ball.off").write_text("\n".join([*lines, ""]))
    (folder / "ball.gii").write_text(SURFACE)
    (folder / "values.csv").write_text("\n".join(["value", *map(str, range(ball.n_vertices))]))
    return folder


def run(folder: Path, blocked: str, *command: str) -> subprocess.CompletedProcess[str]:
    environment = {
        **os.environ,
        "BLOCKED": blocked,
        "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]),
        "PATH": str(folder),  # hides the system's ffmpeg
        "QT_QPA_PLATFORM": "offscreen",
    }
    return subprocess.run(
        [sys.executable, *command], cwd=folder, env=environment, capture_output=True, text=True
    )


@pytest.mark.parametrize(
    ("blocked", "arguments", "remedy"),
    [
        ("pyarrow", (*FEATURES, "out.csv"), "pip install pyarrow"),
        slow("pyarrow", (*FEATURES, "out.parquet"), "pip install pyarrow"),
        slow(
            "pyarrow",
            (*FEATURES, "out.npz", "--map", "values.csv"),
            "pip install pyarrow",
        ),
        slow("nibabel", (*FEATURES, "out.func.gii"), "pip install nibabel"),
        slow("nibabel", ("info", "ball.gii"), "pip install nibabel"),
        slow("robust_laplacian", (*FEATURES, "out.npz"), "pip install robust_laplacian"),
        ("PySide6", ("ball.off",), "pip install PySide6-Essentials"),
        slow(
            "imageio_ffmpeg",
            ("movie", "ball.off", "--sweep", ":", "-o", "out.mp4"),
            'pip install "meshmash-viewer[movie]"',
        ),
        slow(
            "fast_simplification",
            ("condense", "ball.off", "-o", "out.npz"),
            'pip install "meshmash-viewer[neuro]"',
        ),
        slow(
            "skops",
            ("train", "ball.off", "--labels", "values.csv", "-o", "model.skops"),
            'pip install "meshmash-viewer[learn]"',
        ),
    ],
)
def test_what_is_missing_is_one_line(
    folder: Path, blocked: str, arguments: tuple[str, ...], remedy: str
) -> None:
    done = run(folder, blocked, "-m", "meshmash_viewer", *arguments)
    assert done.returncode == 2, done.stderr
    assert remedy in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("blocked", "call", "remedy"),
    [
        slow("nibabel", "mv.read_mesh('ball.gii')", "pip install nibabel"),
        slow("pyarrow", "mv.read_maps('values.csv', mesh)", "pip install pyarrow"),
        ("numba", "mv.decompose_mesh(mesh, 4)", "pip install numba"),
        slow(
            "sklearn",
            "mv.train_classes(mesh, mv.VertexMap('part', mesh.vertices[:, 2] > 0))",
            'pip install "meshmash-viewer[learn]"',
        ),
    ],
)
def test_from_python_it_is_an_input_error(
    folder: Path, blocked: str, call: str, remedy: str
) -> None:
    done = run(folder, blocked, "-c", PYTHON + call)
    last = done.stderr.splitlines()[-1]
    assert last.startswith("meshmash_viewer.errors.InputError: ")
    assert remedy in last


@pytest.mark.slow
def test_without_any_optional_package_features_are_the_same(folder: Path) -> None:
    every = "pymetis pyarrow nibabel imageio_ffmpeg trame PySide6 pyvista vtkmodules"
    for blocked, name in ((every, "bare.npz"), ("", "whole.npz")):
        done = run(folder, blocked, "-m", "meshmash_viewer", *FEATURES, name)
        assert done.returncode == 0, done.stderr
    with np.load(folder / "bare.npz") as bare, np.load(folder / "whole.npz") as whole:
        np.testing.assert_allclose(bare["features"], whole["features"], rtol=1e-6)


def test_a_part_that_is_missing_is_no_missing_package() -> None:
    with pytest.raises(ModuleNotFoundError) as caught:
        import meshmash_viewer.nothing  # noqa: F401
    assert not failure_of(caught.value).correctable

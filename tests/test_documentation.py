"""Documentation pages: examples run, links are valid, and all public names are listed."""

from __future__ import annotations

import doctest
import re
import shlex
import tempfile
from pathlib import Path
from typing import Any

import nibabel.freesurfer
import numpy as np
import pandas
import pytest
import trimesh

import meshmash_viewer as mv
from meshmash_viewer import pieces
from meshmash_viewer.cli import parser
from meshmash_viewer.cli.main import main
from meshmash_viewer.samples import labels_path, sample_path

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
BLOCKS = [
    pytest.param(block, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, block in enumerate(
        re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M)
    )
]

#: Shell commands of pages and README, without the remarks after two blanks. Commands for the
#: example plug-in, which is not installed, and for remote layers are left out.
COMMANDS = sorted({
    re.split(r"  +", line)[0]
    for page in [*PAGES, DOCS.parent / "README.md"]
    for line in re.findall(r"^meshmash-viewer (.+)$", page.read_text(encoding="utf-8"), re.M)
    if "wavelets" not in line and "://" not in line
})  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.filterwarnings("default::meshmash_viewer.TruncationWarning")
def test_python_of_a_page_runs(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # Some examples write files.
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    exec(compile(block, "page", "exec"), {"__name__": "page"})


def test_python_of_the_readme_and_of_the_package_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    readme = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", readme, re.S | re.M)
    example = doctest.script_from_examples(mv.__doc__ or "")
    shown: list[Any] = []
    monkeypatch.setattr(mv, "view", shown.append)
    for code in (block, example):
        names: dict[str, Any] = {}
        exec(compile(code, "readme", "exec"), names)
        n_vertices = names["mesh"].n_vertices
        assert shown.pop() is names["mesh"]
        assert names["hks"].shape == (n_vertices, 32)
        assert names["eigenvectors"].shape == (n_vertices, len(names["eigenvalues"]))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing


def test_the_reference_names_all_that_is_public() -> None:
    page = (DOCS / "reference.md").read_text(encoding="utf-8")
    named = {line.rsplit(".", 1)[1] for line in re.findall(r"^::: (\S+)$", page, re.M)}
    assert {*mv.__all__, *pieces.__all__} <= named


@pytest.fixture(scope="module")
def assumed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the names of the reference's first code block, which examples assume."""
    page = (DOCS / "reference.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(tempfile, "tempdir", str(tmp_path_factory.mktemp("examples")))
        exec(re.findall(r"```python\n(.*?)```", page, re.S)[0], names)
    return names


@pytest.mark.slow
@pytest.mark.parametrize("name", mv.__all__)
def test_every_public_name_has_an_example_that_runs(name: str, assumed: dict[str, Any]) -> None:
    (tests,) = doctest.DocTestFinder(recurse=False).find(getattr(mv, name), name, globs=assumed)
    runs = [example for example in tests.examples if doctest.SKIP not in example.options]
    assert runs or name == "view", "which opens a window"
    assert tests.examples
    wrong: list[str] = []
    doctest.DocTestRunner().run(tests, out=wrong.append)
    assert not wrong, "".join(wrong)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write balls under the file names of the pages."""
    folder = tmp_path_factory.mktemp("meshes")
    balls = {"neuron.ply": 4, "neuron.obj": 4, "bunny.obj": 4, "shape.ply": 4, "huge.ply": 6}
    for name, level in balls.items():
        trimesh.creation.icosphere(level, 3000.0).export(folder / name)
    for sample in ("dendrite", "neuron"):
        (folder / f"{sample}.npz").symlink_to(sample_path(sample))
        (folder / f"{sample}_labels.npz").symlink_to(labels_path(sample))
    ball = trimesh.creation.icosphere(4, 3000.0).vertices
    synapses = pandas.DataFrame({"id": range(len(ball)), **dict(zip("xyz", ball.T, strict=True))})
    synapses.to_parquet(folder / "synapses_nm.parquet")
    synapses[["x", "y", "z"]] /= [4.0, 4.0, 40.0]
    synapses.to_csv(folder / "synapses.csv")
    np.savez(folder / "parts.npz", parts=np.where(ball[:, 2] > 0.0, 1, 2))
    neuron = mv.read_mesh(sample_path("neuron"))
    parts = mv.read_labels(labels_path("neuron"), neuron)
    mv.write_classes(folder / "spines.skops", mv.train_classes(neuron, parts, scored=False))
    freesurfer: Any = nibabel.freesurfer
    cortex = trimesh.creation.icosphere(4)
    x, y, z = cortex.vertices.T  # without a symmetry, which would make matches ambiguous
    radii = 50 + 15 * y**2 + 12 * x + 10 * z * np.sin(3 * x) + 8 * np.sin(2 * y + x)
    cortex.vertices *= radii[:, None] * [1.0, 1.6, 1.2]
    for name in ("lh.pial", "rh.pial"):
        freesurfer.write_geometry(folder / name, cortex.vertices, cortex.faces)
    freesurfer.write_morph_data(folder / "lh.thickness", cortex.vertices[:, 0])
    labels = (x > 0).astype(int)
    colors = np.array([[200, 0, 0, 0, 1], [0, 0, 200, 0, 2]])
    freesurfer.write_annot(folder / "lh.aparc.annot", labels, colors, ["one", "two"], True)
    return folder


@pytest.mark.filterwarnings("default::meshmash_viewer.TruncationWarning")
@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_commands_of_pages_run(
    command: str, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for file in files.iterdir():
        (tmp_path / file.name).symlink_to(file)
    monkeypatch.chdir(tmp_path)
    words = shlex.split(command)
    if "*.ply" in words:
        at = words.index("*.ply")
        words[at : at + 1] = ["neuron.ply", "huge.ply"]
    monkeypatch.setattr("meshmash_viewer.io.cache.default_cache_folder", lambda: tmp_path / "cache")
    if words[0] in parser.COMMANDS:
        shorter = ["--size", "320x240", "--seconds", "0.5"] if words[0] == "movie" else []
        assert main([*words, *shorter]) == 0
        if "-o" in words:
            assert Path(words[words.index("-o") + 1]).exists()
    elif words != ["--info"]:
        opened = parser.window_parser().parse_args(words)
        assert all(Path(mesh).exists() for mesh in opened.mesh)

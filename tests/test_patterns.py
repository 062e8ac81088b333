"""Patterns of files on the command line, which the shells of Windows do not expand."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.cli import main as cli
from meshmash_viewer.cli.batch import expanded
from meshmash_viewer.cli.parser import COMMANDS, window_parser

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
NAMES = (
    *("b.obj", "a.obj", "c1.obj", "C2.obj", ".hidden.obj", "notes.txt", "scan [1].obj", "d1.obj"),
    *("deep/x.obj", "deep/er/y.obj", "copy [2]/z.obj", "copy 2/z.obj"),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in NAMES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        lines = [f"v {x} {y} {z}" for x, y, z in CORNERS]
        lines += ["f " + " ".join(map(str, face + 1)) for face in FACES]
        (tmp_path / name).write_text("\n".join([*lines, ""]), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("absolute", [False, True])
@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("[abc]*.obj", "a.obj b.obj c1.obj"),
        ("?.obj", "a.obj b.obj"),
        ("[!ab]1.obj", "c1.obj d1.obj"),
        ("de*/*.obj", "deep/x.obj"),
        ("**/[xy].obj", "deep/er/y.obj deep/x.obj"),
        ("deep/**/*.obj", "deep/er/y.obj deep/x.obj"),
        ("scan *.obj", "scan [1].obj"),
        # names with such characters, which Windows and browsers give to copies
        ("scan [1].obj", "scan [1].obj"),
        ("copy [2]/*.obj", "copy [2]/z.obj"),
        ("copy [2]/z.obj", "copy [2]/z.obj"),
        ("copy */z.obj", "copy 2/z.obj,copy [2]/z.obj"),
        # names without patterns, never searched for
        ("none.obj", "none.obj"),
    ],
)
def test_a_pattern_is_the_files_that_match(
    folder: Path, pattern: str, found: str, absolute: bool
) -> None:
    root = folder if absolute else Path()
    split = found.split(",") if "," in found or "[" in found else found.split()
    assert expanded([root / pattern]) == [root / name for name in split]


@pytest.mark.parametrize(
    ("pattern", "clause"),
    [
        ("*.ply", "check its folder, its spelling and its ending"),
        ("deep/?", "check its folder"),
        ("nowhere/*.obj", "there is no folder nowhere"),
        ("[z].obj", "check its folder"),
        ("no*/x.obj", "check its folder"),
    ],
)
def test_nothing_that_matches_is_said(
    folder: Path, pattern: str, clause: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with raises("file-not-found", "No file matches"):
        expanded([Path(pattern)])
    for command in ((), ("info",)):
        assert cli.main([*command, pattern]) == 2
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert str(Path(pattern)) in err
        assert clause in err


def test_commands_take_patterns(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["info", "[abc]*.obj", "--json"]) == 0
    said = [json.loads(line)["name"] for line in capsys.readouterr().out.splitlines()]
    assert said == ["a", "b", "c1"]
    chosen = ("--kind", "eigenpairs", "--count", "3", "--no-cache")
    assert cli.main(["features", "?.obj", *chosen, "-o", "out/"]) == 0
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["a.npz", "b.npz"]


def test_a_command_of_one_or_two_meshes_counts_what_matches(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["reconstruct", "a*.obj", "--count", "4", "-o", "rebuilt.ply"]) == 0
    assert (folder / "rebuilt.ply").exists()
    assert cli.main(["compare", "?.obj", "--count", "4"]) == 0
    assert "a and b" in capsys.readouterr().out
    for arguments, said in (
        (
            ("reconstruct", "?.obj", "-o", "x.ply"),
            "takes one mesh, not 2 (a.obj, b.obj): run it once for each",
        ),
        (
            ("render", "[abcd]*.obj", "-o", "x.png"),
            "takes one mesh, not 4 (a.obj, b.obj, c1.obj, …): run it once for each mesh.",
        ),
        (
            ("compare", "[abc]*.obj"),
            "takes two meshes, not 3 (a.obj, b.obj, c1.obj): name two files.",
        ),
        (("compare", "a.obj"), "takes two meshes, not 1 (a.obj): name two files."),
    ):
        assert cli.main(list(arguments)) == 2
        assert said in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_an_argument_too_many_is_one_sentence_with_a_remedy(
    command: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    required = {"movie": ["--turntable"], "points": ["--points", "p.csv"], "predict": ["--model"]}
    chosen = [*required.get(command, []), *(["m.skops"] if command == "predict" else [])]
    chosen += ["--labels", "l.csv"] if command in ("regions", "train", "carry") else []
    chosen += ["--json"] if command == "info" else ["-o", "out.skops"]
    with contextlib.suppress(SystemExit):  # train also takes meshes after options
        status = cli.main([command, "a.obj", *chosen, "b.obj"])
        assert (command, status) == ("train", 2)
    one_mesh = ("reconstruct", "regions", "points", "render", "gallery", "movie")
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    if command in one_mesh:
        assert f"{command}: takes one mesh, so b.obj is one argument too many: run it once" in said
    elif command == "train":
        assert "There are 2 meshes and 1 --labels" in said
    else:
        assert f"{command}: finds b.obj after an option: name all meshes together, before" in said


def test_a_mesh_after_an_option_of_the_window(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(["a.obj", "--map", "a.npy", "b.npy"])
    assert end.value.code == 2
    said = capsys.readouterr().err
    assert "finds b.npy after an option" in said
    assert "repeat an option, such as --map, before each of its values" in said


def test_the_window_opens_what_matches(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened = []
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    monkeypatch.setattr(
        "meshmash_viewer.app.run.run_app", lambda path, *_, **__: opened.append(path) or 0
    )
    assert cli.main(["scan*.obj"]) == 0
    assert cli.main(["scan [1].obj"]) == 0
    assert opened == [Path("scan [1].obj")] * 2
    assert capsys.readouterr().err == ""
    assert cli.main(["[ab].obj"]) == 0
    assert opened[2:] == [Path("a.obj")]
    assert "opens only a.obj, not b.obj" in capsys.readouterr().err
    assert window_parser().parse_args(["a.obj"]).mesh == [Path("a.obj")]

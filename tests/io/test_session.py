"""A session comes back as it was; what is not one is said in a sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.session import Session, read_session, write_session

SESSION = Session(
    repairs=["keep_largest_component"],
    unit="8 nm",
    mesh_hash="ab" * 32,
    operator={"robust": True, "mollify_factor": 1e-5},
    target={"kind": "count", "value": 200},
    display={"field": "hks", "t": 1.5e5, "limits": [0.0, 1e-8]},
    pins=[3, 141],
    camera={"position": [1.0, 2.0, 3.0], "view_up": [0.0, 0.0, 1.0]},
)


def with_mesh(path: Path) -> Session:
    return Session(**{**vars(SESSION), "mesh_path": str(path)})


def test_comes_back(tmp_path: Path) -> None:
    session = with_mesh(tmp_path / "data" / "neuron.obj")
    write_session(tmp_path / "a.meshmash.json", session)
    assert read_session(tmp_path / "a.meshmash.json") == session
    write_session(tmp_path / "b.json", Session())
    assert read_session(tmp_path / "b.json") == Session()


def test_moves_together_with_its_mesh(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    write_session(here / "a.json", with_mesh(here / "neuron.obj"))
    write_session(here / "b.json", with_mesh(tmp_path / "elsewhere.obj"))
    here.rename(there)
    assert read_session(there / "a.json").mesh_path == str(there / "neuron.obj")
    assert read_session(there / "b.json").mesh_path == str(tmp_path / "elsewhere.obj")


@pytest.mark.parametrize(
    ("content", "clause"),
    [
        ("", "not a session"),
        ("[]", "not a session"),
        ('{"format": "another"}', "not a session"),
        ('{"format": "meshmash-viewer session", "version": 99}', "version 99"),
        ('{"format": "meshmash-viewer session", "version": 1, "pins": "x"}', "'pins'"),
        ('{"format": "meshmash-viewer session", "version": 1, "pins": [-1]}', "'pins'"),
        ('{"format": "meshmash-viewer session", "version": 1, "camera": 3}', "'camera'"),
    ],
)
def test_faulty_files(content: str, clause: str, tmp_path: Path) -> None:
    path = tmp_path / "faulty.json"
    path.write_text(content)
    with pytest.raises(InputError, match=clause):
        read_session(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a session"):
        read_session(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_session(tmp_path / "absent.json")


def test_entries_of_later_programs_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_session(path, SESSION)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"novelty": 1}))
    assert read_session(path) == SESSION


def test_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no folder"):
        write_session(tmp_path / "absent" / "a.json", SESSION)

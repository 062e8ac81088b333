"""Session files: round trips, and one-sentence errors for invalid files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.io.session import Session, read_session, write_session
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.spectral.weyl import Target

SESSION = Session(
    repairs=["merge_coincident_vertices", "merge_seams", "keep_largest_component"],
    unit="8 nm",
    mesh_hash="ab" * 32,
    operator=OperatorOptions(False, 1e-4),
    target=Target("count", 200),
    display={"kind": "hks", "time": 1.5e5},
    pins=[3, 141],
    pin_numbers=[2, 1],
    pin_names=["soma", ""],
    pin_colors=["", "#123456"],
    n_vertices=642,
    camera={"focus": [1.0, 2.0, 3.0], "axes": np.eye(3).tolist(), "half_size": 0.5},
)


def flat(session: Session) -> dict[str, Any]:
    """Return the content of a session file before version 4."""
    return {"format": "meshmash-viewer session", "version": 3, **session.plain()}


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


def test_the_one_name_of_older_sessions_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.meshmash.json"
    for name, names in (("a.maps.npz", ["a.maps.npz"]), ("", [])):
        path.write_text(json.dumps(flat(SESSION) | {"kept_maps": name}))
        assert read_session(path).kept_maps == names


def test_the_second_mesh_of_older_sessions_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    match = {"feature": "WKS", "refined": True, "carried": False}
    second = {
        "second_path": "b.obj", "second_unit": "nm", "second_maps": ["b.csv"],
        "second_map_names": ["u"], "second_repairs": ["keep_largest_component"],
        "second_part": "x", "links": ["camera"],
    }  # fmt: skip
    for named, pins in (({}, [("soma", ""), ("", "")]), ({"pin_names": ["a", "b"]}, [])):
        old = flat(SESSION) | second
        path.write_text(json.dumps(old | {"match": match | {"pinned": [[2, 7], [5, 8]]} | named}))
        session = read_session(path)
        other = session.second
        assert other is not None
        assert (session.match, session.links) == (match, ["camera"])
        assert (other.mesh_path, other.unit) == (str(tmp_path / "b.obj"), "nm")
        assert (other.maps, other.map_names) == ([str(tmp_path / "b.csv")], ["u"])
        assert (other.repairs, other.part) == (["keep_largest_component"], "x")
        assert (other.pins, other.pin_numbers) == ([7, 8], [2, 5])
        assert other.pin_names == ([name for name, _ in pins] or ["a", "b"])
        assert other.pin_colors == ["", ""]
        assert other.operator == SESSION.operator
        write_session(path, session)
        assert read_session(path) == session


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("", "wrong-format"),
        ("[]", "wrong-format"),
        ('{"format": "another"}', "wrong-format"),
        ('{"format": "meshmash-viewer session", "version": 99}', "wrong-version"),
        ("[" * 100_000, "wrong-format"),
    ],
)
def test_faulty_files(content: str, code: str, tmp_path: Path) -> None:
    path = tmp_path / "faulty.json"
    path.write_text(content)
    with raises(code):
        read_session(path)
    path.write_bytes(b"\xff\xfe\x00")
    with raises("wrong-format"):
        read_session(path)
    with raises("not-readable"):
        read_session(tmp_path / "absent.json")


def test_entries_of_later_programs_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_session(path, SESSION)
    content = json.loads(path.read_text())
    for place in (content, content["window"], content["meshes"][0]):
        place["novelty"] = 1
    path.write_text(json.dumps(content))
    assert read_session(path) == SESSION


def test_cannot_be_written(tmp_path: Path) -> None:
    with raises("folder-not-found"):
        write_session(tmp_path / "absent" / "a.json", SESSION)


@pytest.mark.parametrize(
    ("entry", "value", "clause"),
    [
        ("pins", [3, -1], "pins[1] (Expected `int` >= 0)"),
        ("pins", [3, True], "pins[1] (Expected `int`, got `bool`)"),
        ("pins", [3, 642], "pins (vertex 642, and its mesh has 642 vertices)"),
        ("pins", list(range(10_001)), "pins (Expected `array` of length <= 10000)"),
        ("pin_colors", ["red"], "pin_colors[0] (Expected `str`"),
        ("camera", {"half_size": float("nan")}, "camera.half_size (Expected `float` >="),
        ("repairs", ["keep"], "repairs[0] (no repair is called 'keep')"),
        ("unit", "0 nm", "unit ("),
        ("mesh_path", "a\0b", "mesh_path (Expected `str`"),
        ("mesh_path", "\ud800", "mesh_path (Expected `str`"),
        ("mesh_path", "x" * 5000, "mesh_path (Expected `str` of length <= 4096)"),
        ("operator", {"mollify_factor": -1.0}, "operator (mollify_factor is -1"),
        ("target", {"kind": "count", "value": 1.5}, "whole number"),
        ("target", {"kind": "wavelength", "value": 0}, "positive number"),
    ],
)
def test_a_value_out_of_range_is_named(
    entry: str, value: object, clause: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.meshmash.json"
    path.write_text(json.dumps(flat(SESSION) | {entry: value}))
    with raises("invalid-entry", clause) as refused:
        read_session(path)
    assert refused.value.fault.startswith(f"bad.meshmash.json has an invalid {entry}")
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300
    for at, place in enumerate(("", "meshes[1].")):
        write_session(path, replace(SESSION, second=SESSION))
        content = json.loads(path.read_text())
        (content["window"] if entry == "camera" else content["meshes"][at])[entry] = value
        path.write_text(json.dumps(content))
        with raises("invalid-entry") as again:
            read_session(path)
        place = "" if entry == "camera" else place
        assert again.value.fault == refused.value.fault.replace("invalid ", f"invalid {place}")


def test_an_entry_of_another_type_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bad.meshmash.json"
    content = flat(SESSION)
    assert len(content) > 20
    for entry in content.keys() - {"format", "version"}:
        for wrong in ([{"another": [1]}], 10**400):
            path.write_text(json.dumps(content | {entry: wrong}))
            with raises("invalid-entry", f"has an invalid {entry}"):
                read_session(path)


def test_a_file_too_large_for_a_session_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "large.json"
    with path.open("wb") as file:
        file.truncate(20_000_000_000)
    with raises("too-large"):
        read_session(path)


@pytest.mark.parametrize("value", [12.5, 1e-8])
def test_a_target_that_is_a_length_needs_no_whole_number(value: float, tmp_path: Path) -> None:
    session = Session(**{**vars(SESSION), "target": Target("wavelength", value)})
    write_session(tmp_path / "a.json", session)
    assert read_session(tmp_path / "a.json").target == Target("wavelength", value)

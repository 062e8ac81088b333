from __future__ import annotations

import errno
import io
import os
import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.transport import Wire


@pytest.fixture
def wire(tmp_path: Path) -> Iterator[Wire]:
    source, sink = os.pipe()
    wire = Wire(os.fdopen(source, "rb"), os.fdopen(sink, "wb"), tmp_path)
    yield wire
    wire.close()


def test_small_things_go_as_they_are(wire: Wire, tmp_path: Path) -> None:
    wire.send({"a": [1, 2.5, None]})
    assert not any(tmp_path.iterdir())
    assert wire.receive() == {"a": [1, 2.5, None]}


@pytest.mark.parametrize("order", ["C", "F"])
def test_large_arrays_pass_through_files_that_do_not_stay(
    wire: Wire, tmp_path: Path, order: str
) -> None:
    sent = np.asarray(np.arange(60_000, dtype=np.float64).reshape(3, -1), order=order)
    wire.send(("kind", sent, sent[0, :10].copy()))
    assert len(list(tmp_path.iterdir())) == 1
    kind, received, head = wire.receive()
    assert kind == "kind"
    np.testing.assert_array_equal(received, sent)
    np.testing.assert_array_equal(head, sent[0, :10])
    assert not any(tmp_path.iterdir())


def test_mesh_arrives_read_only_with_its_hash_and_without_what_can_be_derived(
    wire: Wire, tmp_path: Path, sphere: Mesh
) -> None:
    known = sphere.content_hash
    assert sphere.vertex_normals.shape == (642, 3)
    wire.send(sphere)
    mesh = wire.receive()
    assert "content_hash" in mesh.__dict__
    assert "vertex_normals" not in mesh.__dict__
    assert mesh.content_hash == known
    np.testing.assert_array_equal(mesh.faces, sphere.faces)
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0] = 0.0
    np.testing.assert_array_equal(mesh.vertex_normals, sphere.vertex_normals)


def test_nothing_is_left_of_what_cannot_be_sent(wire: Wire, tmp_path: Path) -> None:
    with pytest.raises((pickle.PicklingError, AttributeError), match=r"pickle|lambda|local"):
        wire.send((np.zeros(100_000), lambda: None))
    assert not any(tmp_path.iterdir())


def test_a_folder_that_takes_nothing_is_named(tmp_path: Path) -> None:
    source, sink = os.pipe()
    folder = tmp_path / "gone"
    wire = Wire(os.fdopen(source, "rb"), os.fdopen(sink, "wb"), folder)
    with pytest.raises(OSError, match=r"gone") as caught:
        wire.send(np.zeros(100_000))
    assert caught.value.filename == str(folder)
    wire.close()


def test_end_of_the_other_side_is_an_end(tmp_path: Path) -> None:
    source, sink = os.pipe()
    wire = Wire(os.fdopen(source, "rb"), os.fdopen(sink, "wb"), tmp_path)
    wire._sink.close()
    with pytest.raises(EOFError):
        wire.receive()
    wire.close()


def test_large_arrays_of_a_message_arrive_each_in_its_place(wire: Wire, tmp_path: Path) -> None:
    sent = [np.full(40_000 + i, float(i)) for i in range(3)]
    wire.send(sent)
    wire.send("after")
    assert len(list(tmp_path.iterdir())) == 3
    for one, two in zip(wire.receive(), sent, strict=True):
        np.testing.assert_array_equal(one, two)
        one[0] = -1.0  # it is the receiver's own
    assert wire.receive() == "after"


def test_a_file_cut_short_is_an_end_too(wire: Wire, tmp_path: Path) -> None:
    wire.send(np.zeros(100_000))
    (file,) = tmp_path.iterdir()
    os.truncate(file, 1000)
    with pytest.raises(EOFError, match="shorter than its 800000 bytes"):
        wire.receive()


def test_half_a_message_is_an_end(tmp_path: Path) -> None:
    source, sink = os.pipe()
    wire = Wire(os.fdopen(source, "rb"), os.fdopen(sink, "wb"), tmp_path)
    wire._sink.write((100).to_bytes(8, "little") + b"half of it")
    wire._sink.close()
    with pytest.raises(EOFError, match="other end"):
        wire.receive()
    wire.close()


class Gone(io.BytesIO):
    """The end of a pipe whose other end has gone, as an operating system puts it."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number

    def _fail(self, *_: object) -> int:
        raise OSError(self._number, os.strerror(self._number))

    write = flush = read = close = _fail  # type: ignore[assignment]

    def __del__(self) -> None: ...


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EINVAL])
@pytest.mark.parametrize("message", ["small", np.zeros(100_000)])
def test_a_pipe_that_has_gone_is_the_same_on_every_system(
    number: int, message: object, tmp_path: Path
) -> None:
    wire = Wire(Gone(number), Gone(number), tmp_path)
    with pytest.raises(BrokenPipeError):
        wire.send(message)
    assert not any(tmp_path.iterdir())
    with pytest.raises((BrokenPipeError, EOFError)):
        wire.receive()
    wire.close()


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EINVAL, errno.ENOSPC, errno.EIO])
def test_closing_never_raises(number: int, tmp_path: Path) -> None:
    source, sink = os.pipe()
    with os.fdopen(sink, "wb") as other:
        wire = Wire(os.fdopen(source, "rb"), Gone(number), tmp_path)
        wire.close()
        assert wire._source.closed, "the other one is closed all the same"
        other.close()


def test_a_full_disk_is_no_pipe_that_has_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(Path, "write_bytes", full)
    wire = Wire(io.BytesIO(), io.BytesIO(), tmp_path)
    with pytest.raises(OSError, match="Invalid argument") as caught:
        wire.send(np.zeros(100_000))
    assert not isinstance(caught.value, BrokenPipeError)
    assert caught.value.filename == str(tmp_path)

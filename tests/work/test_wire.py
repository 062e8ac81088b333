from __future__ import annotations

import errno
import io
import os
import pickle
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.work import Wire


@pytest.fixture
def wire() -> Iterator[Wire]:
    source, sink = os.pipe()
    wire = Wire(os.fdopen(source, "rb"), os.fdopen(sink, "wb"))
    yield wire
    wire.close()


@pytest.mark.parametrize("order", ["C", "F"])
def test_what_is_sent_arrives(wire: Wire, order: str) -> None:
    sent = np.asarray(np.arange(60_000, dtype=np.float64).reshape(3, -1), order=order)
    threading.Thread(target=wire.send, args=(("kind", sent, sent[0, ::2], [1, 2.5, None]),)).start()
    kind, received, half, others = wire.receive()
    assert (kind, others) == ("kind", [1, 2.5, None])
    np.testing.assert_array_equal(received, sent)
    np.testing.assert_array_equal(half, sent[0, ::2])


def test_mesh_arrives_read_only_with_its_hash_and_without_what_can_be_derived(
    wire: Wire, sphere: Mesh
) -> None:
    known = sphere.content_hash
    assert sphere.vertex_normals.shape == (642, 3)
    threading.Thread(target=wire.send, args=(sphere,)).start()
    mesh = wire.receive()
    assert "content_hash" in mesh.__dict__
    assert "vertex_normals" not in mesh.__dict__
    assert mesh.content_hash == known
    np.testing.assert_array_equal(mesh.faces, sphere.faces)
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0] = 0.0
    np.testing.assert_array_equal(mesh.vertex_normals, sphere.vertex_normals)


def test_of_what_cannot_be_sent_nothing_is_sent(wire: Wire) -> None:
    with pytest.raises((pickle.PicklingError, AttributeError), match=r"pickle|lambda|local"):
        wire.send((np.zeros(1000), lambda: None))
    wire.send("after")
    assert wire.receive() == "after"


def test_end_of_the_other_side_is_an_end() -> None:
    source, sink = os.pipe()
    wire = Wire(os.fdopen(source, "rb"), os.fdopen(sink, "wb"))
    wire._sink.close()
    with pytest.raises(EOFError):
        wire.receive()
    wire.close()


def test_large_arrays_of_a_message_arrive_each_in_its_place(wire: Wire) -> None:
    sent = [np.full(40_000 + i, float(i)) for i in range(3)]

    def send() -> None:
        wire.send(sent)
        wire.send("after")

    threading.Thread(target=send).start()
    for one, two in zip(wire.receive(), sent, strict=True):
        np.testing.assert_array_equal(one, two)
        one[0] = -1.0  # the receiver may write to its copy
    assert wire.receive() == "after"


def test_half_a_message_is_an_end() -> None:
    source, sink = os.pipe()
    wire = Wire(os.fdopen(source, "rb"), os.fdopen(sink, "wb"))
    wire._sink.write((100).to_bytes(8, "little") + b"half of it")
    wire._sink.close()
    with pytest.raises(EOFError, match="other end"):
        wire.receive()
    wire.close()


class Gone(io.BytesIO):
    """End of a pipe whose other end is closed; every operation fails with the given errno."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number

    def _fail(self, *_: object) -> int:
        raise OSError(self._number, os.strerror(self._number))

    write = flush = read = close = _fail  # type: ignore[assignment]

    def __del__(self) -> None: ...


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EINVAL])
@pytest.mark.parametrize("message", ["small", np.zeros(100_000)])
def test_a_pipe_that_has_gone_is_the_same_on_every_system(number: int, message: object) -> None:
    wire = Wire(Gone(number), Gone(number))
    with pytest.raises(BrokenPipeError):
        wire.send(message)
    with pytest.raises((BrokenPipeError, EOFError)):
        wire.receive()
    wire.close()


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EINVAL, errno.ENOSPC, errno.EIO])
def test_closing_never_raises(number: int) -> None:
    source, sink = os.pipe()
    with os.fdopen(sink, "wb") as other:
        wire = Wire(os.fdopen(source, "rb"), Gone(number))
        wire.close()
        assert wire._source.closed, "the other one is closed all the same"
        other.close()

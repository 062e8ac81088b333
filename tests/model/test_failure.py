"""Messages about exceptions, and whether the user can correct the cause."""

from __future__ import annotations

import errno
import os

import pytest
from psygnal import EmitLoopError, Signal

from meshmash_viewer.errors import InputError
from meshmash_viewer.model.notices import failure_of


def raised(kind: type[BaseException], *said: object) -> BaseException:
    with pytest.raises(kind) as caught:
        raise kind(*said)
    return caught.value


def test_what_can_be_mended_says_how_and_has_a_defect_for_details_alone() -> None:
    wrong = failure_of(raised(InputError, "The mesh is upside down: turn it over."), "Reading a")
    assert (wrong.text, wrong.details) == ("The mesh is upside down: turn it over.", "")
    full = failure_of(raised(OSError, errno.ENOSPC, "No space left on device", "out.npz"))
    assert full.text == "out.npz: No space left on device; free the disk, or choose another folder."
    unnamed = failure_of(raised(OSError, errno.EIO, "Input/output error"))
    assert unnamed.text.startswith("The system reports: Input/output error; check the disk")
    memory = failure_of(raised(MemoryError))
    assert "fewer eigenpairs" in memory.text
    for failure in (wrong, full, unnamed, memory):
        assert failure.correctable
    for failure in (full, unnamed, memory):
        assert "Traceback" in failure.details


@pytest.mark.parametrize("number", sorted(errno.errorcode))
def test_only_a_full_disk_is_to_be_freed(number: int) -> None:
    fault = raised(OSError, number, os.strerror(number))
    text = failure_of(fault, "Writing bunny.npz").text
    assert text.startswith(f"Writing bunny.npz: {os.strerror(number)}; ")
    assert ("free the disk" in text) == (number in (errno.ENOSPC, errno.EDQUOT))
    assert text.endswith(".")
    assert len(text.partition("; ")[2]) > 10


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.EACCES, "give yourself permission"),
        (errno.EROFS, "choose another folder"),
        (errno.ENOENT, "check the name and its folder"),
        (errno.EMFILE, "close other programs or windows"),
        (errno.ENOMEM, "close other programs"),
        (errno.ETIMEDOUT, "check the disk and the network"),
    ],
)
def test_the_remedy_follows_from_the_error_of_the_system(number: int, remedy: str) -> None:
    assert remedy in failure_of(raised(OSError, number, os.strerror(number), "a.npz")).text


@pytest.mark.parametrize("fault", [KeyError("no such place"), OSError("no such place")])
def test_a_defect_is_the_programs_and_brings_its_traceback(fault: Exception) -> None:
    doing = failure_of(fault, "Writing bunny.npz")
    assert doing.text.startswith("Writing bunny.npz failed by a defect of the program (")
    alone = failure_of(fault)
    assert alone.text.startswith("A defect of the program (")
    for failure in (doing, alone):
        assert f"{type(fault).__name__}: " in failure.text
        assert "no such place" in failure.text
        assert "no such place" in failure.details
        assert not failure.correctable
    assert len(failure_of(KeyError("word " * 1000)).text) < 500


def test_what_a_listener_of_the_model_raised_is_said_not_that_it_was_one() -> None:
    class Model:
        changed = Signal()

    def complain() -> None:
        raise InputError("Turn it over.")

    model = Model()
    model.changed.connect(complain)
    with pytest.raises(EmitLoopError) as caught:
        model.changed.emit()
    assert failure_of(caught.value).text == "Turn it over."

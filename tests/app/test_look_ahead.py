from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtCore import QObject
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.look_ahead import LookAhead
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.model.field import Field, FieldRequest

SPECTRUM = Spectrum(np.arange(30.0), np.zeros((30, 4)), np.zeros(30))
FLIPPED = frozenset({6})


CHOSEN = Eigenfunctions(flipped=FLIPPED)


def asked(index: int) -> FieldRequest:
    return FieldRequest(SPECTRUM, "nm", replace(CHOSEN, index=index).resolved(SPECTRUM, {}))


def expected(before: FieldRequest | None, request: FieldRequest) -> FieldRequest | None:
    previous = None if before is None else before.family
    family = request.family.likely_next(previous, CHOSEN, SPECTRUM)
    return None if family is None else replace(request, family=family)


class Computer:
    """Answers requests with zeros, and knows which."""

    def __init__(self) -> None:
        self.requests: list[FieldRequest] = []
        self.go_on = threading.Event()
        self.go_on.set()
        self.fault: Exception | None = None

    def __call__(self, request: FieldRequest) -> Field:
        self.requests.append(request)
        assert self.go_on.wait(10)
        if self.fault is not None:
            raise self.fault
        return Field(np.zeros(4, dtype=np.float32), request)


@pytest.fixture
def computer() -> Computer:
    return Computer()


@pytest.fixture
def ahead(qtbot: QtBot, computer: Computer) -> Iterator[LookAhead]:
    owner = QObject()
    ahead = LookAhead(computer, expected, owner)
    yield ahead
    computer.go_on.set()
    ahead.close()


@pytest.mark.parametrize(
    ("visited", "wanted"),
    [
        ([4], 5),
        ([5, 4], 3),
        ([4, 7], 10),
        ([3, 25], 26),  # a leap: on from there by one
        ([25, 3], 4),
        ([8, 8], 9),  # the same again, as after a draft
    ],
)
def test_it_goes_on_in_the_direction_of_the_last_step(
    qtbot: QtBot, ahead: LookAhead, visited: list[int], wanted: int
) -> None:
    for index in visited:
        ahead.follow(asked(index))
    qtbot.waitUntil(lambda: ahead.answer(asked(wanted)) is not None)
    assert ahead.answer(asked(wanted)).request == asked(wanted)
    assert ahead.answer(asked(wanted + 1)) is None


def test_it_knows_which_signs_are_changed(qtbot: QtBot, ahead: LookAhead) -> None:
    ahead.follow(asked(5))
    qtbot.waitUntil(lambda: ahead.answer(asked(6)) is not None)
    assert ahead.answer(asked(6)).request.family.flipped


@pytest.mark.parametrize("visited", [[28, 29], [1, 0], [20, 29]])
def test_there_is_nothing_beyond_the_ends(
    qtbot: QtBot, ahead: LookAhead, computer: Computer, visited: list[int]
) -> None:
    for index in visited:
        ahead.follow(asked(index))
    qtbot.wait(60)
    assert all(0 <= request.family.index < 30 for request in computer.requests)


def test_another_kind_of_field_or_mesh_needs_no_such_field(qtbot: QtBot, ahead: LookAhead) -> None:
    ahead.follow(asked(4))
    qtbot.waitUntil(lambda: ahead.answer(asked(5)) is not None)
    ahead.follow(replace(asked(0), family=HeatKernelSignature(time=1.0)))
    assert ahead.answer(asked(5)) is None


def test_what_was_forgotten_meanwhile_is_not_kept(
    qtbot: QtBot, ahead: LookAhead, computer: Computer
) -> None:
    computer.go_on.clear()
    ahead.follow(asked(4))
    qtbot.waitUntil(lambda: len(computer.requests) == 1)
    ahead.forget()
    computer.go_on.set()
    qtbot.waitUntil(lambda: not ahead._thread.working)
    assert ahead.answer(asked(5)) is None


def test_a_fault_is_left_to_whoever_asks(
    qtbot: QtBot, ahead: LookAhead, computer: Computer
) -> None:
    computer.fault = OSError("the disk is gone")
    ahead.follow(asked(4))
    qtbot.waitUntil(lambda: len(computer.requests) == 1 and not ahead._thread.working)
    assert ahead.answer(asked(5)) is None
    computer.fault = None
    ahead.follow(asked(5))
    qtbot.waitUntil(lambda: ahead.answer(asked(6)) is not None)

from __future__ import annotations

import numpy as np
import pytest

from meshmash_viewer.certificate import Certificate
from meshmash_viewer.model.display import FieldKind
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.ranges import hks_range
from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.model.stepping import advance, go_to_end, go_to_start, step


@pytest.fixture
def document() -> Document:
    document = Document()
    eigenvalues = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 8.0])
    proven = Certificate("dense", 6, 6)
    document.accept_spectrum(
        Spectrum(eigenvalues, np.zeros((6, 3)), np.zeros(6), certificate=proven)
    )
    return document


def test_eigenfunctions_stop_at_the_ends_and_playing_goes_round(document: Document) -> None:
    display = document.display
    assert step(document, 1)
    assert display.index == 2
    go_to_end(document)
    assert display.index == 5
    assert not step(document, 1)
    advance(document)
    assert display.index == 0
    assert not step(document, -1)


def test_bands(document: Document) -> None:
    document.display.kind = FieldKind.BAND
    step(document, 10)
    assert document.display.band == 10
    go_to_end(document)
    assert document.display.band == document.display.band_count - 1
    go_to_start(document)
    assert document.display.band == 0


def test_a_step_in_time_is_a_scale_of_the_feature(document: Document) -> None:
    display = document.display
    display.kind = FieldKind.HKS
    t_min, t_max = hks_range(document.spectrum, display)  # type: ignore[arg-type]
    go_to_start(document)
    assert display.time == pytest.approx(t_min)
    for _ in range(display.hks_scales - 1):
        assert step(document, 1)
    assert display.time == pytest.approx(t_max)
    assert not step(document, 1)
    advance(document)
    assert display.time == pytest.approx(t_min)


def test_nothing_to_step_through() -> None:
    document = Document()
    assert not step(document, 1)
    go_to_end(document)
    assert document.display.index == 1

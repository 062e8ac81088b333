from __future__ import annotations

import numpy as np
import pytest

from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.table import FAR
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import advance, step
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


@pytest.fixture
def document() -> Document:
    document = Document()
    eigenvalues = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 8.0])
    proven = Certificate("dense", 6, 6)
    document.accept_spectrum(
        Eigenpairs(eigenvalues, np.zeros((6, 3)), np.zeros(6), certificate=proven)
    )
    return document


def test_eigenfunctions_stop_at_the_ends_and_playing_goes_round(document: Document) -> None:
    display = document.display
    assert step(document, 1)
    assert display[Eigenfunctions].index == 2
    step(document, FAR)
    assert display[Eigenfunctions].index == 5
    assert not step(document, 1)
    advance(document)
    assert display[Eigenfunctions].index == 0
    assert not step(document, -1)


def test_bands(document: Document) -> None:
    document.display.kind = "band"
    step(document, 10)
    assert document.display[GeometryVectors].index == 10
    step(document, FAR)
    assert document.display[GeometryVectors].index == document.display[GeometryVectors].count - 1
    step(document, -FAR)
    assert document.display[GeometryVectors].index == 0


def test_a_step_in_time_is_a_scale_of_the_feature(document: Document) -> None:
    display = document.display
    display.kind = "hks"
    t_min, t_max = display[HeatKernelSignature].range(document.spectrum)  # type: ignore[arg-type]
    step(document, -FAR)
    assert display[HeatKernelSignature].time == pytest.approx(t_min)
    for _ in range(display[HeatKernelSignature].scales - 1):
        assert step(document, 1)
    assert display[HeatKernelSignature].time == pytest.approx(t_max)
    assert not step(document, 1)
    advance(document)
    assert display[HeatKernelSignature].time == pytest.approx(t_min)


def test_nothing_to_step_through() -> None:
    document = Document()
    assert not step(document, 1)
    step(document, FAR)
    assert document.display[Eigenfunctions].index == 1


def test_steps_of_a_time_chosen_by_hand_end_at_the_range(document: Document) -> None:
    display = document.display
    display.kind = "hks"
    display.change(HeatKernelSignature, scales=5)
    display.change(HeatKernelSignature, automatic=False)
    display.change(HeatKernelSignature, t_min=1.0)
    display.change(HeatKernelSignature, t_max=10_000.0)
    display.change(HeatKernelSignature, time=100.0)
    assert step(document, 1)
    assert display[HeatKernelSignature].time == pytest.approx(1000.0)
    assert step(document, -2)
    assert display[HeatKernelSignature].time == pytest.approx(10.0)
    assert step(document, -3)
    assert display[HeatKernelSignature].time == pytest.approx(1.0)
    assert not step(document, -1)
    display.change(HeatKernelSignature, time=9999.0)  # a shorter last step counts
    assert step(document, 1)
    assert display[HeatKernelSignature].time == pytest.approx(10_000.0)
    step(document, -FAR)
    assert display[HeatKernelSignature].time == pytest.approx(1.0)
    step(document, FAR)
    assert display[HeatKernelSignature].time == pytest.approx(10_000.0)


def test_zeros_have_no_time_to_step_through() -> None:
    document = Document()
    document.display.kind = "hks"
    document.accept_spectrum(Eigenpairs(np.zeros(3), np.zeros((3, 3)), np.zeros(3)))
    assert not step(document, 1)
    assert document.display[HeatKernelSignature].time is None

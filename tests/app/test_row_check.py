"""What is damaged on the disk does not stay on the screen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from listeners import Listener
from PySide6.QtCore import QObject

from meshmash_viewer.app import row_check
from meshmash_viewer.app.row_check import RowCheck
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document, Notice
from meshmash_viewer.model.jobs import DecomposeJob, InspectJob
from meshmash_viewer.spectral.weyl import Target

OPERATOR = OperatorOptions()


@pytest.fixture
def opened(qapp: object, sphere: Mesh, tmp_path: Path, monkeypatch) -> Iterator[tuple]:
    """A document, what it has said, and the file of the rows of its mesh."""
    monkeypatch.setattr(row_check, "_AFTER", 0.001)
    listener = Listener(tmp_path)
    grew = DecomposeJob(sphere, OPERATOR, Target("count", 30)).run(listener)
    document, parent, said = Document(), QObject(), []
    document.noticed.connect(said.append)
    check = RowCheck(document, parent)
    assert grew.stored is not None

    def open_mesh() -> None:
        document.accept_mesh(InspectJob(sphere).run(listener))

    yield document, said, grew.stored.path, open_mesh, check
    check.close()


def spoil(path: Path, sphere: Mesh, index: int) -> None:
    rows = np.memmap(path, np.float64, "r+").reshape(-1, sphere.n_vertices)
    rows[index, 100] += 1e-12
    rows.flush()


def test_whole_pairs_stay(opened: tuple, qtbot) -> None:
    document, said, _, open_mesh, check = opened
    open_mesh()
    spectrum = document.spectrum
    assert len(spectrum) == 30
    assert check.thread_.working
    qtbot.waitUntil(lambda: not check.thread_.working)
    assert document.spectrum is spectrum
    assert not said


@pytest.mark.parametrize("index", [0, 12])
def test_pairs_from_a_damaged_one_on_are_taken_away(
    opened: tuple, sphere: Mesh, qtbot, index: int
) -> None:
    document, said, path, open_mesh, _ = opened
    whole = np.array(np.memmap(path, np.float64, "r").reshape(30, -1)[:index])
    spoil(path, sphere, index)
    open_mesh()
    document.display.change(Eigenfunctions, index=20)
    qtbot.waitUntil(lambda: bool(said))
    spectrum = document.spectrum
    if index == 0:
        assert spectrum is None
    else:
        assert len(spectrum) == index
        assert document.display[Eigenfunctions].index == index - 1
        np.testing.assert_array_equal(spectrum.rows[:index], whole)
    assert isinstance(said[0], Notice)
    assert f"Eigenpair {index} is damaged" in said[0].text


def test_what_is_opened_meanwhile_is_not_touched(opened: tuple, qtbot) -> None:
    document, said, _, open_mesh, _ = opened
    open_mesh()
    spectrum = document.spectrum
    document.leave_out_damaged(replace(spectrum, rows=spectrum.rows.copy()), 1)
    assert document.spectrum is spectrum
    assert not said

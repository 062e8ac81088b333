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
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.io.stored_spectrum import Compared, StoredRows
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document, Notice
from meshmash_viewer.model.export import ExportJob
from meshmash_viewer.model.jobs import DecomposeJob, InspectJob
from meshmash_viewer.spectral.weyl import Target

OPERATOR = OperatorOptions()


@pytest.fixture
def opened(qapp: object, sphere: Mesh, tmp_path: Path, monkeypatch) -> Iterator[tuple]:
    """A document, what it has said, and the file of the rows of its mesh."""
    monkeypatch.setattr(row_check, "_DELAY", 0.001)
    listener = Listener(tmp_path)
    grew = DecomposeJob(sphere, OPERATOR, Target("count", 30)).run(listener)
    document, parent, said = Document(), QObject(), []
    document.noticed.connect(said.append)
    check = RowCheck(document, parent)
    assert grew.summary.stored is not None

    def open_mesh() -> None:
        document.accept_mesh(InspectJob(sphere).run(listener))

    yield document, said, grew.summary.stored.path, open_mesh, check
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


def test_it_rests_while_somebody_changes_what_is_drawn(opened: tuple, qtbot, monkeypatch) -> None:
    document, _, _, open_mesh, check = opened
    monkeypatch.setattr(row_check, "_REST_IN_USE", 3600.0)
    open_mesh()
    document.display.change(Eigenfunctions, index=3)
    qtbot.wait(500)
    assert check.thread_.working  # and closing it does not wait for the end of that rest


def test_what_was_found_whole_is_read_again_only_once_somebody_has_written_there(
    opened: tuple, sphere: Mesh, tmp_path: Path, qtbot, monkeypatch
) -> None:
    document, _, path, open_mesh, check = opened
    open_mesh()
    qtbot.waitUntil(lambda: not check.thread_.working and document.compared is not None)
    out, compared, read = tmp_path / "pairs.npz", document.compared, list[int]()
    damaged = StoredRows.damaged
    monkeypatch.setattr(
        StoredRows, "damaged", lambda rows, of, cancel: read.extend(of) or damaged(rows, of, cancel)
    )

    def export(compared: Compared | None) -> None:
        read.clear()
        job = ExportJob(sphere, OPERATOR, out, Eigenfunctions(), 20, compared=compared)
        job.run(Listener(tmp_path))

    export(compared)
    assert read == []
    export(None)
    assert read == list(range(20))
    others = compared.checksums.copy()
    others[3] += 1
    export(replace(compared, checksums=others))  # of a store that was made anew
    assert read == [3]
    with path.open("r+b") as file:
        file.seek(8 * 5 * sphere.n_vertices)
        file.write(b"damage!!")
    with pytest.raises(InputError, match="damaged on the disk"):
        export(compared)
    assert read == list(range(20))


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

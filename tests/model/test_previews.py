from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapes
from listeners import Listener
from tiers import slow

from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model import decomposition as previews
from meshmash_viewer.model.decomposition import decompose, preview
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import FieldRequest, LiveFeatures, compute_field
from meshmash_viewer.model.jobs import prepare
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.weyl import Target

OPERATOR = OperatorOptions()


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> Mesh:
    """A mesh that counts as large, nearly square for nearly double eigenvalues."""
    monkeypatch.setattr(previews, "FROM_VERTICES", 1000)
    return shapes.rectangle(60, 60, 1.0, 1.0001)


def products(mesh: Mesh, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    _, mass = cotangent_laplacian(mesh, robust=True)
    return np.sum(np.asarray(one, dtype=np.float64) * mass.diagonal() * other, axis=1)


def test_small_mesh_needs_no_preview(sphere: Mesh, tmp_path: Path) -> None:
    assert preview(sphere, OperatorOptions(), Listener(tmp_path)).content is None


def test_preview_is_marked_and_found_again(large: Mesh, tmp_path: Path) -> None:
    listener = Listener(tmp_path)
    grew = preview(large, OperatorOptions(), listener).content
    assert grew is not None
    spectrum = grew
    assert spectrum.preview
    assert not spectrum.complete
    assert not spectrum.is_exact(0)
    assert 0.0 < spectrum.error < 0.2
    reports = len(listener.reports)
    again = preview(large, OperatorOptions(), listener).content
    assert again is not None
    assert len(listener.reports) == reports
    (notes,) = tmp_path.glob("preview-*.npz")
    notes.unlink()  # as if the process ended before writing the file
    assert preview(large, OperatorOptions(), listener).content is not None
    assert len(listener.reports) > reports
    request = FieldRequest(spectrum, "nm", Eigenfunctions(3))
    field = compute_field(request, LiveFeatures())
    assert field is not None
    assert field.draft
    assert "≈" in field.quantity


@pytest.mark.parametrize("count", [30, slow(120)])
def test_exact_pairs_take_over_without_a_flip(large: Mesh, tmp_path: Path, count: int) -> None:
    listener = Listener(tmp_path)
    last = decompose(large, OPERATOR, Target("count", count), listener).content
    first = listener.messages[0]
    assert first.preview
    shown = np.array(first.rows)
    document = Document()
    document.accept_spectrum(first)
    for message in listener.messages[1:]:
        document.accept_spectrum(message)
        spectrum = document.spectrum
        assert spectrum is not None
        assert len(spectrum) >= min(len(first), count)
        assert np.all(np.diff(spectrum.eigenvalues) >= 0.0)
        assert spectrum.preview is (len(spectrum.exact) < len(first))
        assert spectrum.error == (first.error if spectrum.preview else 0.0)
        assert spectrum.rows[: len(spectrum), 5].shape == (len(spectrum),)
    final = last
    assert final.complete
    assert not final.preview
    assert len(final) == count
    common = min(count, len(first), 12)
    agreement = products(large, final.shown_rows[:common], shown[:common])
    assert np.all(agreement > 0.9)
    assert len(list(tmp_path.glob("preview-*.f32"))) == 1
    preview(Mesh(large.vertices + 1.0, large.faces), OperatorOptions(), listener)
    assert len(list(tmp_path.glob("preview-*.f32"))) == 1
    # the drawn rows are eigenfunctions too; features use the stored rows
    stiffness, mass = cotangent_laplacian(large, robust=True)
    drawn = np.asarray(final.shown_rows[:common])
    defect = drawn @ stiffness - final.eigenvalues[:common, None] * (drawn @ mass)
    assert np.abs(defect).max() < 1e-4 * np.abs(drawn @ mass).max() * final.eigenvalues[common]
    assert isinstance(final.rows, np.ndarray)


def test_stored_pairs_make_a_preview_needless(large: Mesh, tmp_path: Path) -> None:
    listener = Listener(tmp_path)
    with pytest.raises(Cancelled):
        decompose(large, OPERATOR, Target("count", 60), Listener(tmp_path, stop_at=10))
    decompose(large, OPERATOR, Target("count", 60), listener)
    assert not any(message.preview for message in listener.messages)


def test_a_preview_is_worth_it_while_it_shows_more_than_what_is_known(
    large: Mesh, sphere: Mesh, tmp_path: Path
) -> None:
    listener = Listener(tmp_path)
    assert not previews.is_worthwhile(prepare(sphere, listener).content)
    ready = prepare(large, listener).content
    assert ready.known is None
    assert previews.is_worthwhile(ready)
    preview = previews.open_preview(large, OPERATOR, listener)
    assert preview is not None
    for count, worthwhile in ((10, True), (len(preview), False)):
        decompose(large, OPERATOR, Target("count", count), listener)
        assert previews.is_worthwhile(prepare(large, listener).content) is worthwhile

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapes
from listeners import Listener

from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model import previews
from meshmash_viewer.model.jobs import DecomposeJob, InspectJob, Job, PreviewJob
from meshmash_viewer.model.process import prepare_preview
from meshmash_viewer.spectral.weyl import Target


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> Mesh:
    monkeypatch.setattr(previews, "FROM_VERTICES", 1000)
    return shapes.rectangle(60, 60, 1.0, 1.0001)


def test_a_preview_made_early_is_the_one_that_is_asked_for(large: Mesh, tmp_path: Path) -> None:
    early = Listener(tmp_path)
    prepare_preview(large, early, lambda: None)
    assert early.reports == []
    asked = Listener(tmp_path)
    grew = PreviewJob(large).run(asked)
    assert grew is not None
    assert asked.reports == []
    assert np.isfinite(grew.spectrum.rows[3]).all()


def test_it_is_reported_once_it_is_asked_for(large: Mesh, tmp_path: Path) -> None:
    early, same = Listener(tmp_path), Mesh(large.vertices, large.faces)
    job = DecomposeJob(same, OperatorOptions(), Target("count", 10))
    prepare_preview(large, early, lambda: job)
    assert [progress.stage for progress in early.reports] == ["preview"]
    assert previews.open_preview(large, Listener(tmp_path)) is not None


@pytest.mark.parametrize("other", [InspectJob, PreviewJob])
def test_it_gives_way_to_other_jobs(large: Mesh, tmp_path: Path, other: type[Job]) -> None:
    moved = Mesh(large.vertices + 1.0, large.faces)
    prepare_preview(large, Listener(tmp_path), lambda: other(moved))
    assert not list(tmp_path.glob("preview-*.npz"))

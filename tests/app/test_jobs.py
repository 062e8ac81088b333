from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import shapes
from long_jobs import endless, failing
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.background import Jobs
from meshmash_viewer.app.executor import shutdown
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.decomposition import decompose
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import Export
from meshmash_viewer.model.jobs import Job, Queueing
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.spectral.weyl import Target

_PATIENCE = 30_000


@dataclass
class Session:
    """A document whose jobs are run, and its notices."""

    document: Document
    jobs: Jobs
    qtbot: QtBot
    notices: list[Notice] = field(default_factory=list)

    def wait(self, condition: Callable[[], bool]) -> None:
        self.qtbot.waitUntil(condition, timeout=_PATIENCE)

    def wait_until_idle(self) -> None:
        self.wait(lambda: self.jobs.running is None and self.document.work.job is None)

    def last(self) -> Notice:
        return self.notices[-1]


@pytest.fixture
def session(qtbot: QtBot) -> Iterator[Session]:
    document = Document()
    session = Session(document, Jobs(document), qtbot)
    document.notices.shown.connect(session.notices.append)
    yield session
    shutdown(session.jobs)
    assert not session.jobs.worker.folder.exists()


def test_no_waiting_job_starts_once_all_jobs_have_been_ended(session: Session) -> None:
    work = session.document.work
    work.request(endless())
    waiting = work.request(replace(endless(), queueing=Queueing.COMPLETE))
    session.wait(lambda: work.job is not None)
    shutdown(session.jobs)
    session.qtbot.wait(200)
    assert work.job is not waiting
    assert waiting.began == 0.0


@pytest.fixture
def neuron_file(neuron: Mesh, tmp_path: Path) -> Path:
    path = tmp_path / "neuron.npz"
    np.savez(path, vertices=neuron.vertices, faces=neuron.faces)
    return path


def decomposing(mesh: Mesh, count: int) -> Job:
    work = partial(decompose, mesh, OperatorOptions(), Target("count", count))
    return Job("Decomposing", mesh.name, work, queueing=Queueing.NEWEST)


def test_read_decompose_export_and_open_again(session: Session, neuron_file: Path) -> None:
    document = session.document
    document.open_mesh(neuron_file, "nm")
    assert document.work.job is not None
    session.wait_until_idle()
    assert document.mesh.unit == "nm"
    assert document.mesh.name == "neuron"
    document.solve.target = Target("count", 40)
    document.solve.compute()
    session.wait_until_idle()
    assert len(document.spectrum) == 40
    assert document.spectrum.complete
    out = neuron_file.parent / "out.npz"
    family = EXPORTS["hks"].exported(8)
    document.work.write(out, Export(document.mesh, document.solve.operator, out, family, 40))
    session.wait_until_idle()
    with np.load(out) as file:
        assert file["features"].shape == (document.mesh.n_vertices, 8)
    assert str(out) in session.last().text
    document.open_mesh(neuron_file, "nm")
    session.wait_until_idle()
    assert len(document.spectrum) == 40


@pytest.mark.slow
def test_cancelling_keeps_what_has_converged(session: Session) -> None:
    document = session.document
    document.take_mesh(shapes.icosphere(5))
    session.wait_until_idle()
    document.solve.target = Target("count", 1500)
    document.solve.compute()
    session.wait(lambda: document.spectrum is not None)
    document.work.cancel()
    assert document.work.job.cancelling
    session.wait_until_idle()
    assert 0 < len(document.spectrum) < 1500
    assert (
        f" {len(document.spectrum)} eigenpairs that converged before are kept"
        in session.last().text
    )
    document.solve.target = Target("count", 10)
    document.solve.compute()
    session.wait_until_idle()
    assert document.spectrum.complete


def test_cancelling_before_the_first_pair_says_that_there_is_none(session: Session) -> None:
    document = session.document
    document.take_mesh(shapes.icosphere(5))
    session.wait_until_idle()
    document.solve.target = Target("count", 1500)
    document.solve.compute()
    document.work.cancel()
    session.wait_until_idle()
    assert document.spectrum is None
    assert session.last().text == "Cancelled before any eigenpair converged."


def test_each_requester_gets_the_end_of_its_own_job(session: Session, neuron_file: Path) -> None:
    ended: dict[str, bool] = {}
    for name in ("cancelled", "dropped", "read"):
        session.document.open_mesh(
            neuron_file, then=lambda job, name=name: ended.update({name: job.succeeded})
        )
    session.wait_until_idle()
    assert ended == {"dropped": False, "cancelled": False, "read": True}


def test_a_newer_job_replaces_waits_or_takes_its_turn(
    session: Session, neuron: Mesh, neuron_file: Path
) -> None:
    """A mesh replaces a running job; a decomposition waits, unless its mesh has gone by then."""
    document, ended = session.document, []

    def then(job: Job) -> None:
        ended.append((job.doing, job.succeeded))

    document.work.request(replace(endless(), then=then))
    document.open_mesh(neuron_file, then=then)
    gone, lasting = decomposing(neuron, 20), decomposing(neuron, 8)
    document.work.request(replace(gone, needed=lambda: document.mesh is None, then=then))
    document.work.request(replace(lasting, doing="Previewing", then=then))
    session.wait(lambda: document.mesh is not None)
    session.wait_until_idle()
    assert ended == [
        ("Working", False), ("Reading", True), ("Decomposing", False), ("Previewing", True),
    ]  # fmt: skip
    assert not session.notices


def test_export_waits_its_turn(session: Session, neuron: Mesh, tmp_path: Path) -> None:
    document = session.document
    document.work.request(decomposing(neuron, 20))
    out = tmp_path / "pairs.npz"
    document.work.write(out, Export(neuron, OperatorOptions(), out, EXPORTS["eigenpairs"](), 20))
    assert "waits for" in session.last().text
    session.wait(lambda: out.exists())
    session.wait_until_idle()
    assert document.spectrum is None  # the document has not opened this mesh


def test_a_voxel_size_speaks_of_the_file_however_often_it_is_said(
    session: Session, neuron: Mesh
) -> None:
    document = session.document
    document.take_mesh(neuron)
    session.wait_until_idle()
    for text, factor in (
        ("8 nm", 8.0), ("8 nm", 8.0), ("4 × 4 × 32 nm", (4.0, 4.0, 32.0)), ("nm", 1.0)
    ):  # fmt: skip
        document.set_unit(text)
        session.wait_until_idle()
        assert document.unit_text == text
        np.testing.assert_array_equal(document.mesh.vertices, factor * neuron.vertices)


def test_undo_stops_the_decomposition_of_what_is_gone(session: Session, neuron: Mesh) -> None:
    document = session.document
    document.take_mesh(neuron)
    session.wait_until_idle()
    document.repair("keep_largest_component")
    session.wait_until_idle()
    document.solve.target = Target("count", 1000)
    document.solve.compute()
    document.undo_repair()
    session.wait_until_idle()
    assert document.mesh.n_vertices == neuron.n_vertices
    assert document.spectrum is None or not document.spectrum.complete


@pytest.mark.parametrize("job", [failing("input"), failing("defect")])
def test_failure_is_said_and_the_next_job_runs(
    session: Session, job: Job, neuron_file: Path
) -> None:
    session.document.work.request(job)
    session.wait_until_idle()
    assert session.last().severity is Severity.ERROR
    session.document.open_mesh(neuron_file)
    session.wait_until_idle()
    assert session.document.mesh is not None


def test_a_listener_that_fails_leaves_no_job_running(
    session: Session, neuron_file: Path, qtbot: QtBot
) -> None:
    document = session.document

    def fail() -> None:
        document.mesh_changed.disconnect(fail)
        raise RuntimeError("a panel")

    document.mesh_changed.connect(fail)
    with qtbot.captureExceptions() as faults:
        document.open_mesh(neuron_file)
        session.wait_until_idle()
        session.wait(lambda: bool(faults))
    assert "a panel" in str(faults[0][1].__cause__)
    document.open_mesh(neuron_file)
    session.wait_until_idle()
    assert document.mesh is not None


def test_closing_in_the_middle_of_a_decomposition(qtbot: QtBot) -> None:
    document = Document()
    jobs = Jobs(document)
    document.work.request(decomposing(shapes.icosphere(5), 1000))
    qtbot.waitUntil(
        lambda: document.work.job is not None and document.work.job.progress.total > 0,
        timeout=_PATIENCE,
    )
    shutdown(jobs)
    assert not jobs.worker.folder.exists()
    assert jobs.worker.process_id is None


@pytest.mark.slow
def test_compute_need_not_wait_for_a_preview_and_runs_once(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = session.document
    runs: list[Job] = []
    submit = session.jobs.worker.submit
    monkeypatch.setattr(session.jobs.worker, "submit", lambda job: (runs.append(job), submit(job)))
    document.take_mesh(shapes.rectangle(250, 250))
    session.wait(lambda: document.work.job is not None and document.work.job.doing == "Previewing")
    assert document.solve.can_compute
    document.solve.target = Target("count", 60)
    document.solve.compute()
    document.solve.compute()
    session.wait(lambda: document.spectrum is not None)
    assert document.spectrum.preview
    session.wait(lambda: document.spectrum is not None and document.spectrum.complete)
    session.wait_until_idle()
    assert sum(job.doing == "Decomposing" for job in runs) == 1
    assert document.spectrum.alignment is not None
    assert not session.notices

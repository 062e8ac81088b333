"""Files with features or eigenpairs: always by the direct sum over the stored pairs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.family import Family
from meshmash_viewer.laplacian import OperatorOptions, compute_vertex_areas
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.results import Written
from meshmash_viewer.model.transport import Channel
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import counted

__all__ = ["ExportJob", "export"]


@dataclass(frozen=True, eq=False)
class ExportJob:
    """Compute features by the direct sum, or take the eigenpairs, and write a file.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
        Of the eigenpairs that are looked up in the store.
    path : Path
        Its ending says the format.
    family : Family
        Resolved: what is written, and with which parameters.
    n_pairs : int
        Number of leading eigenpairs to use.
    target : Target, optional
        What was asked for when these were computed.
    repairs : tuple of str
        What has been done to the mesh.
    """

    mesh: Mesh
    operator: OperatorOptions
    path: Path
    family: Family
    n_pairs: int
    target: Target | None = None
    repairs: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        return f"Writing {self.path.name}"

    def run(self, channel: Channel) -> Written:
        return export(self, channel)


def export(job: ExportJob, channel: Channel) -> Written:
    """Write the file that a job describes.

    Raises
    ------
    InputError
        If the eigenpairs are no longer in the store or damaged there, or the file cannot be
        written.
    Cancelled
        If the person asked to stop.
    """
    from meshmash_viewer.features.sums import truncated_features
    from meshmash_viewer.io.provenance import export_options
    from meshmash_viewer.io.spectrum import find_eigenpairs
    from meshmash_viewer.io.write import write_eigenpairs, write_features
    from meshmash_viewer.model.decomposition import SPARE

    channel.report(Progress("reading", message="Reading eigenpairs"))
    stored = find_eigenpairs(job.mesh, job.operator, channel.folder / SPARE)
    if stored is None or stored.n_converged < job.n_pairs:
        raise InputError(
            "The eigenpairs of this mesh are no longer in the cache: compute them again."
        )
    damaged = stored.damaged_batches(job.n_pairs, channel.cancelled)
    if channel.cancelled():
        raise Cancelled  # maybe before all was looked at
    if damaged:
        raise InputError(
            "Some eigenpairs of this mesh are damaged on the disk: compute them again,"
            " which takes what is whole as it is."
        )
    decomposition = stored.decomposition(job.n_pairs)
    meta = export_options(
        job.family.export,
        job.operator,
        job.target or Target("count", job.n_pairs),
        decomposition.proof(job.mesh.unit),
        job.repairs,
    )
    if not job.family.counted:
        channel.report(Progress("writing", message=job.label))
        write_eigenpairs(job.path, decomposition, job.mesh, meta)
        return Written(job.path, counted(job.n_pairs, "eigenpair"))
    if not len(decomposition.mass):
        # A solve that was cancelled has left pairs, but nothing that says how they are weighed.
        operator = job.operator
        areas = compute_vertex_areas(job.mesh, operator.robust, operator.mollify_factor)
        decomposition = replace(decomposition, mass=areas)
    values = decomposition.eigenvalues
    bank = job.family.bank(values)
    channel.report(Progress("features", message="Computing features"))
    # The threshold that the pairs were computed to says more than the last of them.
    bound = None if stored.proof is None else stored.proof.max_eigenvalue
    all_of_them = decomposition.complete and job.n_pairs == len(stored.eigenvalues)
    features = truncated_features(
        decomposition, bank, unit=job.mesh.unit, known_to=bound if all_of_them else None
    )
    if channel.cancelled():
        raise Cancelled
    channel.report(Progress("writing", message=job.label))
    write_features(job.path, features, job.mesh, eigenvalues=values, meta=meta)
    said = "" if features.truncation is None else features.truncation.sentence()
    return Written(job.path, f"{job.family.label}, {counted(bank.n_filters, 'column')},", said)

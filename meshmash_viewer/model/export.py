"""Files with features or eigenpairs: always by the direct sum over the stored pairs."""

from __future__ import annotations

from meshmash_viewer.errors import InputError
from meshmash_viewer.model.jobs import Channel, ExportJob, Written
from meshmash_viewer.progress import Progress

__all__ = ["KINDS", "export"]

#: Kinds of export and what they are called.
KINDS = {
    "hks": "Heat kernel signature",
    "geometry-vectors": "Geometry vectors",
    "eigenpairs": "Eigenpairs",
}


def export(job: ExportJob, channel: Channel) -> Written:
    """Write the file that a job describes.

    Raises
    ------
    InputError
        If the kind is unknown, the eigenpairs are no longer in the store, or the file cannot be
        written.
    """
    from meshmash_viewer.features import compute_features
    from meshmash_viewer.filters import bspline_bank, heat_kernel_bank, hks_times
    from meshmash_viewer.io.write import provenance, write_eigenpairs, write_features
    from meshmash_viewer.model.decomposition import open_store

    if job.kind not in KINDS:
        raise InputError(f"{job.kind!r} cannot be exported: choose one of {', '.join(KINDS)}.")
    channel.report(Progress("reading", message="Reading eigenpairs"))
    stored = open_store(job.mesh, job.operator, channel).load()
    if stored is None or stored.n_converged < job.n_pairs:
        raise InputError(
            "The eigenpairs of this mesh are no longer in the cache: compute them again."
        )
    decomposition = stored.decomposition(job.n_pairs)
    options = {
        "kind": job.kind,
        "n_pairs": job.n_pairs,
        "robust": job.operator.robust,
        "mollify_factor": job.operator.mollify_factor,
        "proof": decomposition.proof(),
        **job.parameters,
    }
    meta = provenance(job.mesh, options)
    if job.kind == "eigenpairs":
        channel.report(Progress("writing", message=job.label))
        write_eigenpairs(job.path, decomposition, job.mesh, meta)
        return Written(job.path, f"{job.n_pairs} eigenpairs")
    values, parameters = decomposition.eigenvalues, job.parameters
    if job.kind == "hks":
        times = hks_times(
            values, parameters.get("t_min"), parameters.get("t_max"), parameters["n_scales"]
        )
        bank = heat_kernel_bank(times)
    else:
        low, high = parameters.get("e_min", 0.0), parameters.get("e_max", float(values[-1]))
        bank = bspline_bank(low, high, parameters["n_bands"])
    channel.report(Progress("features", message="Computing features"))
    features = compute_features(decomposition, bank, unit=job.mesh.unit)
    channel.report(Progress("writing", message=job.label))
    write_features(job.path, features, job.mesh, eigenvalues=values, meta=meta)
    return Written(job.path, f"{KINDS[job.kind]}, {bank.n_filters} columns,")

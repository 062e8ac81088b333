"""Report of the machine and its packages, as text for a bug report."""

from __future__ import annotations

from contextlib import suppress

from meshmash_viewer.errors import InputError
from meshmash_viewer.fields import FAMILIES  # noqa: F401  loads their plug-ins
from meshmash_viewer.io import read, writers  # noqa: F401
from meshmash_viewer.io.cache import EigenpairCache
from meshmash_viewer.model.failure import PACKAGES, package_version
from meshmash_viewer.plug_ins import known_plug_ins
from meshmash_viewer.spectral import cost

#: Packages listed besides those of `meshmash_viewer.model.failure`.
_MORE = ("robust_laplacian", "pymetis", "trimesh", "nibabel", "pyarrow", "pyvistaqt", "pyqtgraph")


def system_report(graphics: str) -> str:
    """Describe versions, memory, cores, the graphics driver and the store of eigenpairs."""
    import scooby

    cache = EigenpairCache()
    stores = len(cache.stores())
    kept = f"{cost.written_bytes(cache.size())} of {stores} decompositions in {cache.root}"
    versions = [(name, package_version(name)) for name in (*PACKAGES, *_MORE)]
    more = [("Graphics", graphics), ("Eigenpairs kept", kept), *versions]
    for each in known_plug_ins():
        with suppress(InputError):
            each.load()
        said = each.fault or f"{each.name} of {each.package}"
        more.append((f"Plug-in, {each.group}", said))
    report = scooby.Report(core=[], optional=[], ncol=1, text_width=100, extra_meta=more)
    return str(report).strip()

"""What can be written to a file, as the command line names it and as people do."""

from __future__ import annotations

__all__ = ["KINDS"]

KINDS = {
    "hks": "Heat kernel signature",
    "geometry-vectors": "Geometry vectors",
    "wks": "Wave kernel signature",
    "eigenpairs": "Eigenpairs",
}

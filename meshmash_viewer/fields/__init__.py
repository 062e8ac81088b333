"""Families of fields, one module each.

The table of families is imported on first use, because it loads plug-ins, which may import this
package.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshmash_viewer.fields.table import EXPORTS, FAMILIES, FEATURES

__all__ = ["EXPORTS", "FAMILIES", "FEATURES"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from meshmash_viewer.fields import table

    return getattr(table, name)

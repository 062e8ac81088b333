"""The compiled loops of fields, imported when they are first needed.

They bring the largest of all libraries along. And no more than once: where Qt watches imports, one
inside a function takes long at every call.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType

__all__ = ["field_kernels"]


@cache
def field_kernels() -> ModuleType:
    """The module `meshmash_viewer.model.field_kernels`."""
    from meshmash_viewer.model import field_kernels

    return field_kernels

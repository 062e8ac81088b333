"""The window. Everything in here may import Qt; only the render imports VTK."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshmash_viewer.app.run import run_app, view

__all__ = ["run_app", "view"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from meshmash_viewer.app import run

        return getattr(run, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""The compiler of the kernels, numba: nothing is computed without it, and it is asked for first."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from meshmash_viewer.errors import InputError

__all__ = ["check_compiler", "import_compiler"]

_REMEDY = "install it into this environment with: python -m pip install numba"


def check_compiler() -> None:
    """Look for the compiler without importing it, which takes a third of a second.

    Raises
    ------
    InputError
        If it is not installed.
    """
    if find_spec("numba") is None:
        raise InputError(f"numba, which compiles the eigensolver, is missing; {_REMEDY}")


def import_compiler() -> Any:
    """The module `numba`.

    Raises
    ------
    InputError
        If it is not installed, or does not work with what is installed beside it.
    """
    check_compiler()
    try:
        return import_module("numba")
    except ImportError as fault:
        raise InputError(
            f"numba, which compiles the eigensolver, does not work here ({fault}); {_REMEDY}"
        ) from fault

"""How much time and memory a mesh file may take, by its size."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from meshmash_viewer.errors import InputError

__all__ = ["RAISE_LIMITS", "LimitExceeded", "ReadLimits"]

#: The environment variable by whose value every limit is multiplied.
RAISE_LIMITS = "MESHMASH_READ_LIMITS"

_SECONDS, _SECONDS_PER_BYTE = 8.0, 5e-7
_BYTES, _BYTES_PER_BYTE = 640e6, 40.0
#: Text of the most regular meshes shrinks thirty-fold by gzip, binary files far less.
_HONEST_RATIO = 40.0
#: What unpacks to a few megabytes at most, or not by much, can do no harm.
_HARMLESS_BYTES, _HARMLESS_RATIO = 12e6, 8.0


class LimitExceeded(InputError):
    """A file that takes more than one of its size should; the sentence says how to go on."""

    def __init__(self, what: str) -> None:
        super().__init__(
            f"{what}, more than a sound file of its size should; if you trust it, set"
            f" {RAISE_LIMITS}=10 to allow ten times as much, or export it again."
        )


@dataclass(frozen=True)
class ReadLimits:
    """What the process that reads a file may take before it is stopped.

    Honest files take a twentieth of it. Both limits are multiplied by the number in the
    environment variable `RAISE_LIMITS`.

    Parameters
    ----------
    seconds : float
        Processor time, which does not depend on what else the machine is doing.
    memory : float
        Bytes in use at once, the interpreter and its libraries included.
    """

    seconds: float
    memory: float

    @classmethod
    def of(cls, n_bytes: int, unpacked: int = 0) -> ReadLimits:
        """Limits for a file of so many bytes.

        Parameters
        ----------
        n_bytes : int
            Of the file as it lies on the disk.
        unpacked : int, optional
            Of what it unpacks to, where it is compressed as a whole.

        Raises
        ------
        InputError
            If the environment variable holds no positive number.
        """
        honest = min(float(unpacked), _HONEST_RATIO * n_bytes)
        size = max(float(n_bytes), honest / 5.0)
        factor = _factor()
        return cls(
            factor * (_SECONDS + _SECONDS_PER_BYTE * size),
            factor * (_BYTES + _BYTES_PER_BYTE * size),
        )

    @staticmethod
    def are_needed(n_bytes: int, unpacked: float) -> bool:
        """Whether a file unpacks to so much that it had better be read under limits."""
        return unpacked > max(_HARMLESS_BYTES, _HARMLESS_RATIO * n_bytes)


def _factor() -> float:
    text = os.environ.get(RAISE_LIMITS, "1")
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not factor > 0.0:
        raise InputError(
            f"{RAISE_LIMITS} is {text!r}: give the number by which the limits of time and memory"
            " for reading a file are to be multiplied, or unset it."
        )
    return factor

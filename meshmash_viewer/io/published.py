"""The file of a store with all that is published about its rows, and a digest of its bytes.

The first line holds the digest of all bytes after it, which are a NumPy archive: the arrays, and as
JSON the rest with the key of the owner. The file is replaced atomically, never changed.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.atomic import written_whole
from meshmash_viewer.spectral.certificate import Certificate

_MAGIC = b"meshmash-viewer sha256 "
_FIRST_LINE = len(_MAGIC) + 64 + 1
#: Name of the JSON among the arrays.
_ABOUT = "about.json"
#: Attributes that are arrays.
_ARRAYS = ("eigenvalues", "residuals", "checksums", "mass")


class Damaged(ValueError):
    """A file differs from what was written."""


@dataclass(frozen=True, eq=False)
class Published:
    """What is published about the leading pairs in a store."""

    #: Shape (k,).
    eigenvalues: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    residuals: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    #: Shape (k,): CRC-32 of each row.
    checksums: npt.NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    #: Shape (n,).
    mass: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    #: Number of leading pairs of the last complete run; its certificate and timings follow.
    n_proven: int = 0
    certificate: Certificate = Certificate("none")  # noqa: RUF009 - frozen
    timings: dict[str, float] = field(default_factory=dict)
    #: The threshold of that run; 0 without one.
    known_to: float = 0.0

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def first(self, count: int) -> Published:
        """Return the part about the first pairs."""
        return replace(
            self,
            eigenvalues=self.eigenvalues[:count],
            residuals=self.residuals[:count],
            checksums=self.checksums[:count],
            n_proven=min(self.n_proven, count),
            known_to=self.known_to if self.n_proven <= count else 0.0,
        )

    def write(self, path: Path, key: str) -> None:
        """Write the file; `key` names the store that it belongs to."""
        about = {name: value for name, value in vars(self).items() if name not in _ARRAYS}
        about |= {"certificate": asdict(self.certificate), "key": key}
        text = json.dumps(about, allow_nan=False).encode()
        members: dict[str, Any] = {name: getattr(self, name) for name in _ARRAYS}
        with written_whole(path) as part, part.open("w+b") as file:
            file.write(bytes(_FIRST_LINE))
            np.savez(file, **members | {_ABOUT: np.array(text)})
            file.seek(_FIRST_LINE)
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            file.seek(0)
            file.write(_first_line(digest))

    @classmethod
    def read(cls, path: Path, key: str) -> Published:
        """Read the file.

        `Damaged` is raised if its bytes do not agree with the digest, or it has another owner;
        `OSError` if it cannot be read.
        """
        with path.open("rb") as file:
            first = file.read(_FIRST_LINE)
            if first != _first_line(hashlib.file_digest(file, "sha256").hexdigest()):
                raise Damaged(f"{path.name} does not agree with its checksum")
            file.seek(_FIRST_LINE)
            with np.load(file) as archive:
                content = dict(archive)
        about = json.loads(content.pop(_ABOUT).item())
        if about.pop("key") != key:
            raise Damaged(f"{path.name} belongs to another mesh")
        about["certificate"] = Certificate(**about["certificate"])
        return cls(**content, **about)


def _first_line(digest: str) -> bytes:
    return _MAGIC + digest.encode() + b"\n"

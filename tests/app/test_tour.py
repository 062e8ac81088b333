"""Ten stops of the tour of the window, compared with small stored pictures.

To renew these after an intended change: ``./dev shots DIR``, look at the pictures, then
``.venv/bin/python tests/app/test_tour.py DIR``.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

pytestmark = pytest.mark.pixels

ROOT = Path(__file__).resolve().parents[2]
BASELINES = Path(__file__).parent / "tour"
STOPS = [
    "01-empty", "02-mesh", "05-eigenfunction", "06-hks", "07-bands", "08-pins-and-profiles",
    "09-similar", "10-curvature", "11-distance", "12-filter",
]  # fmt: skip
#: A third of the window's width and height distinguishes panels, colour maps and meshes, and
#: tolerates differences between machines: edges, paths, seconds.
SIZE = (480, 300)
#: Tolerated difference of a channel (of 255), and share of pixels that may exceed it.
#: Runs on one machine, from two folders, differ in at most 0.014 %; cividis instead of viridis
#: in 0.9 to 1.3 %, a render without its colour bar in 0.24 %.
LEVEL, SHARE = 48, 0.001


def small(path: Path) -> npt.NDArray[np.int16]:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB").resize(SIZE, Image.Resampling.BOX), np.int16)


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tour")
    tour = [sys.executable, ROOT / "assets" / "tour.py", folder, "--stops", "12"]
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    environment = {**os.environ, **one, "PYTHONPATH": str(ROOT)}
    subprocess.run(tour, check=True, env=environment, timeout=300)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("stop", STOPS)
def test_a_stop_looks_as_it_did(stop: str, shots: Path) -> None:
    now, before = small(shots / f"{stop}.png"), small(BASELINES / f"{stop}.webp")
    differs = np.abs(now - before).max(axis=2)
    share = (differs > LEVEL).mean()
    if share > SHARE:
        seen = np.repeat(255 - differs[..., None], 3, axis=2)
        beside = np.concatenate([before, now, seen], axis=1).astype(np.uint8)
        file = shots / f"{stop}-before-now-difference.png"
        Image.fromarray(beside).save(file)
        pytest.fail(f"{share:.1%} of the picture differ, see {file}")


if __name__ == "__main__":
    BASELINES.mkdir(exist_ok=True)
    for stop in STOPS:
        pixels = small(Path(sys.argv[1]) / f"{stop}.png").astype(np.uint8)
        Image.fromarray(pixels).save(BASELINES / f"{stop}.webp", lossless=True)

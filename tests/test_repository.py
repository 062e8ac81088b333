"""Nothing in the repository depends on the machine it was written on."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def text_files() -> list[Path]:
    """Files under version control, or, without git, what is not made by tools."""
    try:
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True
        ).stdout.split("\0")
        paths = [ROOT / name for name in listed if name]
    except (OSError, subprocess.CalledProcessError):
        made = {".venv", ".git", "build", "dist", "shots", "__pycache__"}
        paths = [path for path in ROOT.rglob("*") if not made & set(path.parts)]
    texts = []
    for path in paths:
        if path.is_file():
            content = path.read_bytes()
            if b"\0" not in content[:8192]:
                texts.append(path)
    return texts


@pytest.mark.parametrize(
    ("what", "pattern"),
    [
        ("a path of somebody's machine", r"(?<![\w.])/(?:home|Users|work|root|mnt)/[\w.]"),
        ("a drive of somebody's machine", r"\b[A-Z]:\\\\?(?:Users|work)"),
        ("a temporary folder", r"(?<![\w.}])/tmp/\w"),
        (
            "a package index",
            r"--(?:extra-)?index-url|--find-links|--trusted-host|files\.pythonhosted",
        ),
        ("an address of a package", r"^[\w.-]+\s*@\s*\w+://"),
    ],
)
def test_no_file_names(what: str, pattern: str) -> None:
    found = []
    for path in text_files():
        if path == Path(__file__).resolve():
            continue
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
            if re.search(pattern, line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not found, f"{what}: " + "; ".join(found)


def test_constraints_are_names_and_versions() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    for line in lines:
        assert line.startswith("#") or re.fullmatch(r"[\w.-]+==[\w.]+", line), line


def test_the_samples_are_small() -> None:
    samples = list((ROOT / "meshmash_viewer" / "samples").glob("*.npz"))
    assert samples
    assert sum(path.stat().st_size for path in samples) < 1.5e6


def test_the_page_on_the_architecture_names_files_that_exist() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_/]+(?:\.py|/))`", page)) - {"meshmash_viewer/"}
    assert len(named) > 40
    package = ROOT / "meshmash_viewer"
    missing = {
        name for name in named if not any((place / name).exists() for place in (package, ROOT))
    }
    assert not missing

"""The folder of stored eigenpairs, which `MESHMASH_CACHE` sets on every operating system."""

from __future__ import annotations

from pathlib import Path

import platformdirs
import platformdirs.macos
import platformdirs.unix
import platformdirs.windows
import pytest

from meshmash_viewer.io.cache import EigenpairCache, default_cache_folder
from meshmash_viewer.model.notices import report_defect

SYSTEMS = {
    "Linux": platformdirs.unix.Unix,
    "macOS": platformdirs.macos.MacOS,
    "Windows": platformdirs.windows.Windows,
}


@pytest.fixture(params=SYSTEMS)
def system(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Emulate an operating system for a user whose files are in `tmp_path`; return its name."""
    system = SYSTEMS[request.param]
    by_variables = platformdirs.windows.get_win_folder_from_env_vars  # avoids the registry
    monkeypatch.setattr(platformdirs.windows, "get_win_folder", by_variables)
    for name in ("HOME", "USERPROFILE", "LOCALAPPDATA", "APPDATA"):
        monkeypatch.setenv(name, str(tmp_path / "user"))
    monkeypatch.setattr(
        platformdirs, "user_cache_dir", lambda *a, **k: system(*a, **k).user_cache_dir
    )
    return str(request.param)


def test_the_variable_moves_it_everywhere(
    system: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MESHMASH_CACHE", str(tmp_path / "mine"))
    assert default_cache_folder() == tmp_path / "mine" / "eigenpairs"
    assert EigenpairCache().root == tmp_path / "mine" / "eigenpairs"


@pytest.mark.parametrize("empty", [None, "", "  "])
def test_without_it_the_system_says_where(
    system: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, empty: str | None
) -> None:
    monkeypatch.delenv("MESHMASH_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    if empty is not None:
        monkeypatch.setenv("MESHMASH_CACHE", empty)
    folder = default_cache_folder()
    assert folder.name == "eigenpairs"
    assert folder.is_absolute()
    assert "meshmash-viewer" in folder.parts
    # Windows ignores XDG_CACHE_HOME, so the program needs its own variable
    assert folder.is_relative_to(tmp_path / ("user" if system == "Windows" else ""))
    assert folder.is_relative_to(tmp_path / "xdg") <= (system != "Windows")


@pytest.mark.parametrize(
    ("given", "place"),
    [("~/pairs", "user/pairs"), ("here/below", "here/below"), (" spaced ", "spaced")],
)
def test_a_home_and_a_relative_folder_are_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str, place: str
) -> None:
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path / "user"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MESHMASH_CACHE", given)
    assert default_cache_folder() == tmp_path / place / "eigenpairs"


def test_the_log_of_defects_goes_along(own_cache: Path) -> None:
    assert str(own_cache / "log") in report_defect(KeyError("lost"))
    assert len(list((own_cache / "log").glob("defect-*.txt"))) == 1

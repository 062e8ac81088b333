"""Files locked for a moment by other programs, such as virus scanners on Windows."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from faults import raises

from meshmash_viewer.io import atomic
from meshmash_viewer.io.atomic import discard, persistently, writing_errors, written_together
from meshmash_viewer.io.store import EigenpairStore
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.weyl import Target

FOREVER = 10**9


class Refusing:
    """A system function whose first `times` calls fail, for file names that begin with `only`."""

    def __init__(self, function: Callable[..., Any], times: int, only: str = "") -> None:
        self.function, self.times, self.only = function, times, only
        self.refused = 0

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        of_it = Path(str(arguments[0])).name.startswith(self.only)
        if of_it and self.refused < self.times:
            self.refused += 1
            raise PermissionError(errno.EACCES, "Access is denied", str(arguments[0]))
        return self.function(*arguments, **options)


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> float:
    monkeypatch.setattr(atomic, "_PATIENCE", 0.2)
    monkeypatch.setattr(atomic, "_PAUSE", 0.01)
    return 0.2


def refuse(
    monkeypatch: pytest.MonkeyPatch, place: Any, name: str, times: int, only: str = ""
) -> Refusing:
    refusing = Refusing(getattr(place, name), times, only)
    # a function is bound to the path as a method, unlike a `Refusing` object
    monkeypatch.setattr(place, name, lambda *a, **k: refusing(*a, **k))
    return refusing


@pytest.mark.parametrize("times", [0, 1, 2, 5])
@pytest.mark.parametrize("n_files", [1, 2])
def test_a_file_takes_its_place_though_it_is_refused_a_few_times(
    times: int, n_files: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusing = refuse(monkeypatch, os, "replace", times)
    paths = [tmp_path / f"{at}.txt" for at in range(n_files)]
    with written_together(*paths) as parts:
        for part in parts:
            part.write_text("whole", encoding="ascii")
    assert [path.read_text("ascii") for path in paths] == ["whole"] * n_files
    assert refusing.refused == times
    assert len(list(tmp_path.iterdir())) == n_files


def test_one_that_is_refused_to_the_end_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, patience: float
) -> None:
    path = tmp_path / "out.txt"
    path.write_text("before", encoding="ascii")
    refuse(monkeypatch, os, "replace", FOREVER)
    began = time.monotonic()
    with (
        raises("not-writable"),
        writing_errors(path),
        written_together(path) as (part,),
    ):
        part.write_text("after", encoding="ascii")
    assert time.monotonic() - began >= patience
    assert path.read_text("ascii") == "before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("fault", [OSError(errno.ENOSPC, "full"), FileNotFoundError("gone")])
def test_other_errors_are_not_waited_for(fault: OSError, patience: float) -> None:
    calls: list[int] = []

    def act() -> None:
        calls.append(1)
        raise fault

    with pytest.raises(type(fault)):
        persistently(act)
    assert len(calls) == 1


@pytest.mark.parametrize("times", [0, 1, 2, FOREVER])
@pytest.mark.parametrize("body_fails", [False, True])
def test_a_part_that_stays_ends_nothing(
    times: int, body_fails: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "out.txt"
    refuse(monkeypatch, Path, "unlink", times)
    if body_fails:
        with pytest.raises(KeyError, match="mine"), written_together(path) as (part,):
            raise KeyError(part.write_text("half", encoding="ascii"), "mine")
        assert not path.exists()
        # after this process has ended, the next process that writes here deletes the file
        assert len(list(tmp_path.iterdir())) == (times == FOREVER)
    else:
        with written_together(path) as (part,):
            part.write_text("whole", encoding="ascii")
        assert path.read_text("ascii") == "whole"


@pytest.mark.parametrize("times", [0, 1])
def test_a_blocked_file_that_may_stay_is_not_waited_for(
    times: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [tmp_path / name for name in "abcdef"]
    for path in paths[:-1]:  # the last file does not exist
        path.touch()
    refusing = refuse(monkeypatch, Path, "unlink", times * FOREVER, only="c")
    discard(*paths)
    assert refusing.refused == times, "no retry"
    assert [path.name for path in tmp_path.iterdir()] == ["c"] * times


# Identities -----------------------------------------------------------------------------------


def test_a_store_is_known_by_handles_alone(
    sphere: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On Windows, `st_dev` differs between a handle and its path, so only handles are compared."""
    by_path = os.stat

    def other_device(*arguments: Any, **options: Any) -> os.stat_result:
        status = by_path(*arguments, **options)
        if isinstance(arguments[0], int):
            return status
        return os.stat_result((*status[:2], status.st_dev + 1, *status[3:]))

    monkeypatch.setattr(os, "stat", other_device)
    with EigenpairStore(sphere, OperatorOptions(), Target("count", 12), tmp_path) as store:
        pairs = solve(
            *cotangent_laplacian(sphere, robust=True),
            12,
            allocate=store.allocate,
            on_pairs=store.append,
        )
        store.append(pairs)
    store = EigenpairStore(sphere, OperatorOptions(), Target("count", 12), tmp_path)
    assert store.is_complete
    store.allocate(20)
    (store.folder / "eigenvectors.f64").rename(tmp_path / "elsewhere")
    (store.folder / "eigenvectors.f64").write_bytes(bytes(8 * 20 * 642))
    with raises("not-writable"):
        store.append(replace(pairs.first(2), certificate=Certificate("none")))
    store.close()

"""Broken files of all formats, each of which must give a mesh or one sentence."""

from __future__ import annotations

import random
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.read import read_mesh

if sys.platform != "linux":
    pytest.skip("needs the processes of Linux", allow_module_level=True)

from tests.fuzz import trials
from tests.fuzz.mutators import MUTATORS, Mutator
from tests.fuzz.seeds import sound_files


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture
def fresh(folder: Path) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of one new process, whose memory has no data of other tests."""
    with ProcessPoolExecutor(
        1, get_context("spawn"), initializer=_scratch_in, initargs=(folder,)
    ) as pool:
        yield pool


def _scratch_in(folder: Path) -> None:
    tempfile.tempdir = str(folder)


def _numbers_of_faces(folder: Path) -> dict[str, int | str]:
    found: dict[str, int | str] = {}
    with trials.forking():
        for kind, seeds in sound_files().items():
            for name, content in seeds:
                (folder / name).write_bytes(content)
                try:
                    found[f"{kind} {name}"] = read_mesh(folder / name).n_faces
                except InputError as told:
                    found[f"{kind} {name}"] = str(told)
    return found


def _trials(numbers: list[int], folder: Path) -> list[trials.Trial]:
    with trials.forking():
        return [trials.try_input(number, folder) for number in numbers]


@pytest.mark.slow
def test_the_seeds_are_sound(fresh: ProcessPoolExecutor, folder: Path) -> None:
    found = fresh.submit(_numbers_of_faces, folder).result()
    surface = found.pop("freesurfer lh.sphere")  # values per vertex, no surface
    assert isinstance(surface, str)
    assert "one number per vertex" in surface
    assert [name for name, faces in found.items() if isinstance(faces, str) or faces < 2] == []


@pytest.mark.slow
def test_broken_files_give_a_mesh_or_one_sentence(fresh: ProcessPoolExecutor, folder: Path) -> None:
    tried = fresh.submit(_trials, list(range(250)), folder).result()
    assert not [trial for trial in tried if trial.fault]
    assert {trial.kind for trial in tried} == set(sound_files())
    read = sum(not trial.sentence for trial in tried)
    assert 0 < read < len(tried)
    assert not list(folder.iterdir()), "nothing is left"


@pytest.mark.slow
def test_small_files_that_ask_for_much(fresh: ProcessPoolExecutor, folder: Path) -> None:
    # Huge packed arrays, a stray coordinate, a chain of nodes, and empty lists.
    tried = fresh.submit(_trials, [999, 2999, 5999, 7999], folder).result()
    assert not [trial for trial in tried if trial.fault]


def test_an_input_is_the_same_every_time() -> None:
    assert [trials.input_of(number) for number in range(40)] == [
        trials.input_of(number) for number in range(40)
    ]


@pytest.mark.parametrize("mutator", sorted(set(MUTATORS), key=lambda each: each.__name__))
def test_mutators_break_something(mutator: Mutator) -> None:
    _, content = sound_files()["obj"][0]
    outcomes = {mutator(random.Random(seed), content) for seed in range(20)}
    assert len(outcomes) > 10


def test_a_fault_is_noticed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(path: Path) -> None:
        raise KeyError("vertices")

    def says_two_lines(path: Path) -> None:
        raise InputError(f"{path} holds\ntwo lines.")

    for reader, fault in ((fails, "KeyError"), (says_two_lines, "not one sentence")):
        monkeypatch.setattr(trials, "read_mesh", reader)
        assert fault in trials.try_input(1, folder).fault

"""Limits of the number of columns: by a maximum, and by the free memory, before any computation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from commands import refused
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.cli.parser import COMMANDS, parsed_command
from meshmash_viewer.features.filter_responses import MOST_FILTERS, hks_times
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.fields.sihks import invariant_columns
from meshmash_viewer.spectral import cost

BALL = shapes.icosphere(3)
EIGENVALUES = np.arange(50.0)
MANY = 10**9
#: Functions of a number of columns.
FUNCTIONS: dict[str, Callable[[int], Any]] = {
    "hks_times": lambda count: hks_times(EIGENVALUES, n_scales=count),
    "get_hks_filter": lambda count: mv.get_hks_filter(2.0, 1.0, count),
    "wave_kernel_bank": lambda count: mv.wave_kernel_bank(EIGENVALUES, count),
    "bspline_bank": lambda count: mv.bspline_bank(0.0, 1.0, count),
    "construct_bspline_basis": lambda count: mv.construct_bspline_basis(0.0, 1.0, count),
    "construct_bspline_filter": lambda count: mv.construct_bspline_filter(0.0, 1.0, count),
    "compute_hks": lambda count: mv.compute_hks(BALL, 40.0, n_components=count),
    "compute_geometry_vectors": lambda count: mv.compute_geometry_vectors(
        BALL, 40.0, n_components=count
    ),
    "ClassColumns": lambda count: mv.ClassColumns(0.1, 1.0, 20.0, n_times=count),
    "n_lengths": lambda count: mv.ClassColumns(0.1, 1.0, 20.0, n_lengths=count),
    "invariant_columns": lambda count: invariant_columns(EIGENVALUES, np.ones((50, 9)), count),
    "condensed_hks_pipeline": lambda count: mv.condensed_hks_pipeline(BALL, n_components=count),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_billion_columns_are_refused_at_once(name: str) -> None:
    with pytest.raises(mv.InputError) as refused:
        FUNCTIONS[name](MANY)
    assert refused.value.code in ("out-of-range", "out-of-memory")


@pytest.mark.parametrize("bank", [mv.heat_kernel_bank, mv.gaussian_pyramid_bank])
def test_a_list_of_parameters_has_the_same_limit(bank: Callable[..., Any]) -> None:
    with raises("too-many", "100,001 columns: give at most 100,000"):
        bank(np.geomspace(1.0, 2.0, MOST_FILTERS + 1))
    with raises("too-many", "each value of t would be 100,001 columns"):
        mv.formula_bank("exp(-t*x)", t=np.geomspace(1.0, 2.0, MOST_FILTERS + 1))


@pytest.fixture
def little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let 5 MB of memory be free, and computation of eigenpairs fail."""
    monkeypatch.setattr(cost, "free_memory", lambda: 5_000_000)

    def solved(*_: object, **__: object) -> None:
        raise AssertionError("eigenpairs are computed before the check")

    for place in (
        "cli.features.solved",
        "cli.classes.solved",
        "features.descriptors.solve_and_warn",
    ):
        monkeypatch.setattr(f"meshmash_viewer.{place}", solved)


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize("call", [mv.compute_hks, mv.compute_geometry_vectors])
def test_columns_larger_than_the_memory_are_refused(call: Callable[..., Any]) -> None:
    with raises("out-of-memory"):
        call(BALL, 40.0, n_components=500)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.savez("ball.npz", vertices=BALL.vertices, faces=BALL.faces)
    np.savetxt("labels.csv", BALL.vertices[:, 0] > 0.0, fmt="%d", header="part", comments="")
    Path("points.csv").write_text("x,y,z\n0,0,1\n", "ascii")


@pytest.mark.usefixtures("here", "little_memory")
@pytest.mark.parametrize(
    "command",
    [
        *(
            f"features ball.npz -o out.npz --kind {kind}"
            for kind, family in EXPORTS.items()
            if family.counted and kind != "eigenpairs"
        ),
        "features ball.npz -o out.npz --kind hks --pieces 4",
        "points ball.npz --points points.csv -o out.csv --kind hks",
        "train ball.npz --labels labels.csv -o out.skops",
    ],
)
def test_commands_check_the_memory_before_they_compute(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = "500 columns of 642 vertices take about 5.14 MB of memory, and 5 MB are free"
    refused(capsys, said, *command.split(), "--n-components", 500)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_number_of_columns_has_a_maximum(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        parsed_command([command, "a.ply", "--n-components", "1e9"])
    said = capsys.readouterr().err
    limited = "the value is a whole number from 1 to 100,000, not 1e9" in said
    assert limited == (command not in ("info", "regions", "carry", "predict", "reconstruct"))

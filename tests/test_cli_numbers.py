"""Numbers on the command line, read as in the window and converted to the unit of each mesh."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
import shapes

from meshmash_viewer.cli import main as cli
from meshmash_viewer.cli.arguments import in_unit
from meshmash_viewer.cli.parser import parsed_command


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    mesh = shapes.icosphere(2, radius=500.0)
    np.savez(tmp_path / "ball.npz", vertices=mesh.vertices, faces=mesh.faces)
    return tmp_path / "ball.npz"


def features(ball: Path, *options: str) -> tuple[list[str], np.ndarray]:
    """Return names of columns and eigenvalues."""
    out = ball.with_name("out.npz")
    out.unlink(missing_ok=True)
    assert cli.main(["features", str(ball), "-o", str(out), *options]) == 0
    with np.load(out) as file:
        return file["columns"].tolist(), file["eigenvalues"]


def test_the_unit_is_that_of_each_mesh(ball: Path) -> None:
    """Options with units are converted to the unit of the mesh, here nm and µm for one file."""
    nm = features(ball, "--unit", "nm", "--wavelength", "500 nm", "--t-max", "1,0 um^2")
    um = features(ball, "--unit", "um", "--wavelength", "500 µm", "--t-max", "1e12 nm^2")
    np.testing.assert_allclose(nm[1], um[1], rtol=1e-12)
    assert um[0][-1] == "hks_t=1.00e+06"
    kind = ["--kind", "filter", "--formula", "x < c", "--count", "20", "--n-components", "3"]
    ends = features(ball, "--unit", "nm", *kind, "--set", "c=10um^-2:100um^-2")
    assert ends[0] == features(ball, *kind, "--set", "c=1e-5:1e-4")[0]


@pytest.mark.parametrize("low", ["-1e-4", "-,0001", "\u22121×10^-4"])
def test_a_negative_number_is_no_option(low: str) -> None:
    options = ["render", "ball.npz", "-o", "a.png", "--limits"]
    assert parsed_command([*options, low, "1e-4"]).limits == (-1e-4, 1e-4)


#: By option: the command, its expected value, and ways to write it, as arguments of a shell.
SEVERAL = [
    (
        "--voxel", "points ball.npz --points p.csv -o a.csv", ((4.0, 4.0, 40.0), "nm"),
        ("4x4x40nm", "4 4 40 nm", "4nm 4nm 40nm", "4, 4, 40 nm"),
    ),
    ("--limits", "render ball.npz -o a.png", (-1.0, 2.5), ("-1 2.5", "'-1; 2,5'")),
    ("--size", "render ball.npz -o a.png", (1600, 1200), ("1600x1200", "1600 1200")),
    ("--unit", "info ball.npz", "4 4 40 nm", ("4 4 40 nm", "'4 4 40 nm'")),
]  # fmt: skip


@pytest.mark.parametrize(("option", "command", "expected", "ways"), SEVERAL)
def test_ways_to_write_several_numbers(
    option: str, command: str, expected: object, ways: tuple[str, ...]
) -> None:
    name, mesh, *rest = command.split()
    for way in ways:
        for given in ([mesh, *rest, option, *shlex.split(way)], [option, *shlex.split(way), mesh]):
            parsed = parsed_command([name, *given, *(rest if given[-1] == mesh else [])])
            assert getattr(parsed, option.removeprefix("--")) == expected, way
            assert parsed.mesh == [Path(mesh)], way


def test_a_position_is_in_the_unit_of_each_mesh() -> None:
    for way in ("1 2 -3 µm", "1000 2000 -3000"):
        parsed = parsed_command(["condense", "a.ply", "-o", "b/", "--nucleus", *way.split()])
        assert in_unit(parsed, "nm").nuc_point == (1000.0, 2000.0, -3000.0), way


@pytest.mark.parametrize(
    "options",
    [
        "points ball.npz --points p.csv -o a.csv --voxel 4 4",
        "points ball.npz --points p.csv -o a.csv --voxel 1,234,567",
        "condense ball.npz -o a/ --nucleus 1,234 2 3",
        "render ball.npz -o a.png --size 0x5",
        "features ball.npz -o a.npz --t-max 1,000",
        "features ball.npz -o a.npz --t-max 20um",
        "features ball.npz -o a.npz --count 1.000",
        "features ball.npz -o a.npz --wavelength -5",
        "features ball.npz -o a.npz --mollify-factor -1",
    ],
)
def test_numbers_that_cannot_be_read_are_one_sentence(
    options: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parsed_command(shlex.split(options))
    assert ended.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1

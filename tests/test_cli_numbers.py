"""Numbers on the command line, read as in the window and converted to the unit of each mesh."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
import shapes
from tiers import slow, slow_but

from meshmash_viewer.cli import main as cli
from meshmash_viewer.cli.arguments import in_unit
from meshmash_viewer.cli.parser import parsed_command

RADIUS = 500.0  # nm


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    mesh = shapes.icosphere(2, radius=RADIUS)
    np.savez(tmp_path / "ball.npz", vertices=mesh.vertices, faces=mesh.faces)
    return tmp_path / "ball.npz"


def features(ball: Path, *options: str) -> tuple[int, list[str], np.ndarray]:
    """Return status, names of columns and eigenvalues."""
    out = ball.with_name("out.npz")
    out.unlink(missing_ok=True)
    status = cli.main(["features", str(ball), "-o", str(out), *options])
    if status:
        return status, [], np.empty(0)
    with np.load(out) as file:
        return 0, file["columns"].tolist(), file["eigenvalues"]


@pytest.mark.parametrize(
    ("option", "plain", "others"),
    [
        (
            "--t-max",
            "2e6",
            ("2um^2", "2 µm²", "2 μm^2", "2,0 um2", "2×10⁶", "2 000 000", "2e6nm^2"),
        ),
        ("--t-min", "5e4", ("0.05um^2", "0,05 µm²", "50'000", "50_000", "5e-14 m^2")),
        ("--count", "30", ("30.0", "3e1", "+30")),
        slow("--wavelength", "600", ("0.6um", "0,6 µm", "600 nm", "6e-4mm")),
        slow("--max-eigenvalue", "8e-5", ("80/um^2", "80 µm⁻²", "8e-5 nm^-2", "80 1/µm²")),
        slow("--n-components", "4", ("4.0", "+4")),
    ],
)
def test_ways_to_write_one_option(
    ball: Path, option: str, plain: str, others: tuple[str, ...]
) -> None:
    expected = features(ball, "--unit", "nm", option, plain)
    assert expected[0] == 0
    for text in others:
        status, columns, values = features(ball, "--unit", "nm", option, text)
        assert status == 0, text
        assert columns == expected[1], text
        np.testing.assert_array_equal(values, expected[2])


def test_the_unit_is_that_of_each_mesh(ball: Path) -> None:
    """Options with units are converted to the unit of the mesh, here nm and µm for one file."""
    nm = features(ball, "--unit", "nm", "--wavelength", "500 nm", "--t-max", "1e6")
    um = features(ball, "--unit", "um", "--wavelength", "500 µm", "--t-max", "1e12 nm^2")
    np.testing.assert_allclose(nm[2], um[2], rtol=1e-12)
    assert um[1][-1] == "hks_t=1.00e+06"
    ends = ["--set", "c=10/um^2:100/um^2", "--n-components", "3"]
    kind = ["--kind", "filter", "--formula", "x < c", "--count", "20"]
    bare = ["--set", "c=1e-5:1e-4", "--n-components", "3"]
    assert features(ball, "--unit", "nm", *kind, *ends)[1] == features(ball, *kind, *bare)[1]


@pytest.mark.parametrize("low", ["-1e-4", "-0,0001", "-.0001", "\u22121e-4", "-1×10^-4"])
def test_a_negative_number_is_no_option(low: str) -> None:
    options = ["render", "ball.npz", "-o", "a.png", "--limits"]
    assert parsed_command([*options, low, "1e-4"]).limits == (-1e-4, 1e-4)


#: By option: the command, its expected value, and ways to write it, as arguments of a shell.
SEVERAL = [
    (
        "--voxel", "points ball.npz --points p.csv -o a.csv", ((4.0, 4.0, 40.0), ""),
        ("4 4 40", "4,4,40", "4, 4, 40", "4x4x40", "4 x 4 x 40", "'4 × 4 × 40'", "'[4, 4, 40]'",
         "[4, 4, 40]", "(4,4,40)", "'[4 4 40]'", "'[ 4.  4. 40.]'", "4;4;40", "4,0 4,0 40,0"),
    ),
    (
        "--voxel", "points ball.npz --points p.csv -o a.csv", ((4.0, 4.0, 40.0), "nm"),
        ("'4x4x40 nm'", "4x4x40 nm", "4x4x40nm", "4 4 40 nm", "4nm 4nm 40nm", "'[4, 4, 40] nm'",
         "'[4, 4, 40 nm]'", "[4, 4, 40] nm"),
    ),
    (
        "--voxel", "points ball.npz --points p.csv -o a.csv", ((0.004, 0.004, 0.04), "µm"),
        ("0.004 0.004 0.04 µm", "'0,004 x 0,004 x 0,04 um'", "0.004,0.004,0.04 μm"),
    ),
    ("--voxel", "points ball.npz --points p.csv -o a.csv", ((8.0, 8.0, 8.0), "nm"), ("8 nm",)),
    (
        "--limits", "render ball.npz -o a.png", (-1.0, 2.5),
        ("-1 2.5", "-1,2.5", "'[-1, 2.5]'", "-1:2.5", "=-1,2.5", "'-1; 2,5'", "'-1.0 2.50'"),
    ),
    (
        "--size", "render ball.npz -o a.png", (1600, 1200),
        ("1600x1200", "1600 1200", "1600,1200", "'1600 × 1200'", "1600 X 1200", "(1600, 1200)"),
    ),
    (
        "--unit", "info ball.npz", "4 4 40 nm", ("4 4 40 nm", "'4 4 40 nm'"),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("option", "command", "expected", "ways"), SEVERAL)
@pytest.mark.parametrize("last", slow_but([True], [False, True]))
def test_ways_to_write_several_numbers(
    option: str, command: str, expected: object, ways: tuple[str, ...], last: bool
) -> None:
    name, mesh, *rest = command.split()
    for way in ways:
        given = shlex.split(f"{option}{'' if way.startswith('=') else ' '}{way}")
        options = [*given, mesh, *rest] if last else [mesh, *rest, *given]
        parsed = parsed_command([name, *options])
        assert getattr(parsed, option.removeprefix("--")) == expected, way
        assert parsed.mesh == [Path(mesh)], way


def test_a_position_is_in_the_unit_of_each_mesh() -> None:
    for way in ("1 2 -3 µm", "1,2,-3 µm", "(1, 2, -3) um", "1000 2000 -3000", "1 µm 2 µm -3 µm"):
        parsed = parsed_command(["condense", "a.ply", "-o", "b/", "--nucleus", *way.split()])
        assert in_unit(parsed, "nm").nuc_point == (1000.0, 2000.0, -3000.0), way


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("points ball.npz --points p.csv -o a.csv --voxel 4 4", "write them like"),
        ("points ball.npz --points p.csv -o a.csv --voxel 4x4x40x2", "write them like"),
        ("points ball.npz --points p.csv -o a.csv --voxel '4 4 40 kg'", "kg is in a unit that is"),
        ("points ball.npz --points p.csv -o a.csv --voxel 4 4 0", '"4 x 4 x 40 nm"'),
        ("points ball.npz --points p.csv -o a.csv --voxel 1,234,567", "1 × 234 × 567"),
        ("condense ball.npz -o a/ --nucleus 1 2", "4200 1800 350"),
        ("condense ball.npz -o a/ --nucleus 1,234 2 3", "1,234 may be 1234 or 1.234"),
        ("render ball.npz -o a.png --limits 3", "write them like -1 1"),
        ("render ball.npz -o a.png --limits low high", "write them like -1 1"),
        ("render ball.npz -o a.png --size 1600", "write them like 1600x1200"),
        ("render ball.npz -o a.png --size 0x5", "a whole number from 1 to 16,384, not 0"),
        ("render ball.npz -o a.png --size 1e9x5", "a whole number from 1 to 16,384"),
        ("info ball.npz --unit 4 4 40", '"4 x 4 x 40 nm"'),
    ],
)
def test_several_numbers_that_cannot_be_read_are_one_sentence(
    options: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        parsed_command(shlex.split(options))
    said = capsys.readouterr().err
    assert says in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--t-max 1,000", "--t-max: 1,000 may be 1000 or 1.0"),
        ("--wavelength 18,800", "18,800 may be 18800 or 18.8"),
        ("--t-max 20um", "20um is a length: write it in µm²"),
        ("--max-eigenvalue 5um^2", "5um^2 is an area: write it in µm⁻²"),
        ("--t-max 5s", "5s is in a unit that is not known"),
        ("--t-max abc", "abc is not a number"),
        ("--t-max nan", "nan is not a number"),
        ("--count 12.5", "a whole number from 1 to 2,147,483,647, not 12.5; or auto"),
        ("--count 0", "a whole number from 1"),
        ("--count 1.000", "1.000 may be 1000 or 1.0"),
        ("--jobs 2,5", "a whole number from 1"),
        ("--wavelength -5", "give a positive number"),
        ("--unit nm --wavelength 0um", "give a positive number"),
        ("--kind distance --vertex 1.5", "a whole number from 0"),
        ("--kind distance --vertex -1", "a whole number from 0"),
        ("--t-max 20um^2", "20um^2 has a unit, and the mesh has none"),
        ("--unit nm --t-min 10um^2 --t-max 1um^2", "t_min (1e+07) is above t_max (1e+06)"),
        ("--kind filter --formula x<c --set c=5um", "5um is a length: write it in µm⁻²"),
        ("--kind filter --formula x<c --set c=1,500", "may be 1500 or 1.5"),
        ("--mollify-factor -1", "negative"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(
    ball: Path, capsys: pytest.CaptureFixture[str], options: str, says: str
) -> None:
    try:
        status = features(ball, *options.split())[0]
    except SystemExit as ended:
        status = ended.code
    said = capsys.readouterr().err
    assert status == 2
    assert says in said
    assert len(said.splitlines()) == 1

"""OFF files with common variants of headers, counts and rows."""

from __future__ import annotations

from pathlib import Path

import pytest
from faults import raises

from meshmash_viewer.io.read import read_mesh

POINTS = ["0 0 0", "2 0 0", "2 1 0", "0 1 0", "1 3 0"]
FACES = ["3 0 1 2", "4 0 2 4 3"]  # areas 1 and 3
BODY = "\n".join([*POINTS, *FACES]) + "\n"


def rows(more: str = "", *, faces: list[str] | None = None, points: str = "") -> str:
    """Return the body with `points` appended to each vertex line and `more` to each face line."""
    many = [f"{point} {points}" for point in POINTS]
    return "\n".join([*many, *(f"{face} {more}" for face in faces or FACES)]) + "\n"


FILES = {
    "plain": "OFF\n5 2 0\n" + BODY,
    "counts in the word": "OFF5 2 0\n" + BODY,
    "counts on its line": "OFF 5 2 0\n" + BODY,
    "no number of edges": "OFF\n5 2\n" + BODY,
    "no number of edges, in the word": "OFF5 2\n" + BODY,
    "counts on three lines": "OFF\n5\n2\n0\n" + BODY,
    "small letters": "off\n5 2 0\n" + BODY,
    "comments first": "# made\n# by hand\nOFF\n5 2 0\n" + BODY,
    "empty lines first": "\n \nOFF\n5 2 0\n" + BODY,
    "comments in the header": "OFF # a mesh\n# counts\n\n5 2 0 # that is all\n# rows\n" + BODY,
    "long comments first": "# " + 20_000 * "x" + "\nOFF\n5 2 0\n" + BODY,
    "comments between rows": "OFF\n5 2 0\n" + BODY.replace("\n", " # a row\n\n"),
    "a comment that holds the word": "# OFF 9 9 9\nOFF5 2 0\n" + BODY,
    "two line ends": ("OFF\n5 2 0\n" + BODY).replace("\n", "\r\n"),
    "old line ends": ("# made\nOFF\n5 2 0\n" + BODY).replace("\n", "\r"),
    "tabs": "OFF\n5\t2\t0\n" + BODY.replace(" ", "\t"),
    "no last line end": "OFF\n5 2 0\n" + BODY.rstrip(),
    "COFF": "COFF\n5 2 0\n" + rows(points="255 0 0 255"),
    "COFF, counts in the word": "COFF5 2 0\n" + rows(points="255 0 0 255"),
    "COFF of shares": "COFF 5 2 0\n" + rows(points="0.5 0 0"),
    "NOFF": "NOFF\n5 2 0\n" + rows(points="0 0 1"),
    "CNOFF": "CNOFF\n5 2 0\n" + rows(points="0 0 1 9 9 9 9"),
    "NCOFF, counts in the word": "NCOFF5 2 0\n" + rows(points="0 0 1 9 9 9 9"),
    "STOFF": "STOFF\n5 2 0\n" + rows(points="0.25 0.75"),
    "STCNOFF": "STCNOFF\n5 2 0\n" + rows(points="0 0 1 9 9 9 9 0 1"),
    "colours of faces": "OFF\n5 2 0\n" + rows("255 0 0"),
    "shares of colours of faces": "OFF\n5 2 0\n" + rows("0.5 0.25 1 1"),
    "numbers of colours": "OFF\n5 2 0\n" + rows("3"),
    "colour of one face": "OFF\n5 2 0\n" + rows(faces=[FACES[0] + " 255 0 0", FACES[1]]),
    "edges and points among faces": "OFF\n5 4 0\n" + rows(faces=["2 0 1", *FACES, "1 3"]),
    "all in one line": "OFF 5 2 0 " + BODY.replace("\n", " "),
    "numbers one a line": "OFF\n5 2 0\n" + BODY.replace(" ", "\n"),
    "faces in one line": "OFF\n5 2 0\n" + "\n".join(POINTS) + "\n" + " ".join(FACES),
    "exponents and signs": "OFF\n5 2 0\n" + BODY.replace("2 0 0", "+2e0 -0 .0"),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_off(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.off").write_bytes(FILES[name].encode())
    mesh = read_mesh(tmp_path / "a.off")
    assert (mesh.n_vertices, mesh.n_faces) == (5, 3)
    assert mesh.area == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("4OFF\n5 2 0\n" + rows(points="1"), "not-supported"),
        ("C4OFF\n5 2 0\n" + rows(points="1 9 9 9"), "not-supported"),
        ("nOFF\n2\n5 2 0\n" + BODY, "not-supported"),
        ("OFF BINARY\n5 2 0\n", "not-supported"),
        ("5 2 0\n" + BODY, "wrong-format"),
        ("OFFSET 5 2 0\n" + BODY, "wrong-format"),
        ("OFF\n", "wrong-format"),
        ("OFF\n5 2 0\n" + "\n".join(POINTS), "counts-differ"),
        ("OFF\n5 3 0\n" + BODY, "counts-differ"),
        ("OFF\n5 1 0\n" + BODY, "counts-differ"),
        ("OFF\n5 2 0\n" + BODY + "0 0 9\n", "counts-differ"),
        ("OFF\n4 2 0\n" + BODY, "counts-differ"),
        ("OFF\n5 2.5 0\n" + BODY, "counts-differ"),
        ("OFF\n-5 2 0\n" + BODY, "counts-differ"),
        ("OFF\n5 2 0\n" + BODY.replace("3 0 1 2", "3 0 1 2.5"), "not-whole-numbers"),
        ("OFF\n5 2 0\n" + BODY.replace("3 0 1 2", "-3 0 1 2"), "out-of-range"),
        ("OFF\n5 2 0\n" + BODY.replace("3 0 1 2", "3 0 1 5"), "vertex-out-of-range"),
        ("OFF\n5 2 0\n" + BODY.replace("3 0 1 2", "3 0 1 1e300"), "vertex-out-of-range"),
        ("OFF\n5 2 0\n" + BODY.replace("2 1 0", "2 1 0 7"), "counts-differ"),
    ],
)
def test_off_that_is_refused(content: str, code: str, tmp_path: Path) -> None:
    (tmp_path / "a.off").write_text(content)
    with raises(code):
        read_mesh(tmp_path / "a.off")

"""Surface datasets of AFNI: NIML in text and binary, 1D, labels, and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapes

import meshmash_viewer as mv
from meshmash_viewer.io.maps import is_map_file

pytestmark = pytest.mark.usefixtures("read_here")
BALL = shapes.icosphere(1)
N = BALL.n_vertices
VALUES = np.stack([BALL.vertices[:, 2], np.arange(N) * 0.5 - 3.0], axis=1).astype(np.float32)
KEYS = np.where(BALL.vertices[:, 0] > 0.0, 7, 2).astype(np.int32)
ORDERS = {"lsbfirst": "<", "msbfirst": ">"}


def element(name: str, kind: str, rows: int, data: bytes, form: str = "", more: str = "") -> bytes:
    form = f'\n ni_form="{form}"' if form else ""
    head = f'<{name}\n {more}\n ni_type="{kind}"\n ni_dimen="{rows}"{form} >'
    return head.encode() + data + f"</{name}>\n".encode()


def packed(values: np.ndarray, form: str) -> bytes:
    if not form:
        return b"\n" + "\n".join(" ".join(map(repr, row)) for row in values.tolist()).encode()
    return values.astype(values.dtype.newbyteorder(ORDERS[form.partition(".")[2]])).tobytes()


def dataset(
    columns: np.ndarray, kind: str, form: str = "", names: str = "", rows: np.ndarray | None = None
) -> bytes:
    parts = [element("SPARSE_DATA", kind, len(columns), packed(columns, form), form)]
    if rows is not None:
        parts += [element("INDEX_LIST", "int", len(rows), packed(rows[:, None], form), form)]
    if names:
        text = f' "{names}"'.encode()
        parts += [element("AFNI_atr", "String", 1, text, more='atr_name="COLMS_LABS"')]
    parts += [element("AFNI_atr", "String", 1, b' "none"', more='atr_name="COLMS_STATSYM"')]
    return (
        b'<AFNI_dataset\n dset_type="Node_Bucket"\n ni_form="ni_group" >\n'
        + b"".join(parts)
        + (b"</AFNI_dataset>\n")
    )


@pytest.mark.parametrize("form", ["", "binary.lsbfirst", "binary.msbfirst"])
def test_columns_of_niml(form: str, tmp_path: Path) -> None:
    path = tmp_path / "lh.height.niml.dset"
    path.write_bytes(dataset(VALUES, "2*float", form, "height;half"))
    assert is_map_file(path)
    found = mv.read_maps(path, BALL)
    assert [each.name for each in found] == ["height", "half"]
    np.testing.assert_array_equal(np.stack([each.values for each in found], 1), VALUES)


def test_names_without_quotes_may_contain_spaces(tmp_path: Path) -> None:
    path = tmp_path / "lh.height.niml.dset"
    path.write_bytes(dataset(VALUES, "2*float", names="?;?").replace(b'"?;?"', b"the height; half"))
    assert [each.name for each in mv.read_maps(path, BALL)] == ["the height", "half"]


@pytest.mark.parametrize("form", ["", "binary.lsbfirst"])
def test_rows_of_some_vertices(form: str, tmp_path: Path) -> None:
    path, rows = tmp_path / "part.niml.dset", np.array([3, 1, 8], dtype=np.int32)
    path.write_bytes(dataset(VALUES[rows][:, :1], "float", form, rows=rows))
    (found,) = mv.read_maps(path, BALL)
    assert found.name == "part.niml.dset"
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(found.values)), [1, 3, 8])
    np.testing.assert_array_equal(found.values[rows], VALUES[rows, 0])


@pytest.mark.parametrize("form", ["", "binary.lsbfirst"])
def test_labels_have_names_and_colours(form: str, tmp_path: Path) -> None:
    table = b'1 0 0 1 2 "front cortex"\n0 0.5 1 1 7 "back"\n'
    labels = b"<AFNI_labeltable\n ni_form='ni_group' >\n" + element(
        "SPARSE_DATA", "4*float,int,String", 2, table
    )
    labels += element("AFNI_atr", "String", 1, b' "R;G;B;A;I;N"', more='atr_name="COLMS_LABS"')
    whole = dataset(KEYS[:, None], "int", form, "parcels")
    path = tmp_path / "lh.parcels.niml.dset"
    path.write_bytes(
        whole.replace(b"</AFNI_dataset>", labels + b"</AFNI_labeltable>\n</AFNI_dataset>")
    )
    found = mv.read_labels(path, BALL)
    assert found.name == "parcels"
    assert found.labels == (
        mv.Label(2, "front cortex", "#ff0000"), mv.Label(7, "back", "#0080ff")
    )  # fmt: skip
    np.testing.assert_array_equal(found.values, KEYS)


@pytest.mark.parametrize("indexed", [False, True])
def test_columns_of_1d(indexed: bool, tmp_path: Path) -> None:
    path = tmp_path / "lh.height.1D.dset"
    header = '# <Node_Bucket\n#  ni_type = "2*float"\n#  ColumnLabels = "height ; half"\n# >\n'
    rows = [[str(at)] * indexed + list(map(repr, row)) for at, row in enumerate(VALUES.tolist())]
    text = "\n".join(map(" ".join, rows))
    path.write_text(f"{header}{text}\n# </Node_Bucket>\n", "utf-8")
    found = mv.read_maps(path, BALL)
    assert [each.name for each in found] == ["height", "half"]
    np.testing.assert_allclose(np.stack([each.values for each in found], 1), VALUES)


WHOLE = dataset(VALUES, "2*float", "binary.lsbfirst")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (
            dataset(VALUES, "2*float").replace(b'"42"', b'"42" ni_form="base64.lsbfirst"', 1),
            "base64",
        ),
        (WHOLE[: len(WHOLE) // 3], "is no surface dataset of AFNI"),
        (
            dataset(VALUES, "2*float").replace(b"2*float", b"2*quark"),
            "is no surface dataset of AFNI",
        ),
        (dataset(VALUES, "3*float"), "126 values expected, 84 found"),
        (dataset(VALUES, "1000000000*float"), "more than"),
        (b"# nothing\n", "is no surface dataset of AFNI"),
        (b"1 2\n3\n", "is no surface dataset of AFNI"),
        (b"\xff\xfe\x00binary", "is no surface dataset of AFNI"),
        (dataset(VALUES[:5], "2*float"), "5 values"),
    ],
)
def test_others_are_refused_in_one_sentence(content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "a.niml.dset"
    path.write_bytes(content)
    with pytest.raises(mv.InputError) as refused:
        mv.read_maps(path, BALL)
    assert says in str(refused.value)
    if "AFNI" in says or "base64" in says:
        assert "ConvertDset -o_1D or -o_gii" in str(refused.value)

"""Meshes of segments opened by links: every layout of cloud-volume, and error messages."""

from __future__ import annotations

import http.server
import json
import shutil
import socket
import sys
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import numpy as np
import psutil
import pytest
from faults import raises
from segment_layers import (
    SEGMENT,
    box,
    fragment,
    halves,
    packed,
    source,
    write_fragments,
    write_layer,
    write_levels,
)

from meshmash_viewer.errors import InputError, MeshWarning
from meshmash_viewer.health import repair_mesh
from meshmash_viewer.io.links import (
    MeshLink,
    folder_of,
    is_link,
    layers_of,
    link_file,
    parse_link,
    read_link,
    shown_path,
)
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Cancelled, Progress

pytest.importorskip("cloudvolume")

FINE, COARSE = box(3), box(2)
WHOLE = np.round((FINE.vertices + 1000.0) * 10.0)


@pytest.fixture(scope="module")
def layers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Write one layer of each layout, each with a box in two fragments; return the folders."""
    top = tmp_path_factory.mktemp("layers")
    pieces = halves(FINE)
    grown = [packed(np.round((each.vertices + 1000.0) * 10.0), each.faces) for each in pieces]
    return {
        "fragments": write_fragments(top / "fragments", [fragment(each) for each in pieces]),
        "draco": write_fragments(top / "draco", grown),
        "levels": write_levels(top / "levels", [FINE, COARSE]),
        "sharded": write_levels(top / "sharded", [FINE, COARSE], sharded=True),
    }


def read(folder: Path, segment: int | str | None = SEGMENT, **given: object) -> Mesh:
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        return read_mesh(source(folder), segment=segment, **given)  # type: ignore[arg-type]


def fault_of(link: str, segment: int | str | None = SEGMENT, lod: int | None = None) -> InputError:
    with pytest.raises(InputError) as caught:
        read_mesh(link, segment=segment, lod=lod)
    said = str(caught.value)
    assert said.endswith(".")
    assert "\n" not in said
    return caught.value


# -- layouts -------------------------------------------------------------------------------------


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("lod", [None, 1])
@pytest.mark.parametrize("layout", ["fragments", "levels", "sharded"])
def test_vertices_and_faces_are_those_of_cloud_volume(
    layers: dict[str, Path], layout: str, lod: int | None
) -> None:
    if layout == "fragments" and lod:
        pytest.skip("has one level of detail")
    mesh = read(layers[layout], lod=lod)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from cloudvolume import CloudVolume

        layer = CloudVolume(source(layers[layout]), progress=False).mesh
        if layout == "fragments":
            theirs = layer.get(SEGMENT, remove_duplicate_vertices=False)
        else:
            theirs = layer.get(SEGMENT, lod=lod or 0)[SEGMENT]
    joined = repair_mesh(Mesh(theirs.vertices, theirs.faces), "merge_seams")
    assert np.array_equal(mesh.vertices, joined.vertices)
    assert np.array_equal(mesh.faces, joined.faces)
    expected = COARSE if lod else FINE
    assert (mesh.n_vertices, mesh.n_faces) == (expected.n_vertices, expected.n_faces)
    assert (mesh.unit, mesh.name) == ("nm", str(SEGMENT))
    assert len(theirs.vertices) > mesh.n_vertices  # repeated at the seam


def test_progress_and_seams_of_a_child_process(layers: dict[str, Path]) -> None:
    heard: list[Progress] = []
    with pytest.warns(MeshWarning, match="32 vertices at the seams of its fragments, now joined"):
        mesh = read_mesh(source(layers["fragments"]), segment=SEGMENT, progress=heard.append)
    assert mesh.n_vertices == FINE.n_vertices
    shares = [each.fraction for each in heard]
    assert shares == sorted(shares)  # type: ignore[type-var]
    assert shares[-1] == 1.0


def test_cancel_ends_the_child_process(layers: dict[str, Path]) -> None:
    before = set(psutil.Process().children())
    with pytest.raises(Cancelled):
        read(layers["fragments"], cancel=lambda: True)
    assert set(psutil.Process().children()) <= before


@pytest.mark.usefixtures("read_here")
def test_transform_and_one_fragment_are_kept_as_they_are(tmp_path: Path) -> None:
    folder = write_fragments(tmp_path / "layer", [fragment(FINE)])
    info = folder / "mesh" / "info"
    moved = {**json.loads(info.read_text()), "transform": [2, 0, 0, 5, 0, 2, 0, 0, 0, 0, 2, 0]}
    info.write_text(json.dumps(moved))
    assert np.array_equal(read(folder).vertices, 2.0 * FINE.vertices + [5.0, 0.0, 0.0])


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("layout", ["fragments", "draco", "levels", "sharded"])
def test_a_folder_of_meshes_without_a_layer(
    layers: dict[str, Path], layout: str, tmp_path: Path
) -> None:
    shutil.copytree(layers[layout] / "mesh", folder := tmp_path / "meshes of a cell")
    for lod in (None, 1) if layout in ("levels", "sharded") else (None,):
        expected, mesh = read(layers[layout], lod=lod), read(folder, lod=lod)
        assert np.array_equal(mesh.vertices, expected.vertices)
        assert np.array_equal(mesh.faces, expected.faces)
        assert mesh.unit == "nm"
        if layout in ("fragments", "draco"):  # the file that lists the fragments is the mesh
            with pytest.warns(MeshWarning, match="now joined"):
                listed = read_mesh(folder / f"{SEGMENT}:0")
            assert np.array_equal(listed.vertices, expected.vertices)
            assert listed.name == str(SEGMENT)
    assert fault_of(source(folder), 12).code == "segment-not-found"


# -- faults --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("layout", ["fragments", "levels", "sharded"])
def test_missing_segment(layers: dict[str, Path], layout: str) -> None:
    said = str(fault_of(source(layers[layout]), 12))
    assert said.endswith("#segment=12 has no mesh: check the id, or open another segment.")


@pytest.mark.usefixtures("read_here")
def test_layer_without_meshes_or_info_or_folder(tmp_path: Path) -> None:
    assert fault_of(source(write_layer(tmp_path / "bare"))).code == "no-mesh"
    (tmp_path / "empty").mkdir()
    assert fault_of(source(tmp_path / "empty")).code == "no-layer"
    assert fault_of(source(tmp_path / "nowhere")).code == "no-layer"


@pytest.mark.usefixtures("read_here")
def test_broken_fragments_are_named(tmp_path: Path) -> None:
    good, bad = map(fragment, halves(FINE))
    far = np.frombuffer(bad, dtype="<u4").copy()
    far[-1] = 10_000
    short = packed(WHOLE, FINE.faces)[:-200]
    for number, content in enumerate((bad[:-7], bad[:40], b"", far.tobytes(), short)):
        folder = write_fragments(tmp_path / str(number), [good, content])
        assert fault_of(source(folder)).code == "file-damaged"
    (folder / "mesh" / f"{SEGMENT}:0:1").unlink()
    assert fault_of(source(folder)).fault.endswith(" lacks 1 fragment")


@pytest.mark.usefixtures("read_here")
def test_broken_fragment_of_a_level_and_levels_that_are_not_there(tmp_path: Path) -> None:
    folder = write_levels(tmp_path / "layer", [FINE, COARSE])
    assert fault_of(source(folder), lod=2).code == "no-such-level"
    assert fault_of(source(folder), lod=-1).code == "out-of-range"
    data = folder / "mesh" / str(SEGMENT)
    data.write_bytes(b"DRACO" + bytes(data.stat().st_size - 5))
    assert fault_of(source(folder)).code == "file-damaged"
    one = write_fragments(tmp_path / "one", [fragment(FINE)])
    assert fault_of(source(one), lod=1).code == "no-such-level"


@pytest.mark.usefixtures("read_here")
def test_the_mesh_is_the_same_in_whatever_order_fragments_are_listed(tmp_path: Path) -> None:
    folder = write_fragments(tmp_path / "layer", [fragment(each) for each in halves(FINE)])
    manifest = folder / "mesh" / f"{SEGMENT}:0"
    before, names = read(folder), json.loads(manifest.read_text())["fragments"]
    manifest.write_text(json.dumps({"fragments": [names[1], names[0], names[1]]}))
    after = read(folder)
    np.testing.assert_array_equal(after.vertices, before.vertices)
    np.testing.assert_array_equal(after.faces, before.faces)


@pytest.fixture(params=[401, 403])
def refusing_server(request: pytest.FixtureRequest) -> Iterator[str]:
    """Run a local server that refuses access, with a secret in its message; yield its address."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(request.param, "token=hush")
            self.end_headers()

        do_HEAD = do_GET

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.usefixtures("read_here")
def test_no_network_and_no_credentials(refusing_server: str) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    said = str(fault_of(f"precomputed://http://127.0.0.1:{port}/layer"))
    assert "cannot be reached, as 127.0.0.1 does not answer: check the network" in said
    said = str(fault_of(f"precomputed://http://{refusing_server}/layer"))
    assert "may not be read with your permissions or credentials: give cloud-volume" in said
    assert "hush" not in said


def test_not_installed(layers: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cloudvolume", None)
    said = str(fault_of(source(layers["fragments"])))
    assert 'cloud-volume, which is not installed: pip install "meshmash-viewer[neuro]".' in said


# -- links ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("segment", ["axon", "12a", "-3", "1.5", "0", str(2**64), "", "१२"])
def test_ids_that_are_none(segment: str) -> None:
    with raises("wrong-link"):
        parse_link("precomputed://gs://bucket/layer", segment)


@pytest.mark.parametrize(
    "text",
    [
        "graphene://https://me:hush@example.org/table/x",
        "precomputed://https://example.org/x?middle_auth_token=hush",
        "https://example.org/#!"
        + quote('{"layers": [{"source": "precomputed://https://a:hush@b.org/x"}]}'),
    ],
)
def test_secrets_are_refused_and_not_repeated(text: str) -> None:
    with raises("secret-in-link") as caught:
        parse_link(text, 1)
    assert "hush" not in str(caught.value)


def test_a_url_of_neuroglancer_offers_its_segments() -> None:
    state = {
        "layers": [
            {"type": "image", "source": "precomputed://gs://bucket/em", "name": "em"},
            {
                "type": "segmentation",
                "name": "cells",
                "source": [{"url": "gs://bucket/cells/|neuroglancer-precomputed:"}],
                "segments": ["12", "!13"],
            },
            {
                "type": "segmentation_with_graph",
                "name": "proofread",
                "source": "graphene://middleauth+https://example.org/table/x",
                "segments": ["14"],
            },
        ]
    }
    url = "https://neuroglancer-demo.appspot.com/?hl=en#!" + quote(json.dumps(state))
    cells, proofread = layers_of(url)
    assert (cells.source, cells.segments) == ("precomputed://gs://bucket/cells", (12, 13))
    assert proofread.source == "graphene://middleauth+https://example.org/table/x"
    assert parse_link(url, 14).source == proofread.source
    assert parse_link(url, "13") == MeshLink(cells.source, 13)
    with raises("ambiguous-content"):
        parse_link(url)
    with raises("ambiguous-content", "names 2 layers, and segment 15 may be of any"):
        parse_link(url, 15)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("https://example.org/#!https://states.org/12", "kept on a server"),
        ("https://example.org/#!%7B%22layers", "cannot be read"),
        ("https://example.org/#!" + quote('{"layers": 3}'), "cannot be read"),
        ("https://example.org/#!" + quote('{"layers": []}'), "no layer of segments"),
        ("ftp://example.org/layer", "A link of ftp:// cannot be read"),
        ("precomputed://", "A link of precomputed:// cannot be read"),
    ],
)
def test_links_that_are_none(text: str, fault: str) -> None:
    assert is_link(text)
    with raises("wrong-link", fault):
        parse_link(text, 1)


def test_the_text_of_a_link_is_one_and_its_file_is_found_again(own_cache: Path) -> None:
    link = MeshLink("precomputed://gs://bucket/layer", 12, 1)
    assert parse_link(str(link)) == link
    assert parse_link("gs://bucket/layer/", 12, 1) == link
    path = link_file(link)
    assert path == link_file(link) != link_file(MeshLink(link.source, 12))
    assert (path.name, own_cache in path.parents) == ("12.meshlink", True)
    assert read_link(path) == link
    assert shown_path(path) == str(link)
    assert folder_of(path) == Path()
    with raises("missing-argument"):
        parse_link("gs://bucket/layer")


@pytest.mark.usefixtures("read_here")
def test_a_file_of_a_link_is_read_as_the_link_is(layers: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "axon.meshlink"
    path.write_text(f"{source(layers['draco'])}#segment={SEGMENT}\n")
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        assert read_mesh(path).content_hash == read(layers["draco"]).content_hash
    path.write_text("axon")
    with raises("wrong-link"):
        read_mesh(path)
    with raises("conflicting-arguments"):
        read_mesh(path, segment=3)

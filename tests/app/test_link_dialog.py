"""Dialog of a link (Ctrl+L): opens the mesh of a segment and restores its session."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

import pytest
from closed_form import part
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot
from segment_layers import SEGMENT, box, fragment, halves, source, write_fragments

from meshmash_viewer.app.dialogs.link_dialog import LinkDialog
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.io.links import MeshLink, read_link
from meshmash_viewer.io.session import read_session
from meshmash_viewer.model.script import reproduction_script

PATIENCE = 60_000
LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def dialog(qtbot: QtBot) -> LinkDialog:
    made = LinkDialog()
    qtbot.addWidget(made)
    with qtbot.waitExposed(made, timeout=120_000):
        made.show()
    return made


def ask(dialog: LinkDialog, link: str, segment: str = "", button: str = "open") -> str:
    """Type into the dialog, press a button, and return the message of the dialog."""
    for edit, text in ((part(dialog, "link_edit"), link), (dialog.segment_combo, segment)):
        if text:
            edit.setFocus()
            QTest.keyClick(edit, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
            QTest.keyClicks(edit, text)
    QTest.mouseClick(part(dialog, f"link_{button}_button"), LEFT)
    return str(part(dialog, "link_fault_label").text())


def test_what_cannot_be_opened_is_said_and_can_be_corrected(dialog: LinkDialog) -> None:
    assert "A link of this kind cannot be read" in ask(dialog, "layer", "12")
    assert "'axon' is no id of a segment" in ask(dialog, "gs://bucket/layer", "axon")
    said = ask(dialog, "https://me:hush@example.org/layer", "12")
    assert "recent files and sessions" in said
    assert "hush" not in said
    assert dialog.isVisible()
    assert not part(dialog, "link_compare_button").isVisible()
    dialog.level_combo.setCurrentIndex(2)
    assert ask(dialog, "gs://bucket/layer", "12") == ""
    assert not dialog.isVisible()
    assert read_link(dialog.path) == MeshLink("precomputed://gs://bucket/layer", 12, 1)


def test_the_segments_of_a_url_of_neuroglancer_are_offered(dialog: LinkDialog) -> None:
    layers = [
        {"type": "segmentation", "name": name, "source": f"precomputed://gs://b/{name}",
         "segments": segments}
        for name, segments in (("cells", ["12", "13"]), ("nuclei", ["12"]))
    ]  # fmt: skip
    dialog.link_edit.setText("https://example.org/#!" + quote(json.dumps({"layers": layers})))
    combo = dialog.segment_combo
    texts = [combo.itemText(row) for row in range(combo.count())]
    assert texts == ["12  (cells)", "13  (cells)", "12  (nuclei)"]
    combo.setCurrentIndex(2)
    assert ask(dialog, "") == ""
    assert read_link(dialog.path) == MeshLink("precomputed://gs://b/nuclei", 12)


@pytest.mark.slow
def test_a_link_is_opened_and_its_session_is_found_again(
    open_window: Callable[..., MainWindow],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    qtbot: QtBot,
) -> None:
    pytest.importorskip("cloudvolume")
    folder = write_fragments(tmp_path / "layer", [fragment(each) for each in halves(box(2))])
    link = MeshLink(source(folder), SEGMENT)
    monkeypatch.setattr(Settings, "close", lambda _: None)
    window = open_window()
    QTest.keyClick(window, Qt.Key.Key_L, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: bool(window.findChildren(LinkDialog)), timeout=PATIENCE)
    ask(window.findChildren(LinkDialog)[0], link.source, str(SEGMENT))
    document = window.document
    qtbot.waitUntil(lambda: document.mesh is not None, timeout=PATIENCE)
    window.wait()
    assert document.mesh is not None
    assert (document.mesh.name, document.unit) == (str(SEGMENT), "nm")
    assert part(window, "mesh_path_label").toolTip() == str(link)
    assert [read_link(each) for each in window.settings.recent] == [link]
    QTest.keyClick(window, Qt.Key.Key_L, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: bool(window.findChildren(LinkDialog)), timeout=PATIENCE)
    ask(window.findChildren(LinkDialog)[0], "", str(SEGMENT), "compare")
    qtbot.waitUntil(lambda: window.opening.pair is not None, timeout=PATIENCE)
    second = window.opening.pair.second
    qtbot.waitUntil(lambda: second.mesh is not None, timeout=PATIENCE)
    assert (second.mesh.name, document.mesh.name) == (str(SEGMENT), str(SEGMENT))
    window.opening.end_comparison()
    assert f"mv.read_mesh('{link}', unit='nm')" in reproduction_script(document)
    document.pins.toggle(7)
    saved = tmp_path / "axon.meshmash.json"
    window.opening.store_session(saved)
    assert json.loads(saved.read_text())["meshes"][0]["mesh_path"] == str(link)
    assert read_link(Path(read_session(saved).mesh_path)) == link
    before, sessions = document.mesh.content_hash, window.settings.sessions
    window.close()

    window = open_window()
    window.settings.sessions = sessions
    window.opening.last_session._folder = sessions
    window.open_mesh(str(link))
    document = window.document
    qtbot.waitUntil(lambda: len(document.pins.placed) == 1, timeout=PATIENCE)
    assert document.mesh is not None
    assert document.mesh.content_hash == before
    assert document.pins.placed[0].vertex == 7

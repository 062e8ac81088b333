"""Links to meshes of segments, as sources of layers, URLs of Neuroglancer, or link files."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard
from urllib.parse import unquote

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.atomic import link_folder, made_folder, writing_errors

#: Ending of a file that holds the text of one `MeshLink`.
LINK_ENDING = ".meshlink"

_SCHEME = re.compile(r"[a-z][a-z0-9+]+://", re.IGNORECASE)
_LAYER = re.compile(
    r"(?:(precomputed|graphene)://)?((?:gs|s3|file|(?:middleauth\+)?https?)://\S.*)", re.IGNORECASE
)
#: Sources of Neuroglancer since 2025, such as "gs://bucket/layer/|neuroglancer-precomputed:".
_PIPED = re.compile(r"(.*)\|(neuroglancer-precomputed|graphene):?/?", re.IGNORECASE)
#: The segment and the level of detail at the end of a `MeshLink`.
_CHOSEN = re.compile(r"#segment=(\d+)(?:&lod=(\d+))?$")
_MANIFEST = re.compile(r"(\d+):\d+(?:\.gz)?")
#: Number of bytes read from a link file.
_LARGEST = 10_000


@dataclass(frozen=True)
class MeshLink:
    """The mesh of a segment: its layer, such as "precomputed://gs://bucket/seg", and its id.

    Its text, "precomputed://gs://bucket/seg#segment=12&lod=1", is read by `parse_link`.
    """

    source: str
    segment: int
    #: Level of detail, 0 for the finest. None is also the finest, but raises an error if it has
    #: more vertices than `segments.MOST_VERTICES`.
    lod: int | None = None

    def __str__(self) -> str:
        level = "" if self.lod is None else f"&lod={self.lod}"
        return f"{self.source}#segment={self.segment}{level}"


@dataclass(frozen=True)
class Layer:
    """A layer in a link, with the segments that the link selects in the layer."""

    source: str
    segments: tuple[int, ...] = ()
    lod: int | None = None
    name: str = ""


def link_of_manifest(path: str | Path) -> MeshLink | None:
    """Return the link to a segment if the file, such as "123:0", lists its fragments next to it."""
    named = _MANIFEST.fullmatch(Path(path).name)
    if named is None:
        return None
    return MeshLink(f"precomputed://file://{Path(path).absolute().parent}", segment_id(named[1]))


def is_link(text: object) -> TypeGuard[str]:
    """Whether an argument is a link rather than the path of a file."""
    return isinstance(text, str) and _SCHEME.match(text.strip()) is not None


def parse_link(text: str, segment: int | str | None = None, lod: int | None = None) -> MeshLink:
    """Parse a link; `segment` is needed unless the text selects exactly one segment.

    `InputError` is raised if the text is no link or contains a secret, or the segment is missing or
    ambiguous.
    """
    layers = layers_of(text)
    if lod is not None and lod < 0:
        fault = f"The level of detail is {lod}"
        raise InputError("out-of-range", fault, "give 0 for the finest, or a larger one")
    if segment is None:
        named = [(layer, each) for layer in layers for each in layer.segments]
        if not named:
            fault = f"The link {_short(layers)} names no segment"
            raise InputError("missing-argument", fault, "give its id (--segment ID, or segment=ID)")
        if len(named) > 1:
            ids = ", ".join(str(each) for _, each in named[:5]) + ", …" * (len(named) > 5)
            raise InputError(
                "ambiguous-content",
                f"The link names {len(named)} segments: give one of them (--segment ID, or"
                " segment=ID)",
                f"{ids}",
            )
        layer, number = named[0]
    else:
        number = segment_id(segment)
        listing = [layer for layer in layers if number in layer.segments] or list(layers)
        if len(listing) > 1:
            raise InputError(
                "ambiguous-content",
                f"The link names {len(listing)} layers, and segment {number} may be of any: give"
                " the link of one",
                f"{_short(listing)}",
            )
        layer = listing[0]
    return MeshLink(layer.source, number, layer.lod if lod is None else lod)


def segment_id(text: int | str) -> int:
    """Convert the id of a segment to an integer; `InputError` is raised if it is no id."""
    written = str(text).strip()
    if not re.fullmatch(r"[0-9]{1,20}", written) or not 0 < int(written) < 2**64:
        remedy = "give the whole number that Neuroglancer shows, such as 720575940612345678"
        raise InputError("wrong-link", f"{printable(written, 40)!r} is no id of a segment", remedy)
    return int(written)


def layers_of(text: str) -> tuple[Layer, ...]:
    """Return the layer of a link, or all segmentation layers of a URL of Neuroglancer.

    `InputError` is raised if there is no layer, or the link contains a secret.
    """
    text = text.strip()
    _, mark, state = text.partition("#!")
    if mark:
        return _layers_of_state(state)
    chosen = _CHOSEN.search(text)
    if chosen is None:
        return (Layer(_source(text)),)
    lod = None if chosen[2] is None else int(chosen[2])
    return (Layer(_source(text[: chosen.start()]), (segment_id(chosen[1]),), lod),)


def _layers_of_state(state: str) -> tuple[Layer, ...]:
    state = unquote(state).strip()
    if not state.startswith("{"):
        raise InputError(
            "wrong-link",
            "The state of this URL of Neuroglancer is kept on a server",
            "give the source of its layer (precomputed://… or graphene://…) and the id of the"
            " segment",
        )
    try:
        layers = json.loads(state).get("layers", [])
        if isinstance(layers, dict):
            layers = [{**each, "name": name} for name, each in layers.items()]
        found = tuple(filter(None, map(_layer_of_entry, layers)))
    except InputError:
        raise
    except (ValueError, TypeError, AttributeError, RecursionError):
        raise InputError(
            "wrong-link",
            "The state of this URL of Neuroglancer cannot be read",
            "copy the whole URL again, or give the source of its layer and the id of the segment",
        ) from None
    if not found:
        fault = "This URL of Neuroglancer has no layer of segments"
        raise InputError("wrong-link", fault, "open one there, and copy it again")
    return found


def _layer_of_entry(entry: dict[str, Any]) -> Layer | None:
    """Return the layer of an entry of the state; None unless it is a segmentation layer."""
    sources = entry.get("source", [])
    for given in sources if isinstance(sources, list) else [sources]:
        url = str(given.get("url", "") if isinstance(given, dict) else given)
        kind = entry.get("type", "segmentation").removesuffix("_with_graph")
        if kind == "segmentation" and (_LAYER.fullmatch(url) or _PIPED.fullmatch(url)):
            # ids of hidden segments begin with "!"
            ids = (str(each).lstrip("!") for each in entry.get("segments", []))
            return Layer(_source(url), tuple(map(segment_id, ids)), name=str(entry.get("name", "")))
    return None


def _source(text: str) -> str:
    """Return the source of a layer in the form that is stored and shown."""
    piped = _PIPED.fullmatch(text)
    if piped:
        text = f"{piped[2].lower().removeprefix('neuroglancer-')}://{piped[1]}"
    found = _LAYER.fullmatch(text.strip())
    if found is None:
        scheme = _SCHEME.match(text)
        raise InputError(
            "wrong-link",
            f"A link of {scheme[0] if scheme else 'this kind'} cannot be read",
            "give the source of a layer, such as precomputed://gs://bucket/layer, or a URL of"
            " Neuroglancer",
        )
    kind, place = (found[1] or "precomputed").lower(), found[2].rstrip("/")
    protocol, _, rest = place.partition("://")
    if "@" in rest.partition("/")[0] or "?" in rest:
        raise InputError(
            "secret-in-link",
            "The link holds a password or a query such as ?token=…, which recent files and sessions"
            " would keep",
            "give it without, and the secret to cloud-volume in ~/.cloudvolume/secrets",
        )
    if protocol.lower() == "file" and os.name == "posix":
        rest = os.path.abspath(os.path.expanduser(unquote(rest)))
    return f"{kind}://{protocol.lower()}://{rest}"


def _short(layers: tuple[Layer, ...] | list[Layer]) -> str:
    return printable(", ".join(layer.source for layer in layers), 300)


# -- files ---------------------------------------------------------------------------------------


def link_file(link: MeshLink) -> Path:
    """Write a link to a file in the folder of links, and return its path, for sessions.

    `InputError` is raised if the file cannot be written.
    """
    mark = hashlib.sha256(f"{link.source}\n{link.lod}".encode()).hexdigest()[:12]
    path = link_folder() / mark / f"{link.segment}{LINK_ENDING}"
    with made_folder(path.parent), writing_errors(path):
        path.write_text(f"{link}\n", encoding="utf-8")
    return path


def read_link(path: Path) -> MeshLink:
    """Read the link in a file; `InputError` is raised if the file contains no link."""
    try:
        text = path.read_bytes()[:_LARGEST].decode("utf-8").strip()
    except (OSError, UnicodeDecodeError):
        text = ""
    if not is_link(text):
        fault = f"{path} holds no link"
        raise InputError("wrong-link", fault, "write precomputed://…#segment=ID into it")
    return parse_link(text)


def shown_path(path: Path) -> str:
    """Return the text to display for a file: its path, or the link in a file of `link_folder`."""
    link = _known_link(path)
    return str(path) if link is None else str(link)


def name_and_place(path: Path) -> tuple[str, str]:
    """Return the name of a file and its folder; for a link file, the segment and its layer."""
    link = _known_link(path)
    return (path.name, str(path.parent)) if link is None else (str(link.segment), link.source)


def _known_link(path: Path) -> MeshLink | None:
    if path.suffix == LINK_ENDING and path.parent.parent == link_folder():
        with contextlib.suppress(InputError):  # reading the mesh reports the fault
            return read_link(path)
    return None


def folder_of(path: Path | None) -> Path:
    """Return the folder for results of a mesh by default; an empty path for links and None."""
    return Path() if path is None or path.suffix == LINK_ENDING else path.parent

"""Provenance and column names in the headers of PLY and OBJ files, readable by other programs."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence

#: Longest line in characters: MeshLab rejects lines over 512, the end of the line included.
_LONGEST_LINE = 500
#: Longest name of a property in characters, as other programs show names in lists.
_LONGEST_NAME = 100
_SPACE = r"\u0020"
_FIRST, _NEXT = "meshmash-viewer ", "meshmash-viewer+ "


def comment_lines(meta: str, keyword: str) -> Iterator[str]:
    """Split the text of `provenance` into comment lines of at most 500 characters.

    Lines after the first begin with ``meshmash-viewer+``. None begins or ends with a space of the
    text, which other programs may drop.

    Parameters
    ----------
    meta : str
        JSON, one line of ASCII without spaces between items.
    keyword : str
        Prefix of a comment line: "comment" in PLY, "#" in OBJ.
    """
    # all spaces are within strings; repeated ones, and those at the end of a line, are escaped
    begin, rest = f"{keyword} {_FIRST}", meta.replace("  ", " " + _SPACE)
    while len(begin + rest) > _LONGEST_LINE:
        room = _LONGEST_LINE - len(begin)
        between = rest.rfind(',"', 0, room) + 1  # two items
        end = between if between > room // 2 else room
        line, rest = rest[:end], rest[end:]
        if line.endswith(" "):
            line, rest = line[:-1], _SPACE + rest
        elif rest.startswith(" "):
            rest = _SPACE + rest[1:]
        yield begin + line
        begin = f"{keyword} {_NEXT}"
    yield begin + rest


def stated_comment(lines: Iterable[str]) -> str:
    """Return the text of `provenance` in comment lines without their keyword, or "".

    Older files have it in one line.
    """
    text = ""
    for line in lines:
        if line.startswith(_FIRST) and not text:
            text = line.removeprefix(_FIRST)
        elif line.startswith(_NEXT) and text:
            text += line.removeprefix(_NEXT)
    return text


def property_names(columns: Sequence[str]) -> list[str]:
    """Convert column names to names of PLY properties: ASCII, no white space, unique, short."""
    names: list[str] = []
    for column in columns:
        name = re.sub(r"[^!-~]", "_", column.replace("λ", "lambda"))[:_LONGEST_NAME] or "feature"
        free, number = name, len(names)
        while free in names or free in ("x", "y", "z", "vertex"):
            free, number = f"{name}_{number}", number + 1
        names.append(free)
    return names


def names_of_properties(meta: str) -> dict[str, str]:
    """Return the column of each property, from the text of `provenance`."""
    try:
        columns = json.loads(meta)["columns"]
        return dict(zip(property_names(columns), columns, strict=True))
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}

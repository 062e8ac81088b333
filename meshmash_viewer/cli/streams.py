"""Standard output and error in any encoding, also if they are missing or closed.

Windows redirects output in the code page of the country, a terminal over ssh may be ASCII, and a
program without a console has no streams. An error handler of the streams replaces characters that
the encoding lacks by ASCII: λ by "lambda", ≈ by "~". A space separates a word such as "lambda" from
a letter or digit on either side, but not from its exponent or index.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import re
import sys
import unicodedata
from typing import TextIO

from meshmash_viewer.units import plain_text
from meshmash_viewer.work import closed_pipe_errors

PROGRAM = "meshmash-viewer"

#: Name of the error handler, for ``errors`` of streams and `str.encode`.
SPELLED = "meshmash-spelled"

#: ASCII for characters that Unicode's tables do not decompose.
_SIGNS = {
    **dict.fromkeys("–—−‐‑·╌▬", "-"),
    **dict.fromkeys("‘’′", "'"),
    **dict.fromkeys("“”″", '"'),
    **dict.fromkeys("•●", "*"),
    **dict.fromkeys("µμ", "u"),
    "°": " deg", "≈": "~", "≤": "<=", "≥": ">=", "≠": "!=", "±": "+-", "∞": "inf", "×": "x",
    "÷": "/", "⁄": "/", "→": "->", "←": "<-", "↔": "<->", "‖": "||", "○": "o", "█": "#",
    "ß": "ss", "æ": "ae", "Æ": "AE", "œ": "oe", "Œ": "OE", "ø": "o", "Ø": "O", "ł": "l", "Ł": "L",
    "đ": "d", "Đ": "D", "ı": "i",
}  # fmt: skip
_WORDS = {"√": "sqrt", "∫": "integral", "∇": "grad", "∂": "d", "∑": "sum"}
_RAISED, _LOWERED = "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻⁼⁽⁾ᵀⁿ", "₀₁₂₃₄₅₆₇₈₉₊₋"
#: Exponents, indices, and runs of Greek letters and signs of `_WORDS`.
_SCRIPTS = re.compile(f"(?P<raised>[{_RAISED}]+)|(?P<lowered>[{_LOWERED}]+)")
_GREEK = re.compile(f"[Ͱ-λν-Ͽ{''.join(_WORDS)}]+")
#: Length from which a run of Greek letters is a Greek word, not a formula.
_GREEK_WORD = 3


def prepare_streams() -> None:
    """Make standard streams accept every character, and replace missing streams."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # no console, or closed streams
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=SPELLED)


def answer(text: str) -> None:
    """Print a result with plain spaces and minus signs, which other programs can read.

    `BrokenPipeError` is raised if the reader of standard output has closed it.
    """
    with closed_pipe_errors():
        print(plain_text(text), flush=True)


def say(sentence: str) -> None:
    """Print a message on standard error."""
    try:
        print(f"{PROGRAM}: {' '.join(sentence.split())}", file=sys.stderr, flush=True)
    except OSError:
        drop(sys.stderr)  # a closed stderr does not stop the computation


def drop(stream: TextIO) -> None:
    """Discard pending and further output of a stream, which would raise at exit."""
    with contextlib.suppress(OSError, ValueError):  # streams of notebooks have no descriptor
        nothing = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nothing, stream.fileno())
        finally:
            os.close(nothing)


# Replacement of characters ---------------------------------------------------------------------


def _spell(fault: UnicodeError) -> tuple[str | bytes, int]:
    """Replace the first characters that an encoding lacks by ASCII; a handler for `codecs`."""
    if not isinstance(fault, UnicodeEncodeError):
        raise fault
    text, start = fault.object, fault.start
    if "\udc80" <= text[start] <= "\udcff":
        # an undecodable byte of a file name is written unchanged
        return bytes([ord(text[start]) & 0xFF]), start + 1
    # the whole exponent, even if the encoding contains some digits: nm⁻² is nm^-2
    if group := _SCRIPTS.match(text, start):
        mark, marks = ("^", _RAISED) if group["raised"] else ("_", _LOWERED)
        mark = "" if start and text[start - 1] in marks else mark
        return mark + "".join(map(_plain, group[0])), group.end()
    if group := _GREEK.match(text, start, fault.end):
        if len(group[0]) >= _GREEK_WORD:
            return _escaped(group[0]), group.end()
        before, after = text[:start][-1:], text[group.end() :][:1]
        left = before.isalnum() or _plain(before)[-1:].isalnum()
        right = after.isalnum() or _plain(after)[:1].isalnum()
        right = right and after not in _RAISED + _LOWERED
        return " " * left + " ".join(map(_word, group[0])) + " " * right, group.end()
    return _plain(text[start]), start + 1


def _word(letter: str) -> str:
    """Return the word for a character, "lambda" or "Sigma"."""
    named = re.match(r"GREEK (SMALL|CAPITAL) LETTER (\w+)", unicodedata.name(letter, ""))
    if named is None:
        return _WORDS.get(letter) or _escaped(letter)
    word = named[2].lower().replace("lamda", "lambda")
    return word if named[1] == "SMALL" else word.capitalize()


def _plain(letter: str) -> str:
    """Return ASCII for one character: a sign, its base letter, or an escape sequence."""
    if letter in _SIGNS:
        return _SIGNS[letter]
    parts = unicodedata.normalize("NFKD", letter)
    spelled = "".join(_SIGNS.get(part, part) for part in parts if not unicodedata.combining(part))
    return spelled if spelled.isascii() else _escaped(letter)


def _escaped(text: str) -> str:
    return text.encode("ascii", "backslashreplace").decode("ascii")


codecs.register_error(SPELLED, _spell)

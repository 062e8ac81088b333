"""Standard output and error, for any encoding, and if they are missing or closed.

Windows redirects output in the code page of the country, a terminal over ssh may be ASCII, and a
program without a console has no streams. What an encoding lacks is spelled in ASCII (λ as
"lambda", ≈ as "~"), by an error handler of the streams, so that nothing has to be written twice.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import itertools
import os
import sys
import unicodedata
from typing import TextIO

from meshmash_viewer.io.pipes import closed_pipe_errors

PROGRAM = "meshmash-viewer"

#: Name of the error handler, as ``errors=`` of any stream or `str.encode` takes it.
SPELLED = "meshmash-spelled"

#: What replaces signs that have no decomposition in Unicode's tables.
_SIGNS = {
    **dict.fromkeys("–—−‐‑·╌▬", "-"),
    **dict.fromkeys("‘’′", "'"),
    **dict.fromkeys("“”″", '"'),
    **dict.fromkeys("•●", "*"),
    **dict.fromkeys("µμ", "u"),
    "≈": "~",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "±": "+-",
    "∞": "inf",
    "×": "x",
    "÷": "/",
    "→": "->",
    "←": "<-",
    "↔": "<->",
    "‖": "||",
    "⁄": "/",
    "○": "o",
    "█": "#",
    "°": " deg",
    "ß": "ss",
    "æ": "ae",
    "Æ": "AE",
    "œ": "oe",
    "Œ": "OE",
    "ø": "o",
    "Ø": "O",
    "ł": "l",
    "Ł": "L",
    "đ": "d",
    "Đ": "D",
    "ı": "i",
}
#: Words, which are kept apart from letters and digits next to them.
_WORDS = {"√": "sqrt", "∫": "integral", "∇": "grad", "∂": "d", "∑": "sum"}
#: Marks of what is raised or lowered.
_MARKS = {"<super>": "^", "<sub>": "_"}
#: As many Greek letters in a row are a word of that language, not a formula.
_GREEK_WORD = 3


def prepare_streams() -> None:
    """Make standard output and error accept every character, and replace missing ones."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # a program without a console, or one whose streams were closed
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=SPELLED)


def answer(text: str) -> None:
    """Print a result.

    Raises
    ------
    BrokenPipeError
        If nothing reads standard output any more.
    OSError
        If it cannot be written, as on a full disk.
    """
    with closed_pipe_errors():
        print(text, flush=True)


def say(sentence: str) -> None:
    """Print a message on standard error."""
    try:
        print(f"{PROGRAM}: {' '.join(sentence.split())}", file=sys.stderr, flush=True)
    except OSError:
        drop(sys.stderr)  # results do not depend on whether messages are read


def drop(stream: TextIO) -> None:
    """Discard pending and further output of a stream, which would raise at exit."""
    with contextlib.suppress(OSError, ValueError):  # a stream of a test or notebook has no number
        nothing = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nothing, stream.fileno())
        finally:
            os.close(nothing)


# What replaces a character ---------------------------------------------------------------------


def _spell(fault: UnicodeError) -> tuple[str | bytes, int]:
    """Spell the characters that an encoding lacks; an error handler for `codecs`."""
    if not isinstance(fault, UnicodeEncodeError):
        raise fault
    text, start, end = fault.object, fault.start, fault.end
    if "\udc80" <= text[start] <= "\udcff":
        # A byte of a file's name that was no text: as it came.
        return bytes([ord(text[start]) & 0xFF]), start + 1
    lost = "".join(itertools.takewhile(lambda letter: not _is_surrogate(letter), text[start:end]))
    if not lost:
        return _escaped(text[start]), start + 1
    end = start + len(lost)
    if (mark := _mark(lost[-1])) and (tail := _while_of(mark, text[end:])):
        # the whole exponent, though the encoding may have some of its digits: nm⁻² is nm^-2
        lost, end = lost + tail, end + len(tail)
    before, after = text[start - 1 : start], text[end : end + 1]
    return _spelled(before, lost, after), end


def _while_of(mark: str, text: str) -> str:
    return "".join(itertools.takewhile(lambda letter: _mark(letter) == mark, text))


def _is_surrogate(letter: str) -> bool:
    return "\ud800" <= letter <= "\udfff"


def _escaped(text: str) -> str:
    return text.encode("ascii", "backslashreplace").decode("ascii")


def _spelled(before: str, lost: str, after: str) -> str:
    """Return ASCII for lost characters between two others."""
    spelled, last = "", _mark(before)
    groups = [(kind, "".join(letters)) for kind, letters in itertools.groupby(lost, _kind)]
    for place, (kind, letters) in enumerate(groups):
        following = groups[place + 1][1] if place + 1 < len(groups) else after
        if kind in _MARKS:
            spelled += "" if last == kind else _MARKS[kind]
            spelled += "".join(_plain(letter) for letter in letters)
        elif kind == "word":
            words = [_word(letter) for letter in letters]
            if len(words) >= _GREEK_WORD:
                spelled += _escaped(letters)
            else:
                left = " " if (spelled or before)[-1:].isalnum() else ""
                right = " " if following[:1].isalpha() and not _mark(following[0]) else ""
                spelled += left + " ".join(words) + right
        else:
            spelled += "".join(_plain(letter) for letter in letters)
        last = kind
    return spelled


def _mark(letter: str) -> str:
    kind = _kind(letter) if letter else ""
    return kind if kind in _MARKS else ""


def _kind(letter: str) -> str:
    """Return the kind of a character: a mark, "word" for one that becomes a word, or ""."""
    decomposed = unicodedata.decomposition(letter).split()
    if decomposed and decomposed[0] in _MARKS:
        return decomposed[0]
    return "word" if _word(letter) else ""


def _word(letter: str) -> str:
    """Return the word for a character, "lambda" or "Sigma", or ""."""
    if letter in _SIGNS:
        return ""
    name = unicodedata.name(letter, "")
    for beginning, small in (("GREEK SMALL LETTER ", True), ("GREEK CAPITAL LETTER ", False)):
        letter_name = name.removeprefix(beginning).partition(" WITH ")[0]
        if name.startswith(beginning) and " " not in letter_name:
            word = "lambda" if letter_name == "LAMDA" else letter_name.lower()
            return word if small else word.capitalize()
    return _WORDS.get(letter, "")


def _plain(letter: str) -> str:
    """Return ASCII for one character: a sign, its base letter, or else its number."""
    if letter in _SIGNS:
        return _SIGNS[letter]
    parts = unicodedata.normalize("NFKD", letter)
    spelled = "".join(_SIGNS.get(part, part) for part in parts if not unicodedata.combining(part))
    return spelled if spelled.isascii() else _escaped(letter)


codecs.register_error(SPELLED, _spell)

"""Formulas of filters, whole and broken.

    python tests/fuzz/formulas.py 100000

tries that many of them, and prints how many were computed and how many refused.
"""

from __future__ import annotations

import random
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.formula import Formula

WHOLE = (
    "x < c",
    "a <= x <= b",
    "exp(-s*x)",
    "exp(-log(x/c)**2 / (2*w**2))",
    "exp(-t*x) * (x > 1e-8)",
    "where(x > 0, 1/x, 0) + maximum(0, 1 - x/c)",
    "not (x > c) and tanh(x) or sqrt(abs(sin(pi*x)))",
)
PIECES = (
    *("x", "t", "exp", "log", "where(", "(", ")", "+", "-", "*", "**", "/", "//", "%", "@", "<"),
    *("<=", "==", "!=", "and", "or", "not", "if", "else", "lambda", ":", ":=", "=", ",", ".", "\\"),
    *(
        "[",
        "]",
        "{",
        "}",
        "'",
        '"',
        "`",
        "#",
        "\n",
        "\0",
        "\t",
        "λ",
        "²",
        "０",
        "__class__",
        "import",
    ),
    *("__import__('os')", "open('/etc/passwd')", "().__class__", "x.real", "f''", "await", "yield"),
    *(
        "1e308",
        "1e400",
        "9" * 400,
        "9**9**9",
        "1j",
        "0x1",
        "0b2",
        "1_0",
        "True",
        "None",
        "...",
        "*x",
    ),
    *("(" * 120, "-" * 150, "x" * 300, "not " * 40, "**2" * 60),
)
EIGENVALUES = np.array([0.0, 1e-12, 1e-8, 1.0, 3.0, 1e12])


#: Audit events of what a formula must not do; to compile is how Python makes a tree of a line.
FORBIDDEN = ("open", "import", "exec", "os.", "subprocess.", "socket.", "ctypes.", "object.",
             "code.", "marshal.", "pickle.")  # fmt: skip
_seen: list[str] | None = None
_hooked = False


@contextmanager
def watched() -> Iterator[list[str]]:
    """Gather the forbidden events; a hook cannot be taken away, so there is one, which sleeps."""
    global _seen, _hooked
    outcome(0)  # what the parser itself loads is there
    if not _hooked:
        sys.addaudithook(_listen)
        _hooked = True
    _seen = []
    try:
        yield _seen
    finally:
        _seen = None


def _listen(event: str, _arguments: tuple[object, ...]) -> None:
    if _seen is not None and event.startswith(FORBIDDEN):
        _seen.append(event)


def formula(seed: int) -> str:
    """A formula of a number: a whole one with some pieces put in, taken out or exchanged."""
    rng = random.Random(seed)
    text = rng.choice(WHOLE)
    for _ in range(rng.choice((0, 1, 1, 2, 3, 8))):
        at, end = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        kept = text[end if rng.random() < 0.4 else at :]
        text = text[:at] + rng.choice((*PIECES, "")) + kept
    return text


def outcome(seed: int) -> str:
    """What becomes of a formula: values, or one sentence; any other exception is a fault."""
    text = formula(seed)
    rng = random.Random(-seed)
    try:
        parsed = Formula(text)
        values = {name: 10.0 ** rng.uniform(-12, 12) for name in parsed.parameters}
        assert set(parsed.powers) == set(values)
        found = parsed(EIGENVALUES, **values)
    except InputError as refused:
        sentence = str(refused)
        assert sentence.endswith("."), sentence
        assert "\n" not in sentence, sentence
        assert len(sentence) < 400, sentence
        return "refused"
    assert found.shape == EIGENVALUES.shape
    assert np.isfinite(found).all()
    assert (found >= 0.0).all()
    return "computed"


if __name__ == "__main__":
    with watched() as done:
        outcomes = Counter(outcome(seed) for seed in range(int(sys.argv[1])))
    sys.stdout.write(f"{dict(outcomes)}, forbidden events: {done}\n")

"""Random filter formulas, valid and broken."""

from __future__ import annotations

import ast
import random
import sys
import time
import warnings
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
#: Syntax nodes allowed in a computed formula; attributes and subscripts are not.
ALLOWED = (
    ast.Expression, ast.Constant, ast.Name, ast.Load, ast.UnaryOp, ast.unaryop, ast.BinOp,
    ast.operator, ast.BoolOp, ast.boolop, ast.Compare, ast.cmpop, ast.Call,
)  # fmt: skip
#: Maximum processor time of a formula (s).
PATIENCE = 1.0

#: Audit events that a formula must not cause; "compile" is allowed, as parsing causes it.
FORBIDDEN = ("open", "import", "exec", "os.", "subprocess.", "socket.", "ctypes.", "object.",
             "code.", "marshal.", "pickle.")  # fmt: skip
_seen: list[str] | None = None
_hooked = False


@contextmanager
def watched() -> Iterator[list[str]]:
    """Collect forbidden audit events; the hook is added only once, as Python cannot remove it."""
    global _seen, _hooked
    outcome(0)  # imports all that the parser needs
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
    """Return the formula of a seed: a valid one with pieces inserted, removed or replaced."""
    rng = random.Random(seed)
    text = rng.choice(WHOLE)
    for _ in range(rng.choice((0, 1, 1, 2, 3, 8))):
        at, end = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        kept = text[end if rng.random() < 0.4 else at :]
        text = text[:at] + rng.choice((*PIECES, "")) + kept
    return text


def outcome(seed: int) -> str:
    """Evaluate the formula of a seed; return "computed" or "refused".

    Any exception but a one-sentence `InputError`, a second of computing, or syntax beyond
    arithmetic is a fault and raises.
    """
    text = formula(seed)
    began = time.thread_time()
    came = _outcome(text, seed)
    taken = time.thread_time() - began
    assert taken < PATIENCE, f"{taken:.1f} s"
    return came


def _outcome(text: str, seed: int) -> str:
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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "1or x" is valid, with a warning
        tree = ast.parse(text.strip().replace("²", "**2"), mode="eval")
    beyond = [node for node in ast.walk(tree) if not isinstance(node, ALLOWED)]
    assert not beyond, beyond
    return "computed"

"""Each fault of the package has one of a small set of codes."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import meshmash_viewer

_FAULTS = ("InputError", "UnprovenError", "AmbiguousError")
PACKAGE = Path(meshmash_viewer.__file__).parent


def _first_arguments() -> Iterator[tuple[str, ast.expr]]:
    """Yield the place and the first argument of each `InputError`."""
    for path in sorted(PACKAGE.rglob("*.py")):
        where = path.relative_to(PACKAGE)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in _FAULTS:
                yield f"{where}:{node.lineno}", node.args[0]


def test_codes_are_literal_words_with_hyphens() -> None:
    wrong = {
        where: ast.unparse(code)
        for where, code in _first_arguments()
        if not isinstance(code, ast.Starred)  # a fault in a table
        and not ast.unparse(code).endswith(".code")  # that of another fault
        and not re.fullmatch("'[a-z]+(-[a-z]+)*'", ast.unparse(code))
    }
    assert wrong == {}

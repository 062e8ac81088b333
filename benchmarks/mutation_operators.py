"""Small faults that can be put into a module: where, and what the source reads with one of them.

Docstrings, messages, type annotations, decorators (with the signatures that kernels are compiled
for) and assertions are left alone: a fault there changes nothing that is computed.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

__all__ = ["Mutation", "mutations_of"]


@dataclass(frozen=True)
class Mutation:
    """One fault in one place.

    Parameters
    ----------
    path : str
        Of the module, below the root of the tree.
    line : int
    place : str
        Qualified name of the function it lies in; of a name, where it is assigned outside.
    kind : str
        Which operator made it.
    before, after : str
        What the source says there, and what it says then.
    start, stop : int
        Where, in bytes.
    """

    path: str
    line: int
    place: str
    kind: str
    before: str
    after: str
    start: int
    stop: int

    def applied(self, source: bytes) -> bytes:
        """The module with the fault in it."""
        return source[: self.start] + self.after.encode() + source[self.stop :]

    def __str__(self) -> str:
        before, after = (" ".join(text.split()) for text in (self.before, self.after))
        return f"{self.path}:{self.line} {self.place}: {before} → {after}"


_COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.Gt,
    ast.LtE: ast.GtE,
    ast.Gt: ast.Lt,
    ast.GtE: ast.LtE,
}
_ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
#: Functions of the same arguments that answer something else.
_SIBLINGS = {
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "argmin": "argmax",
    "argmax": "argmin",
    "any": "all",
    "all": "any",
    "floor": "ceil",
    "ceil": "floor",
    "zeros": "ones",
    "ones": "zeros",
    "zeros_like": "ones_like",
    "cumsum": "cumprod",
    "bisect_left": "bisect_right",
    "bisect_right": "bisect_left",
    "appendleft": "append",
    "startswith": "endswith",
}
#: Functions that may be forgotten around what they are given.
_WRAPPERS = {
    "sort",
    "sorted",
    "abs",
    "sqrt",
    "unique",
    "isfinite",
    "exp",
    "log",
    "reversed",
    "copy",
}
#: What a wrong argument could do harm with, outside the copy of the tree too.
_DANGEROUS = {"kill", "killpg", "rmtree", "unlink", "remove", "rmdir", "chmod", "terminate"}
#: What answers the same whichever of two arguments comes first.
_SYMMETRIC = frozenset(
    ("min", "max", "minimum", "maximum", "hypot", "logaddexp", "array_equal", "shares_memory")
)
#: Calls that are said, not done: what is in them is text for a reader.
_SPOKEN = {"Progress", "warn", "InputError", "debug", "info", "warning"}

Fault = tuple[str, ast.AST, str]


def mutations_of(path: str, source: bytes) -> list[Mutation]:
    """All faults that can be put into a module, in the order of its lines."""
    tree = ast.parse(source)
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    seen = set()
    for kind, place, node, after in _faults(tree):
        lines: Any = node
        start = starts[lines.lineno - 1] + lines.col_offset
        stop = starts[lines.end_lineno - 1] + lines.end_col_offset
        before = source[start:stop].decode()
        if (start, stop, after) in seen or before == after:
            continue
        seen.add((start, stop, after))
        found.append(Mutation(path, lines.lineno, place, kind, before, after, start, stop))
    return found


def _faults(tree: ast.Module) -> Iterator[tuple[str, str, ast.AST, str]]:
    def visit(node: ast.AST, place: str) -> Iterator[tuple[str, str, ast.AST, str]]:
        for kind, target, after in _faults_at(node):
            yield kind, place, target, after
        for child in _children(node):
            inner = place
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                inner = f"{place}.{child.name}" if place else child.name
            elif not place and isinstance(child, ast.Assign | ast.AnnAssign):
                targets = child.targets if isinstance(child, ast.Assign) else [child.target]
                inner = ", ".join(ast.unparse(target) for target in targets)
            yield from visit(child, inner)

    yield from visit(tree, "")


def _children(node: ast.AST) -> Iterator[ast.AST]:
    """The parts of a node in which a fault would change what is computed."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "bases", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or _is_idle(child):
                continue
            if isinstance(child, ast.arg) or (_is_any_length(child) and _is_shape(node)):
                continue
            yield child


def _is_idle(node: ast.AST) -> bool:
    """Whether a fault in here would be none, or one of words."""
    if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom):
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return True
    if isinstance(node, ast.Assign | ast.AnnAssign):
        text = ast.unparse(node)
        return text.startswith("__all__") or "TypeAlias" in text or "TypeVar" in text
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
        return True
    if isinstance(node, ast.FunctionDef):
        return any("overload" in ast.unparse(mark) for mark in node.decorator_list)
    if isinstance(node, ast.keyword):
        # What zip asserts, and what is text for a reader.
        return node.arg in ("strict", "message", "name", "help", "prefix", "stage", "indent")
    if isinstance(node, ast.Call):
        return _name_of(node.func) in _SPOKEN | _DANGEROUS
    return False


def _is_any_length(node: ast.AST) -> bool:
    return isinstance(node, ast.UnaryOp) and ast.unparse(node) == "-1"


def _is_shape(node: ast.AST) -> bool:
    """Whether -1 in here is the length that numpy finds by itself, as any other below 0 is."""
    return isinstance(node, ast.Call) and _name_of(node.func) == "reshape"


def _name_of(function: ast.expr) -> str:
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ""


def _with(node: Any, **changes: Any) -> str:
    other = copy.copy(node)
    for name, value in changes.items():
        setattr(other, name, value)
    text = ast.unparse(ast.fix_missing_locations(other))
    return f"({text})" if isinstance(other, ast.BinOp | ast.BoolOp | ast.Compare) else text


def _faults_at(node: ast.AST) -> Iterator[Fault]:
    make: Callable[[Any], Iterator[Fault]] | None = _MAKERS.get(type(node))
    if make is not None:
        yield from make(node)


def _of_comparison(node: ast.Compare) -> Iterator[Fault]:
    for i, operator in enumerate(node.ops):
        for table in (_COMPARISONS, _TURNED):
            if type(operator) in table:
                ops = [*node.ops[:i], table[type(operator)](), *node.ops[i + 1 :]]
                yield "comparison", node, _with(node, ops=ops)


def _of_constant(node: ast.Constant) -> Iterator[Fault]:
    value = node.value
    if isinstance(value, bool):
        yield "constant", node, str(not value)
    elif isinstance(value, int):
        yield "constant", node, str(value + 1)
    elif isinstance(value, float):
        if value == 0.0:
            yield "constant", node, "1.0"
        elif abs(value) < 1e-4:
            yield "constant", node, repr(value * 1e6)
        else:
            yield "constant", node, repr(value * 2.0)


def _of_arithmetic(node: ast.BinOp) -> Iterator[Fault]:
    if type(node.op) in _ARITHMETIC and not isinstance(node.left, ast.Constant | ast.JoinedStr):
        yield "arithmetic", node, _with(node, op=_ARITHMETIC[type(node.op)]())


def _of_logic(node: ast.BoolOp) -> Iterator[Fault]:
    yield "logic", node, _with(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    for i in range(len(node.values)):
        rest = [value for j, value in enumerate(node.values) if j != i]
        text = _with(node, values=rest) if len(rest) > 1 else f"({ast.unparse(rest[0])})"
        yield "part of a condition dropped", node, text


def _of_unary(node: ast.UnaryOp) -> Iterator[Fault]:
    yield "sign or negation dropped", node, f"({ast.unparse(node.operand)})"


def _of_if(node: ast.If) -> Iterator[Fault]:
    yield "guard removed", node.test, "False"
    if not isinstance(node.body[-1], ast.Raise):
        yield "guard always taken", node.test, "True"


def _of_choice(node: ast.IfExp) -> Iterator[Fault]:
    yield "choice", node.test, "False"
    yield "choice", node.test, "True"


def _of_expression(node: ast.Expr) -> Iterator[Fault]:
    if isinstance(node.value, ast.Call):
        yield "call dropped", node, "pass"


def _of_assignment(node: ast.Assign) -> Iterator[Fault]:
    if all(isinstance(target, ast.Attribute | ast.Subscript) for target in node.targets):
        yield "assignment dropped", node, "pass"


def _of_addition(node: ast.AugAssign) -> Iterator[Fault]:
    if type(node.op) in _ARITHMETIC:
        yield "arithmetic", node, _with(node, op=_ARITHMETIC[type(node.op)]())
    yield "assignment dropped", node, "pass"


def _of_slice(node: ast.Slice) -> Iterator[Fault]:
    for name in ("lower", "upper"):
        bound = getattr(node, name)
        if bound is not None:
            yield "slice", bound, f"({ast.unparse(bound)}) + 1"
    if node.lower is not None:
        yield "slice", node, _with(node, lower=None)
    if node.upper is not None:
        yield "slice", node, _with(node, upper=None)


def _of_call(node: ast.Call) -> Iterator[Fault]:
    name = _name_of(node.func)
    plain = not any(isinstance(arg, ast.Starred) for arg in node.args)
    if len(node.args) >= 2 and plain and name not in _SYMMETRIC:
        a, b, *rest = node.args
        if ast.unparse(a) != ast.unparse(b):
            yield "arguments swapped", node, _with(node, args=[b, a, *rest])
    if name in _WRAPPERS and len(node.args) == 1 and plain:
        yield "call around a value dropped", node, f"({ast.unparse(node.args[0])})"
    if name in ("copy",) and not node.args and isinstance(node.func, ast.Attribute):
        yield "call around a value dropped", node, f"({ast.unparse(node.func.value)})"
    if name in _SIBLINGS:
        other: Any = copy.copy(node.func)
        setattr(other, "attr" if isinstance(other, ast.Attribute) else "id", _SIBLINGS[name])
        yield "another function", node, _with(node, func=other)
    for i, keyword in enumerate(node.keywords):
        if keyword.arg is not None and not _is_idle(keyword):
            rest = [word for j, word in enumerate(node.keywords) if j != i]
            yield "keyword dropped", node, _with(node, keywords=rest)


def _of_attribute(node: ast.Attribute) -> Iterator[Fault]:
    if node.attr == "T" and isinstance(node.ctx, ast.Load):
        yield "not transposed", node, f"({ast.unparse(node.value)})"


def _of_return(node: ast.Return) -> Iterator[Fault]:
    if isinstance(node.value, ast.Tuple) and len(node.value.elts) == 2:
        a, b = node.value.elts
        yield "results swapped", node.value, f"({ast.unparse(b)}, {ast.unparse(a)})"


def _of_jump(node: ast.Break | ast.Continue) -> Iterator[Fault]:
    yield "jump dropped", node, "pass"


_MAKERS: dict[type[ast.AST], Callable[[Any], Iterator[Fault]]] = {
    ast.Compare: _of_comparison,
    ast.Constant: _of_constant,
    ast.BinOp: _of_arithmetic,
    ast.BoolOp: _of_logic,
    ast.UnaryOp: _of_unary,
    ast.If: _of_if,
    ast.IfExp: _of_choice,
    ast.Expr: _of_expression,
    ast.Assign: _of_assignment,
    ast.AugAssign: _of_addition,
    ast.Slice: _of_slice,
    ast.Call: _of_call,
    ast.Attribute: _of_attribute,
    ast.Return: _of_return,
    ast.Break: _of_jump,
    ast.Continue: _of_jump,
}

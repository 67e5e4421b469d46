"""Every fault that can be put into a Python source, found in its syntax tree. One-line places only."""

import ast
from collections.abc import Iterator

from mutants.mutant import Mutant

FLIPPED = {"Lt": ">=", "LtE": ">", "Gt": "<=", "GtE": "<", "Eq": "!=", "NotEq": "=="}
CLAMPS = ("max", "min", "maximum", "minimum", "clip")


def code_lines(source: str) -> set[int]:
    """Lines that hold code: no blanks, comments or docstrings."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.stmt) and not _docstring(node):
            lines.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.stmt) and _docstring(node):
            lines.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return {n for n in lines if (text := source.splitlines()[n - 1].strip()) and not text.startswith("#")}


def mutants(source: str) -> list[Mutant]:
    """All faults of a source."""
    tree = ast.parse(source)
    annotations = {id(inner) for node in ast.walk(tree) for part in _annotations(node) for inner in ast.walk(part)}
    found: list[Mutant] = []
    for node in ast.walk(tree):
        if id(node) not in annotations:
            found += [mutant for mutant in _of(node, source) if mutant is not None]
    return found


def _of(node: ast.AST, source: str) -> Iterator[Mutant | None]:
    match node:
        case ast.Constant(value=bool()):
            return
        case ast.Constant(value=int() | float() as value) if value:
            yield _instead(node, source, f"({ast.unparse(node)} * 2)", "constant * 2")
            yield _instead(node, source, f"({ast.unparse(node)} / 2)", "constant / 2")
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op).__name__ in FLIPPED:
            text = f"({ast.unparse(left)} {FLIPPED[type(op).__name__]} {ast.unparse(right)})"
            yield _instead(node, source, text, "comparison flipped")
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
            sign = "-" if isinstance(op, ast.Add) else "+"
            yield _instead(node, source, f"({ast.unparse(left)} {sign} ({ast.unparse(right)}))", "+ and - swapped")
        case ast.If(test=test) | ast.IfExp(test=test):
            yield _instead(test, source, "True", "branch forced")
            yield _instead(test, source, "False", "branch forced")
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise():
            yield _instead(node, source, "pass", "statement deleted")
        case ast.Return(value=ast.expr() as value) if not isinstance(value, ast.Constant):
            yield _instead(value, source, "None", "early return")
        case ast.Subscript(slice=ast.Constant(value=int() as value) as index):
            yield _instead(index, source, str(value + 1), "index + 1")
    if isinstance(node, ast.Call) and len(node.args) >= 2 and not node.keywords:
        called = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if called in CLAMPS:
            yield _instead(node, source, f"({ast.unparse(node.args[0])})", "clamp removed")


def _instead(node: ast.expr | ast.stmt, source: str, text: str, operator: str) -> Mutant | None:
    if node.end_lineno != node.lineno or node.end_col_offset is None:
        return None
    line = source.splitlines()[node.lineno - 1].encode()
    start, end = (len(line[:byte].decode()) for byte in (node.col_offset, node.end_col_offset))
    return Mutant(node.lineno, start, end, text, operator)


def _docstring(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _annotations(node: ast.AST) -> Iterator[ast.AST]:
    for name in ("annotation", "returns"):
        if isinstance(part := getattr(node, name, None), ast.AST):
            yield part

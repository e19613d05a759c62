"""Draws random single changes of the host's Python sources, and applies them.

A change alters what the program does. It alters no docstrings, texts, messages or type hints.

This module has its own rules for changes, because no maintained library fits. mutmut 3.8 has to import the
package itself, which an editable install prevents (mutmut then finds no test for any change), and it does not
draw changes at random. cosmic-ray 8.7 spends half of its changes on operators, most of them the `|` of type
hints. It does not change statements, returned values, min or max. It runs the same test command for all
changes, so it cannot begin with the tests that are nearest to a change.
"""

import ast
import random
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

HOST = Path("host/fltea")

ONE = (ast.Lt, ast.Gt, ast.Add, ast.Mult, ast.LShift, ast.And)
TWO = (ast.LtE, ast.GtE, ast.Sub, ast.Div, ast.RShift, ast.Or)
OTHER: dict[type[ast.AST], Any] = dict(zip(ONE, TWO, strict=True)) | dict(zip(TWO, ONE, strict=True))
OTHER |= {ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv, ast.BitAnd: ast.BitOr}
NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any"}
TELLS = {"problem", "report", "say", "tell", "warn", "warning", "info", "debug", "print", "echo", "help"}
"""Names of functions that show texts to people, such as `print`. The arguments of their calls are never
changed. Names such as `_warn` or `tell_user` count, too: only the first word matters.
"""


class Change(NamedTuple):
    """One change of a source file.

    `file`: path in the repository. `line`: line number, from 1. `start`, `end`: range of characters in the
    text that `new` replaces.
    """

    file: str
    line: int
    start: int
    end: int
    old: str
    new: str

    def applied_to(self, text: str) -> str:
        """Return a source text with the change in it."""
        return text[: self.start] + self.new + text[self.end :]

    def __str__(self) -> str:
        old, new = (" ".join(part.split()) for part in (self.old, self.new))
        return f"{self.file.removeprefix(f'{HOST}/')}:{self.line}: {old} → {new}"


def choose(root: Path, count: int, seed: int, below: str = "") -> list[Change]:
    """Draw `count` changes of the host's sources at `root`, on different lines; all lines are equally likely.

    `below`: use only files whose path below host/fltea begins with this text.
    """
    chance = random.Random(seed)
    lines: dict[tuple[str, int], list[Change]] = {}
    for path in sorted((root / HOST).rglob("*.py")):
        if str(path.relative_to(root / HOST)).startswith(below):
            for change in changes(str(path.relative_to(root)), path.read_text(encoding="utf-8")):
                lines.setdefault((change.file, change.line), []).append(change)
    return [chance.choice(lines[line]) for line in chance.sample(list(lines), min(count, len(lines)))]


def changes(file: str, text: str) -> Iterator[Change]:
    """Yield all possible changes of one source file."""
    rows = text.splitlines(keepends=True)
    starts = list(accumulate(map(len, rows), initial=0))
    for node in _acting(ast.parse(text)):
        (line, column), last = (node.lineno, node.col_offset), node.end_lineno or node.lineno
        # Column numbers of ast count bytes, not characters.
        start = starts[line - 1] + len(rows[line - 1].encode()[:column].decode())
        end = starts[last - 1] + len(rows[last - 1].encode()[: node.end_col_offset].decode())
        for other in _others(node):
            new = ast.unparse(ast.fix_missing_locations(other))
            is_open = isinstance(other, ast.Compare | ast.BoolOp | ast.UnaryOp | ast.BinOp | ast.IfExp)
            yield Change(file, line, start, end, text[start:end], f"({new})" if is_open else new)


def _acting(node: ast.AST) -> Iterator[ast.expr | ast.stmt]:
    """Yield the expressions and statements of `node` that may be changed, the outermost first.

    Changing one of these expressions or statements alters what the program does.
    """
    if isinstance(node, ast.expr | ast.stmt):
        yield node
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list", "exc") and not _speaks(node):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _acting(child)


def _speaks(node: ast.AST) -> bool:
    """Return whether no change may be made inside `node`.

    Such nodes are texts for people, declarations of options, imports for type hints, and assertions.
    """
    if isinstance(node, ast.Call):
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        return name.strip("_").split("_")[0] in TELLS or name in ("Option", "Argument", "TypeVar")
    if isinstance(node, ast.If):
        return "TYPE_CHECKING" in ast.unparse(node.test)
    return isinstance(node, ast.JoinedStr | ast.Assert)


def _others(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what can replace `node`, such as `a <= b` for `a < b`."""
    match node:
        case ast.Compare(left, [operator, *more], right):
            if type(operator) in OTHER:
                yield ast.Compare(left, [OTHER[type(operator)](), *more], right)
            yield ast.UnaryOp(ast.Not(), node)
        case ast.BoolOp(operator, values):
            yield ast.BoolOp(OTHER[type(operator)](), values)
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield operand
        case ast.BinOp(left, operator, right) if type(operator) in OTHER:
            if not any(isinstance(n, ast.JoinedStr | ast.List) or _is_text(n) for n in (left, right)):
                yield ast.BinOp(left, OTHER[type(operator)](), right)
        case ast.AugAssign(target, operator, value) if type(operator) in OTHER:
            yield from (ast.AugAssign(target, OTHER[type(operator)](), value), ast.Pass())
        case ast.Constant(bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(int(value) | float(value)):
            yield from (ast.Constant(value + 1), ast.Constant(value - 1))
        case ast.Call(ast.Name(name), arguments, keywords) if name in NAMES:
            yield ast.Call(ast.Name(NAMES[name]), arguments, keywords)
        case ast.Call(ast.Attribute(value, name), arguments, keywords) if name in NAMES:
            yield ast.Call(ast.Attribute(value, NAMES[name]), arguments, keywords)
        case ast.IfExp(test, body, orelse):
            yield ast.IfExp(test, orelse, body)
        case ast.Return(ast.expr() as value) if not isinstance(value, ast.Constant):
            yield ast.Return(ast.Constant(None))
        case ast.Expr(ast.Call() as call) if not _speaks(call):
            yield ast.Pass()
        case ast.Assign([ast.Attribute() | ast.Subscript()]) | ast.Raise() | ast.Continue() | ast.Break():
            yield ast.Pass()


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)

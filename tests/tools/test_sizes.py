"""Functions, classes and files stay so small that a reader can follow them.

A function has at most 60 lines, a file at most 400, and a class at most 12 attributes. A class with more
states its reason in a comment directly above it:

    # Why more than 12 attributes: each is a field of the published record.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache, lru_cache
from typing import NamedTuple

import pytest

from tests.rig.host_support import ROOT

LONGEST_FUNCTION = 60
MOST_ATTRIBUTES = 12
LONGEST_FILE = 400
REASON = re.compile(r"# Why more than 12 attributes: (\S.{15,})")
GENERATED = {"host/fltea/wire/layout.py", "firmware/core/messages.h"}
"""Files that `make gen` writes: their source is read by people instead (protocol/messages.toml)."""

PYTHON = [
    path
    for top in ("host", "tools", "tests")
    for path in sorted((ROOT / top).rglob("*.py"))
    if str(path.relative_to(ROOT)) not in GENERATED
]
CXX = [
    path
    for top in ("host/native", "firmware", "tests", "tools/due_emulator")
    for path in sorted((ROOT / top).rglob("*.[ch]*"))
    if path.suffix in (".cpp", ".hpp", ".h") and str(path.relative_to(ROOT)) not in GENERATED
]


@lru_cache(maxsize=1)
def _parsed(text: str) -> ast.Module:
    return ast.parse(text)


def functions(text: str) -> Iterator[tuple[str, int]]:
    """Yield the name and the number of lines of each function in Python code, from `def` on."""
    for node in ast.walk(_parsed(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, (node.end_lineno or node.lineno) - node.lineno + 1


def cxx_functions(text: str) -> Iterator[tuple[str, int]]:
    """Yield the name and the number of lines of each function in C++ code.

    The code is formatted by clang-format: a function's head ends in `{`, and the next `}` that is indented
    like the head's first line ends the function. If the head has several lines, only the last of them is
    counted, and only there the name is looked for. If there is no name, the beginning of this line is
    yielded.
    """
    head, begin = "", -1
    indent: str | None = None
    lines = text.splitlines()
    for number, line in enumerate(lines):
        if indent is None:
            found = re.match(
                r"(\s*)(?!if|for|while|switch|else|do\b|namespace|class|struct|enum|union|extern|[}#/])\S.*\{$",
                line,
            )
            if found and ")" in line:
                indent, head, begin = _indent_of_head(lines, number), line.strip(), number
        elif re.match(rf"{indent}}}", line):
            named = re.search(r"(\w+)\(", head)
            yield named.group(1) if named else head[:30], number - begin + 1
            indent = None


def _indent_of_head(lines: list[str], last: int) -> str:
    """Return the indentation of the first line of a head (the lines of a function or class before its body).

    `last`: index of the last line of the head.
    """
    first, closed = last, _closed(lines[last])
    while closed > 0 and first > 0:
        first -= 1
        closed += _closed(lines[first])
    return lines[first][: len(lines[first]) - len(lines[first].lstrip())]


def _closed(line: str) -> int:
    """Return how many more parentheses a line closes than it opens, apart from those in strings."""
    code = re.sub(r'"(\\.|[^"\\])*"', "", line)
    return code.count(")") - code.count("(")


def classes(text: str) -> Iterator[tuple[str, int, str]]:
    """Yield the name of each class, the number of its attributes, and the comment directly above it.

    Attributes are the declared fields, except class variables, and all that methods set on `self`.
    """
    lines = text.splitlines()
    for node in ast.walk(_parsed(text)) if "class " in text else ():
        if isinstance(node, ast.ClassDef):
            first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
            fields = {
                one.target.id
                for one in node.body
                if isinstance(one, ast.AnnAssign)
                and isinstance(one.target, ast.Name)
                and "ClassVar" not in ast.unparse(one.annotation)
            }
            yield node.name, len(fields | _set_on_self(node)), lines[first - 2].strip() if first > 1 else ""


class Measured(NamedTuple):
    """The sizes of one file.

    Attributes:
        lines: number of lines.
        functions: name of each function, and its number of lines.
        classes: name of each class, the number of its attributes, and the comment above it.
    """

    lines: int
    functions: list[tuple[str, int]]
    classes: list[tuple[str, int, str]]


@cache
def measured() -> dict[str, Measured]:
    """Return the sizes of all files by their names in the repository."""
    found = {}
    for path in PYTHON + CXX:
        text = path.read_text(encoding="utf-8")
        lines = len(text.splitlines())
        name = str(path.relative_to(ROOT))
        if path.suffix == ".py":
            found[name] = Measured(lines, list(functions(text)), list(classes(text)))
        else:
            found[name] = Measured(lines, list(cxx_functions(text)), [])
    return found


def _set_on_self(node: ast.ClassDef) -> set[str]:
    methods = [one for one in node.body if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)]
    return {
        one.attr
        for method in methods
        for one in ast.walk(method)
        if isinstance(one, ast.Attribute)
        and isinstance(one.ctx, ast.Store)
        and isinstance(one.value, ast.Name)
        and one.value.id == "self"
    }


def test_no_function_is_longer_than_a_page() -> None:
    long = [
        f"{file}: {name}: {lines} lines"
        for file, sizes in measured().items()
        for name, lines in sizes.functions
        if lines > LONGEST_FUNCTION
    ]
    assert long == []


def test_a_class_with_many_attributes_states_why() -> None:
    wrong = []
    for file, sizes in measured().items():
        for name, count, above in sizes.classes:
            has_reason = bool(REASON.fullmatch(above))
            if count > MOST_ATTRIBUTES and not has_reason:
                wrong.append(f"{file}: {name}: {count} attributes and no reason above it")
            if count <= MOST_ATTRIBUTES and has_reason:
                wrong.append(f"{file}: {name}: {count} attributes need no reason")
    assert wrong == []


def test_no_file_is_longer_than_can_be_read_at_a_time() -> None:
    long = {file: sizes.lines for file, sizes in measured().items() if sizes.lines > LONGEST_FILE}
    assert long == {}


@pytest.mark.parametrize("lines", [59, 60, 61])
def test_functions_are_measured_from_head_to_end(lines: int) -> None:
    body = "\n".join(["    x = 1"] * (lines - 1))
    assert list(functions(f"@one\ndef a():\n{body}\n\n\ndef b(): ...\n")) == [("a", lines), ("b", 1)]
    body = "\n".join(["  if (x) {", "    x = 1;", "  }", *["  x = 1;"] * (lines - 5)])
    method = "struct S {\n  int b() const {\n    return 1;\n  }\n};"
    code = f"namespace n {{\nint a(int x) {{\n{body}\n}}\n{method}\n}}\n"
    assert list(cxx_functions(code)) == [("a", lines), ("b", 3)]


def test_a_function_whose_head_has_several_lines_ends_at_the_indentation_of_the_first() -> None:
    case = 'TEST_CASE(\n    "a (b") {\n  if (x) {\n    x = 1;\n  }\n}\n'
    code = f"{case}int b(int x,\n      int y) {{\n  for (;;) {{\n      }}\n  x = 1;\n}}\n"
    assert [count for _, count in cxx_functions(code)] == [5, 5]


def test_attributes_are_fields_and_what_methods_set() -> None:
    code = """
# Why more than 12 attributes: it is an example.
@dataclass
class A:
    x: int
    y: ClassVar[int] = 1
    def set(self, other):
        self.z = self.x
        self.z += 1
        other.w = self.v
        self.u.t = 2
"""
    assert list(classes(code)) == [("A", 2, "# Why more than 12 attributes: it is an example.")]

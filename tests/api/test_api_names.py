"""Every public name of the API is explained where it is defined, and named in notebook.md."""

import ast
import importlib
import inspect
import itertools
import re
from types import ModuleType
from typing import Any

import fltea
import pytest
from fltea.api.live import BiasStep

from tests.rig.host_support import ROOT

PAGE = (ROOT / "host/docs/cookbook/notebook.md").read_text(encoding="utf-8")
CLASSES = (
    fltea.Identified,
    fltea.Report,
    fltea.Quantity,
    fltea.Drawing,
    fltea.Recording,
    fltea.Live,
    fltea.LiveReport,
    fltea.Corrected,
    fltea.Simulated,
    BiasStep,
)
OF_MAPPINGS = {"get", "items", "keys", "values"}
OF_TUPLES = {"count", "index"}
MADE_BY_INIT = {
    fltea.Recording: {"name", "counts", "data_checks", "reading"},
    fltea.Live: {"rate_hz", "axes", "unit", "steps"},
    fltea.LiveReport: {"samples", "rate_hz"},
}
"""For each class, the names of attributes that `__init__` makes. `dir()` of the class does not show them."""


def public(kind: type) -> set[str]:
    found = {name for name in dir(kind) if not name.startswith("_")} | MADE_BY_INIT.get(kind, set())
    return found - OF_MAPPINGS - (OF_TUPLES if issubclass(kind, tuple) else set())


def explained(kind: type) -> set[str]:
    """Return those names of a class that have a docstring.

    A field's docstring is the string after the field.
    """
    found = set()
    for one in kind.__mro__:
        if not one.__module__.startswith("fltea"):
            continue
        tree = ast.parse(inspect.getsource(importlib.import_module(one.__module__)))
        (found_class,) = (
            node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == one.__name__
        )
        found |= {node.name for node in found_class.body if _is_explained(node)}
        for body in (found_class.body, *(node.body for node in found_class.body if hasattr(node, "body"))):
            found |= _fields(body)
    return found


def _is_explained(node: ast.stmt) -> bool:
    return isinstance(node, ast.FunctionDef) and ast.get_docstring(node) is not None


def _fields(body: list[Any]) -> set[str]:
    found = set()
    for node, after in itertools.pairwise(body):
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            targets = [node.target] if isinstance(node, ast.AnnAssign) else getattr(node, "targets", [])
            found |= {
                one.attr if isinstance(one, ast.Attribute) else getattr(one, "id", "") for one in targets
            }
    return found


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_every_public_name_of_an_object_is_explained_and_named(kind: type) -> None:
    assert inspect.getdoc(kind)
    names = public(kind)
    assert names - explained(kind) == set()
    section = PAGE.split(f"\n| `{kind.__name__}` | ")[1].split("\n")[0]
    assert set(re.findall(r"`(\w+)", section)) == names


def test_the_module_shows_what_is_public_and_nothing_else() -> None:
    assert {name for name in dir(fltea) if not name.startswith("_")} == set(fltea.__all__) - {"__version__"}
    for name in dir(fltea):
        one = getattr(fltea, name)
        assert name == "__version__" or (inspect.getdoc(one) and not isinstance(one, ModuleType))
        assert f"`{name}`" in PAGE or f"fltea.{name}" in PAGE, name

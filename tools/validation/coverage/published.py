"""List every interval and every standard deviation that the program publishes, as its classes declare them.

The program reads the source text of the classes. It looks for fields whose type is an interval, and for
fields whose name ends like that of a standard deviation. A test fails if such a field has no row in
`FIGURES`. It also fails if a parameter of a part of a noise has no row here.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import fltea
from fltea.noise.parts import CODES

OF_INTERVALS = re.compile(r"\b(Interval|Coefficient)\b")
"""Finds, in the type of a field, a class that holds a figure with its 95 % interval (the fields `low` and
`high`).
"""
OF_DEVIATIONS = re.compile(r"_std$")
"""Matches names of fields that are standard deviations: they end in `_std`."""


class Field(NamedTuple):
    """A field of a published class."""

    name: str
    owner: str
    """Module and class of the field."""


class Elsewhere(NamedTuple):
    """A published figure that this measurement leaves out, with the reason."""

    why: str


FIGURES: dict[str, str | Elsewhere] = {
    "alpha": "α of an order",
    "f": "f of an order",
    "F": "F of an order",
    "s2": "s2 of an order",
    "R": "R beside an order",
    "N": "N",
    "density": "N",
    "K": "K of walk",
    "Q": "Q of quantisation",
    "sigma": "sigma of relaxation",
    "tau_s": "tau_s of relaxation",
    "values": "R of white",
    "drift_rate": "drift rate",
    "B": Elsewhere("B of 1/f noise in the spectrum, or of the Allan curve, whose band is measured"),
    "found": Elsewhere("N, K, B or bias of one of several recordings: these figures have rows of their own"),
    "ratio": Elsewhere("ratio of the figures of two recordings: each figure has a row of its own"),
    "difference": Elsewhere("difference of the biases of two recordings: the bias has a row of its own"),
    "bias_std": "bias over 10 s, 1.96 σ",
    "heading_std": "heading after 10 s, 1.96 σ",
    "tracker_bias_std": Elsewhere("the board's tracker works like the host's, which `states` measures"),
    "tracker_state_std": Elsewhere("the board's tracker works like the host's, which `states` measures"),
    "state_std": Elsewhere("the bias is a mean of the tracker's state: `states` measures the bias"),
    "rate_std": Elsewhere("σ of the tracker's bias and of the noise about it: `states` measures the bias"),
    "size_std": Elsewhere("σ of a step of the bias: the part `bias` measures steps"),
    "alpha_std": Elsewhere(
        "σ of the filters, no interval of 95 %: measured by `evaluate`; for the board, by `device`"
    ),
    "f_std": Elsewhere("σ of the filters, no interval of 95 %: measured by `evaluate`"),
    "F_std": Elsewhere("σ of the filters, no interval of 95 %: measured by `evaluate`"),
    "innovation_std": Elsewhere("a standard deviation of samples, not an uncertainty"),
    "slope_std": Elsewhere("the doctor's uncertainty of a clock's rate, which no record has"),
    "noise_std": Elsewhere("a standard deviation of samples, not an uncertainty"),
}
"""For each name that a field of a published class has: what is measured for it, or why nothing is measured.
Fields of the same name mean the same figure in every class.
"""
ALLAN = "Allan deviation"


def of_part(tag: str, parameter: str) -> str:
    """Return the name of a parameter of a noise's part, such as "tau_s of relaxation"."""
    return f"{parameter} of {tag}"


def parameters() -> list[str]:
    """Return the names of all parameters, of all kinds of parts, for which a fit has intervals."""
    return [
        of_part(str(kind.__struct_config__.tag), name)
        for kind in CODES
        for name in kind.__struct_fields__
        if name != "samples"  # the parameter `samples` is a whole number, for which there is no interval
    ]


def fields() -> Iterator[Field]:
    """Yield all fields that are published with an interval or a standard deviation."""
    root = Path(fltea.__file__).parent
    for file in sorted(root.rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if not (OF_INTERVALS.search(text) or "_std" in text):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ClassDef):
                for name, kind in _declared(node):
                    if OF_INTERVALS.search(kind) or OF_DEVIATIONS.search(name):
                        yield Field(name, f"{file.relative_to(root).with_suffix('')}.{node.name}")


def _declared(node: ast.ClassDef) -> Iterator[tuple[str, str]]:
    for one in node.body:
        if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name):
            yield one.target.id, ast.unparse(one.annotation)

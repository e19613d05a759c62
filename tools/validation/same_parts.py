"""Puts the parts of a fitted noise and of the true noise in the same order, to compare them."""

from collections.abc import Sequence

from fltea.noise.parts import Part
from fltea.spectrum.estimated import Estimated


def tag(part: Part) -> str:
    """Return the name of a part's kind, as in `Estimated.part`."""
    return str(part.__struct_config__.tag)


def in_order(truth: Sequence[Part]) -> list[Part]:
    """Return the true parts sorted by kind.

    The fastest relaxation (first-order Gauss-Markov process) comes before the slower ones.
    """
    return sorted(truth, key=lambda part: (tag(part), getattr(part, "tau_s", 0.0)))


def found_in_order(found: Sequence[Estimated]) -> list[Estimated]:
    """Return the parts of a fit in the order of `in_order`. White noise is left out if it may be 0."""
    some = [one for one in found if one.part != "white" or one.values["R"].low not in (None, 0.0)]
    return sorted(some, key=lambda one: (one.part, one.value("tau_s") if "tau_s" in one.values else 0.0))

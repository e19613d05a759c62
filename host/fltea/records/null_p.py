"""How a person reads `null_p`, what the running test of whiteness says (fltea.estimator.running_null)."""

from fltea import _native

FEWEST: int = _native.NULL_FEWEST
"""Samples before which nothing is said."""

LEVEL: float = _native.NULL_LEVEL
"""Below it, white noise is rejected."""


def p_text(p: float) -> str:
    """A p-value in words."""
    if p < LEVEL:
        return f"p < {LEVEL:g}"
    return f"p = {p:.2f}" if p >= 0.1 else f"p = {p:.3f}"

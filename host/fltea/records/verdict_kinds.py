"""The kinds of verdict: each word, and what the program has to know about it in more than one place.

A new kind needs its word in `VerdictKind` and a row in `VERDICT_KINDS`. host/CHANGING.md lists all other
places, and which test reports each one that is missing.
"""

from typing import Literal, NamedTuple

VerdictKind = Literal[
    "white",
    "drift",
    "line",
    "resonance",
    "line or resonance",
    "comb",
    "low-pass",
    "high-pass",
    "notch",
    "relaxations",
    "fractional",
    "fractional or relaxations",
    "anti-persistent",
    "undecided",
    "not stationary",
    "constant",
    "too few samples",
]
"""Kind of the noise in a word or two; host/docs/guide/verdict.md says what each means."""


class KindOfVerdict(NamedTuple):
    """What the program has to know about one kind of verdict."""

    head: str
    """Heading of the axis on the live page."""
    order: Literal["no", "perhaps", "yes"] = "no"
    """Whether the noise has an order α. α is shown unless it has none."""
    says_nothing: bool = False
    """Whether the verdict says nothing about the noise, since nothing was fitted."""


VERDICT_KINDS: dict[VerdictKind, KindOfVerdict] = {
    "white": KindOfVerdict("White noise: order undefined"),
    "drift": KindOfVerdict("Drift"),
    "line": KindOfVerdict("Line in white noise"),
    "resonance": KindOfVerdict("Resonance"),
    "line or resonance": KindOfVerdict("Line or narrow resonance"),
    "comb": KindOfVerdict("Something happens at equal intervals"),
    "low-pass": KindOfVerdict("White noise through a low-pass"),
    "high-pass": KindOfVerdict("White noise through a high-pass"),
    "notch": KindOfVerdict("White noise through a notch"),
    "relaxations": KindOfVerdict("Relaxations (Gauss-Markov)"),
    "fractional": KindOfVerdict("Fractional", order="yes"),
    "fractional or relaxations": KindOfVerdict("Fractional, or relaxations", order="perhaps"),
    "anti-persistent": KindOfVerdict("Anti-persistent"),
    "undecided": KindOfVerdict("Undecided", order="perhaps"),
    "not stationary": KindOfVerdict("Not stationary"),
    "constant": KindOfVerdict("Constant", says_nothing=True),
    "too few samples": KindOfVerdict("Still too short", says_nothing=True),
}

WITH_ORDER = tuple(kind for kind, row in VERDICT_KINDS.items() if row.order != "no")
"""Verdicts with which an order α is shown. All other verdicts exclude an order."""

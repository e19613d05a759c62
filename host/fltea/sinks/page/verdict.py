"""What may be said of an estimate (pure): beside what white noise gives, and by the running test.

The first is a comparison of α and f, with nearly no power; the second a test of the samples.
"""

from typing import Literal, NamedTuple

from fltea.records.null_p import FEWEST, LEVEL, p_text
from fltea.records.records import WhiteBandStats, Whiteness

Side = Literal["within", "outside", "unknown"]

RESUMED = " The runs began only when the estimator was resumed, so the band is too wide at first."
HEARD_LATE = " The device estimated before it was heard and the runs began, so the band is too wide at first."

UNKNOWN = (
    "What white noise would give is not known: too few samples yet, a constant axis, or estimator.white_band "
    "is off. So nothing can be said."
)

SHORT: dict[Side, str] = {
    "within": "Within what white noise gives: these figures say nothing.",
    "outside": "Outside what white noise gives: a hint, not a test.",
    "unknown": "Nothing can be said yet.",
}


class Verdict(NamedTuple):
    """Where an estimate stands, and what that means in a sentence or two; `short` for beneath a figure."""

    side: Side
    text: str

    @property
    def short(self) -> str:
        """The same in a few words."""
        return SHORT[self.side]


def judge(alpha: float | None, f: float | None, white: WhiteBandStats | None, *, older: str = "") -> Verdict:
    """Compare an estimate with the 5 to 95 % of white noise after as many samples.

    white: None where it is not known. older: what to say of runs that began late.
    """
    if alpha is None or f is None:
        return Verdict("unknown", "No valid estimate.")
    if white is None:
        return Verdict("unknown", UNKNOWN)
    places = {
        "α": white.alpha[0] <= alpha <= white.alpha[2],
        "f": white.f[0] <= f <= white.f[2],
    }
    outside = [name for name, within in places.items() if not within]
    if not outside:
        text = (
            "α and f are within what white noise of this power gives after as many samples: they say nothing."
        )
        return Verdict("within", text + older)
    subject = "α and f are" if len(outside) == 2 else f"{outside[0]} is"
    text = (
        f"{subject} outside what white noise of this power gives after as many samples: a hint, not a test."
    )
    return Verdict("outside", text + older)


def judge_whiteness(whiteness: Whiteness | None, p: float | None) -> str:
    """What the running test says of the samples, in a sentence."""
    if p is None:
        return f"Order unknown: the test of whiteness needs {FEWEST:,} samples that are not all the same."
    if whiteness == "not rejected":
        return f"Order undefined: white noise is not rejected ({p_text(p)}, limit {LEVEL:g})."
    return f"Not white ({p_text(p)}): record it and run fltea identify."

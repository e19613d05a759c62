"""Determines the right verdicts on a noise from its true spectrum alone.

There are three outcomes: right, accepted and wrong. A verdict is right if it names the truth, or if it names
a model whose spectrum the record cannot distinguish from the truth. A weaker verdict is accepted if the
record cannot decide. A verdict is also accepted if chance may well lead to it. The reason is kept with each
accepted verdict. All other verdicts are wrong.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array
from fltea.records.fit import VerdictKind

from tools.validation.gallery import contrast
from tools.validation.gallery.contrast import Bins
from tools.validation.gallery.filters import Through
from tools.validation.gallery.noise import Line, Noise
from tools.validation.gallery.parts import Differenced, Notched, Resonance, White
from tools.validation.gallery.periodic import right_periodic

SAME = 6.0
"""A record tells two spectra apart only if their 2 log L (L: likelihood) should differ by this or more."""
UNSEEN = 2.0
"""A record tells a spectrum from white noise only if their 2 log L should differ by this or more."""
LUCK = 2.0
"""Chance may change a difference of 2 log L (L: likelihood) by LUCK standard deviations. One standard
deviation is 2 √(expected difference).
"""
MORE = 13.0
"""A sum of parts without an order has more parameters than an order. By chance alone, this may make its
2 log L (L: likelihood) larger by this much.
"""
WITHOUT_ORDER = "a sum of relaxations, a walk and a rise"
SLOW_ORDINATES = 9
DRIFTS = 1.5
"""A noise drifts if its mean density at the SLOW_ORDINATES lowest frequencies of the periodogram is more than
this many times its mean density at the frequencies that are fitted.
"""
SLOW_SEEN, RAMP_SEEN = 3.5, 30.0
"""Limits above which a drift must be found, both in multiples of the white noise's power.

SLOW_SEEN: for the mean power at the SLOW_ORDINATES lowest frequencies of the periodogram. White noise exceeds
this limit with the probability 1e-5. RAMP_SEEN: for the power of a fitted cubic polynomial. A drift below
this limit does not matter in practice.
"""
PEAK_ALARM = 3e-3
NARROW, FEW_ORDINATES = 2.0, 10.0
"""Two limits for the width of a peak [ordinates]. A peak that is narrower than the first limit is a spectral
line. A peak that is narrower than the second limit may be taken for a line.
"""
HIGH_CORNER = 0.2 * math.pi
"""If the corner of a high-pass is above this frequency [rad per sample], the spectrum seems only to rise."""
INSIDE_THE_FILTER = 0.5
"""The noise before a filter is visible where the power gain of the filter is at least this value."""

EITHER: VerdictKind = "fractional or relaxations"


class Right(NamedTuple):
    """The right and the accepted verdicts on a noise, at one sample rate and length."""

    right: frozenset[VerdictKind]
    accepted: dict[VerdictKind, str]
    """Accepted verdicts, each with the reason."""

    def outcome(self, kind: VerdictKind) -> str:
        """Return the outcome of the verdict `kind`: right, cannot be told (only accepted), or wrong."""
        if kind in self.right:
            return "right"
        return "cannot be told" if kind in self.accepted else "wrong"


class _Notes:
    def __init__(self) -> None:
        self.right: set[VerdictKind] = set()
        self.accepted: dict[VerdictKind, str] = {}

    def may(self, kind: VerdictKind, short: float, what: str, more: float = 0.0) -> None:
        """Note the verdict `kind` as right, as accepted, or not at all (then it is wrong).

        `short`: how much smaller the expected 2 log L (L: likelihood) is for the verdict's model than for the
        truth. Below SAME, the verdict is right. It is accepted if chance may reduce `short` to `SAME + more`.
        """
        if short < SAME:
            self.right.add(kind)
        elif not distinguishable(short, SAME + more):
            self.accepted[kind] = f"{what} is only {short:.0f} behind in expected 2 log L"


def distinguishable(short: float, needed: float) -> bool:
    """Return whether a difference of 2 log L exceeds `needed` even with bad luck.

    `short`: expected difference. Bad luck makes it smaller by LUCK standard deviations.
    """
    return short - LUCK * 2 * math.sqrt(max(short, 0.0)) > needed


def right_verdicts(noise: Noise, rate_hz: float, n: int) -> Right:
    """Return which verdicts are right, and which are accepted, on a record of `n` samples of a noise."""
    bins = contrast.bins_of(lambda lam: noise.spectrum(lam, rate_hz), n, _peaks(noise))
    notes = _Notes()
    short = contrast.white(bins)
    seen = distinguishable(short, 3 * math.log(bins.weight.sum()))
    if not seen:
        _nearly_white(notes, noise, bins, rate_hz, n, short)
    if noise.truth != "white" and short < UNSEEN:
        # At the fitted frequencies the noise looks white. The verdict that names the true model is right all
        # the same. Other models may look white there, too, but verdicts that name them are wrong.
        notes.right.add(_RULES[noise.truth][0])
    elif noise.truth != "white":
        notes.right.add(_RULES[noise.truth][0])
        _RULES[noise.truth][1](notes, noise, bins, rate_hz, n)
        if bins.truth[-1] > bins.truth.min():  # aliasing may make the spectrum rise near half the sample rate
            notes.may("anti-persistent", contrast.rising(bins), "a power that rises with frequency")
    if noise.drift is not None and (not seen or noise.truth == "white"):
        notes.right = {"drift"}
        notes.accepted.pop("undecided", None)
        power = noise.drift.size**2 * n / 12 / float(np.average(bins.truth, weights=bins.weight))
        if power - LUCK * 2 * math.sqrt(power) < RAMP_SEEN:
            notes.accepted["white"] = f"the drift has only {power:.0f} times the power of white noise there"
    if noise.lines:
        _lines(notes, noise, rate_hz, n)
    if noise.changes:
        _changes(notes, n)
    if noise.swings:
        _swings(notes, noise.swings, n)
    if noise.accepted is not None and n < noise.accepted.samples:
        notes.accepted[noise.accepted.kind] = noise.accepted.reason
    accepted = {kind: why for kind, why in notes.accepted.items() if kind not in notes.right}
    return Right(frozenset(notes.right), accepted)


def _peaks(noise: Noise) -> list[tuple[float, float]]:
    """Return the frequency and the width of each peak and notch."""
    found = [part for part in noise.parts if isinstance(part, Resonance | Notched)]
    return [(2 * math.pi * one.share, 2 * math.pi * one.share / one.q) for one in found]


def _nearly_white(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int, short: float) -> None:
    """Note the right verdicts on noise that looks white at the fitted frequencies."""
    slow = 2 * np.pi * np.arange(1, SLOW_ORDINATES + 1) / n
    level = float(np.average(bins.truth, weights=bins.weight))
    each = noise.spectrum(slow, rate_hz) / level
    ratio = float(each.mean())
    seen = ratio - LUCK * float(np.sqrt(each @ each)) / SLOW_ORDINATES > SLOW_SEEN
    why = f"white noise is only {short:.1f} behind in expected 2 log L"
    notes.accepted["undecided"] = (
        why if short >= UNSEEN else "the null test rejects one white record in twenty"
    )
    if ratio > DRIFTS:
        notes.right.add("drift")
    if short < UNSEEN and ratio <= DRIFTS:
        notes.right.add("white")
    elif not seen:
        notes.accepted["white"] = why


def _relaxations(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    inner = [one for part in noise.parts if isinstance(part, Through) for one in part.inner]
    slow = len(inner) + sum(not isinstance(part, White | Differenced | Through) for part in noise.parts)
    several = 3.0 * max(2 * min(slow, 6) - 3, 0)
    rises = bins.truth[-1] > bins.truth.min()
    order = contrast.order_and_rise if rises else contrast.order
    walk = contrast.walk_and_rise if rises else contrast.walk
    notes.may(EITHER, order(bins), "an order between 0.15 and 0.85", several)
    notes.may("drift", walk(bins), "a random walk")
    notes.may("low-pass", contrast.low_pass(bins), "a low-pass")
    if "drift" not in notes.right:
        with_one = contrast.walk_and_relaxation(bins)
        if contrast.one_relaxation(bins) > with_one + SAME:
            notes.may("drift", with_one, "a random walk and one relaxation")


def _order(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    nearest = contrast.order(bins)
    if nearest > SAME:
        notes.accepted["undecided"] = f"no model has this spectrum; the nearest order is {nearest:.0f} behind"
    notes.may(EITHER, contrast.without_order(bins), WITHOUT_ORDER, MORE)
    if EITHER in notes.right | set(notes.accepted) and bins.truth[-1] > bins.truth.min():
        notes.accepted["undecided"] = "a model that looks the same rises with frequency"
    notes.may("drift", contrast.walk(bins), "a random walk")
    notes.may("low-pass", contrast.low_pass(bins), "a low-pass")


def _rising(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    """Note the right verdicts on a spectrum that rises with frequency.

    A fractional order with F = h^α f + α < 0 (h: sampling period) may have nearly the same spectrum. Then the
    verdict "undecided" is right or accepted, too.
    """
    notes.may("undecided", contrast.order(bins), "an order between 0.15 and 0.85")


def _walk(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    notes.may(EITHER, contrast.order(bins), "an order between 0.15 and 0.85")


def _resonance(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    for _, width in _peaks(noise):
        ordinates = width * n / (2 * math.pi)
        if ordinates < NARROW:
            notes.right |= {"line", "line or resonance"}
        elif ordinates < FEW_ORDINATES:
            notes.accepted["line or resonance"] = f"the peak is {ordinates:.1f} ordinates wide"
            notes.accepted["line"] = notes.accepted["line or resonance"]
    notes.accepted.pop("drift", None)
    notes.may("low-pass", contrast.low_pass(bins), "a low-pass")
    notes.may("drift", contrast.walk(bins), "a random walk")


def _low_pass(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    _relaxation_or_order(notes, bins)
    level = float(noise.spectrum(np.array([1e-3 * bins.lam[0]]), rate_hz)[0])
    if bins.truth[0] < level / 2:
        notes.accepted["drift"] = "the corner is below the lowest frequency that is fitted"
    # The two ends of a drifting record differ. The power of this difference leaks into the fitted ordinates.
    leak = noise.drift.size**2 / (n * bins.lam**2) if noise.drift is not None else 0.0
    with_leak = bins.truth + leak
    notes.may("drift", contrast.walk(bins._replace(truth=with_leak)), "a random walk")
    if with_leak[0] > 2 * bins.truth[0]:
        notes.right.add("drift")
    slow = [part for part in noise.parts if not isinstance(part, Through)]
    if slow:
        inside = contrast.white(_passed(noise, bins, rate_hz))
        if inside > UNSEEN:
            notes.right.add("drift")
        if distinguishable(inside, 3 * math.log(bins.weight.sum())):
            notes.right.discard("low-pass")


def _relaxation_or_order(notes: _Notes, bins: Bins) -> None:
    notes.may("relaxations", contrast.one_relaxation(bins), "one relaxation")
    if "relaxations" in notes.right or "relaxations" in notes.accepted:
        notes.may(EITHER, contrast.order(bins), "an order between 0.15 and 0.85")


def _high_pass(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    """Note the verdict "anti-persistent" as right if the spectrum only seems to rise with frequency.

    This is so if the corner of the high-pass is at a high frequency (HIGH_CORNER).
    """
    half = float(bins.lam[np.flatnonzero(bins.truth > bins.truth[-1] / 2)[0]])
    if half > HIGH_CORNER:
        notes.right.add("anti-persistent")


def _high_passed_relaxations(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    """Note the right verdicts on relaxations after a high-pass.

    Right are "relaxations" and "high-pass". The spectrum may also look like a fractional order after a
    high-pass, or like a random walk. Verdicts that name those are then right or accepted.
    """
    notes.right.add("high-pass")
    notes.may(EITHER, contrast.high_passed_order(bins), "an order behind a high-pass", MORE)
    notes.may("drift", contrast.walk(bins), "a random walk")


def _notch(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    notes.may("low-pass", contrast.low_pass(bins), "a low-pass")


def _filtered_order(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    passed = _passed(noise, bins, rate_hz)
    inside = contrast.white(passed)
    if distinguishable(inside, 3 * math.log(passed.weight.sum())):
        _order(notes, noise, passed, rate_hz, n)
        notes.right.discard("low-pass")
        notes.accepted.pop("low-pass", None)
        return
    notes.right |= {"low-pass", "fractional"}
    notes.may("drift", contrast.walk(passed), "a random walk")
    notes.may(EITHER, contrast.without_order(passed), WITHOUT_ORDER, MORE)


def _passed(noise: Noise, bins: Bins, rate_hz: float) -> Bins:
    """Return the bins that a filter passes, with the noise's spectrum before the filter.

    The spectrum before the filter is the spectrum in `bins` divided by the filter's gain.
    """
    (part,) = (part for part in noise.parts if isinstance(part, Through))
    gain = Through(part.low_pass).spectrum(bins.lam, rate_hz)
    inside = contrast.below(bins, _end(bins, gain / gain[0]))
    return Bins(inside.lam, inside.weight, inside.truth / gain[: len(inside.lam)])


def _end(bins: Bins, gain: Array) -> float:
    stopped = np.flatnonzero(gain < INSIDE_THE_FILTER)
    return float(bins.lam[stopped[0]]) if len(stopped) else math.inf


def _held(notes: _Notes, noise: Noise, bins: Bins, rate_hz: float, n: int) -> None:
    """Note the right verdicts on repeated values.

    Repeating values is a filter, but no verdict names a filter of this shape.
    """
    notes.accepted["undecided"] = "no model here has this spectrum"
    _relaxation_or_order(notes, bins)


def _lines(notes: _Notes, noise: Noise, rate_hz: float, n: int) -> None:
    """Note the right verdicts on noise with spectral lines.

    The right verdicts depend on whether the record shows a line, and on whether the record can distinguish a
    line from a drift or a resonance.
    """
    notes.right.clear()
    notes.accepted.clear()
    surely = False
    for line in noise.lines:
        if not isinstance(line, Line):
            right, accepted = right_periodic(line, rate_hz, n)
            notes.right |= right
            notes.accepted |= accepted
            return
        at_hz = line.folded(rate_hz)
        density = float(noise.spectrum(np.array([2 * np.pi * at_hz / rate_hz]), rate_hz)[0])
        over = line.amplitude**2 * n / 4 / density
        periods, beats = at_hz * n / rate_hz, (rate_hz / 2 - at_hz) * n / rate_hz
        seen = over - LUCK * math.sqrt(2 * over) > math.log(n / 2 / PEAK_ALARM)
        if over < 1:
            notes.right.add("white")
        elif periods < contrast.FIRST:
            notes.right.add("drift")
            if periods < 1 or over - LUCK * math.sqrt(2 * over) < SLOW_ORDINATES * SLOW_SEEN:
                notes.accepted["white"] = f"the line has {periods:.2g} periods and {over:.0f} times the noise"
        elif beats < 2:
            notes.right.add("line")
            why = f"the line makes {beats:.2g} beats with half the rate"
            notes.accepted |= {"resonance": why, "white": why, "undecided": why, "not stationary": why}
            notes.accepted["anti-persistent"] = why
        else:
            notes.right.add("line")
            surely |= seen
            if not seen:
                notes.accepted["white"] = notes.accepted["undecided"] = f"a line {over:.1f} times the noise"
    if "line" in notes.right:
        notes.accepted["line or resonance"] = "a resonance narrower than an ordinate has the same spectrum"
    if surely:
        notes.right = {"line"}
        notes.accepted = {"line or resonance": notes.accepted["line or resonance"]}
    elif "white" in notes.right:
        notes.accepted["undecided"] = "the null test rejects one white record in twenty"


CHANGE = math.log(2)
"""If a noise's variance changes, it differs between a record's halves by a factor of at least exp(CHANGE)."""


def _changes(notes: _Notes, n: int) -> None:
    """Note the verdicts on noise whose variance changes during the record.

    The variance differs by a factor of two or more between the halves of the record.

    Each half has n / 2 samples, so its variance is known with a relative standard deviation of 1 / √(n / 4).
    """
    notes.right = {"not stationary"}
    expected = CHANGE**2 * n / 8
    if distinguishable(expected, SAME + 2 * math.log(n)):
        notes.accepted.clear()
        return
    why = f"the variance changes by {math.sqrt(expected):.1f} standard deviations"
    notes.accepted = {"white": why, "undecided": why}


FEW_SWINGS = 16
"""If the power rises or falls at least FEW_SWINGS times in a record, only "not stationary" is right."""


def _swings(notes: _Notes, half: int, n: int) -> None:
    """Note the right verdicts on noise whose power rises and falls by turns, every `half` samples.

    In a record of at most `half` samples the power may be the same throughout. Then "white" is right, too.
    """
    notes.right = {"not stationary"} if n > half else {"not stationary", "white"}
    if n < FEW_SWINGS * half:
        why = f"the power rises or falls {n / half:.1f} times"
        notes.accepted = {"white": why, "undecided": why}


_RULES: dict[str, tuple[VerdictKind, Callable[[_Notes, Noise, Bins, float, int], None]]] = {
    "relaxations": ("relaxations", _relaxations),
    "order": ("fractional", _order),
    "rising": ("anti-persistent", _rising),
    "walk": ("drift", _walk),
    "resonance": ("resonance", _resonance),
    "low-pass": ("low-pass", _low_pass),
    "high-pass": ("high-pass", _high_pass),
    "high-passed relaxations": ("relaxations", _high_passed_relaxations),
    "notch": ("notch", _notch),
    "filtered order": ("fractional", _filtered_order),
    "held": ("low-pass", _held),
}
"""For each true spectrum except white: its verdict, and a function that notes further right verdicts."""

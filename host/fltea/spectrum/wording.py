"""The words of a verdict: what the noise is, how sure that is, and what to do next."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from fltea.noise.filters import HighPass
from fltea.noise.part import Part, in_hz
from fltea.noise.parts import Arfima, Floor, Relaxation
from fltea.records.odds import odds
from fltea.spectrum import comb_words
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.order_fit import OrderFit
from fltea.spectrum.reading import corner_hz
from fltea.spectrum.spectral_lines import Peak

NUMBERS = ("no", "one", "two", "three", "four", "five", "six")
LIKELY = 10.0
"""If the odds for or against an order are at least this, the text says what the noise most likely is."""
REGULAR = 3.0
"""If the odds of an order are higher than this, the text adds a warning: the noise may also be a sum of
relaxations whose corner frequencies are a factor of ten apart, since such a sum looks like an order.
"""
UNDEFINED = "α and f are undefined"
TAKEN_OUT = (
    "AC coupling or an auto-zero: slow noise and the bias have been taken out, so nothing can be said of "
    "drift (bias figures are the filter's)."
)


def duration(seconds: float) -> str:
    """Return a duration as text, in the unit that a person would choose."""
    for limit, size, unit in ((120, 1, "s"), (7200, 60, "min"), (172_800, 3600, "h")):
        if seconds < limit:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 86_400:.0f} days"


def listed(parts: Sequence[str], word: str = "and") -> str:
    """Return the parts as a list in words, such as "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"


def capital(text: str) -> str:
    """Return the text with a capital first letter."""
    return text[:1].upper() + text[1:]


def peaks(found: tuple[Peak, ...]) -> str:
    """Return words for the three strongest peaks, and how many other peaks there are."""
    parts = [_peak(peak) for peak in found[:3]]
    if len(found) > 3:
        parts.append(f"{len(found) - 3} more")
    return listed(parts)


def _peak(peak: Peak) -> str:
    if peak.repeats is not None:
        return comb_words.what(peak.repeats, peak.power_share)
    name = f"a {peak.kind} at {peak_hz(peak.frequency_hz)}"
    if peak.notch_hz[0] == 0.0 and peak.kind == "resonance":
        name = (
            "a line whose frequency wanders about a multiple of the sample rate, and is seen below "
            f"{in_hz(peak.notch_hz[1])}"
        )
    return f"{name} ({peak.power_share:.1%} of the power)"


def peak_hz(frequency_hz: float) -> str:
    """Return words for a peak's frequency.

    For a peak below 0.1 Hz, the words also give its period, since "0.00 Hz" would say nothing.
    """
    if frequency_hz < 0.1:
        return f"{frequency_hz:.2g} Hz (a period of {duration(1 / frequency_hz)})"
    return f"{frequency_hz:.{2 if frequency_hz < 10 else 1}f} Hz"


def sentence(parts: Sequence[Part], e: Evidence, order: OrderFit | None = None) -> str:
    """Return words for the parts of a noise and the filters after them.

    `order`: the order with its interval.
    """
    told = [
        (part, _order(order or OrderFit()) if part.has("ordered") else part.words(e.rate_hz))
        for part in parts
    ]
    sources = [text for part, text in told if text and not part.has("filter")]
    relaxing = [part for part in parts if isinstance(part, Relaxation)]
    if relaxing:
        sources.insert(0, f"{relaxations(relaxing)} with {corners(relaxing, e)}")
    behind = [text for part, text in told if part.has("filter")]
    found = f"{listed(sources)} in white noise" if sources else "white noise"
    if behind:
        found += f", {'all of it ' if sources else ''}through {listed(behind)}"
    if any(isinstance(part, Floor) for part in parts):
        found += ", and white noise behind that"
        if any(isinstance(part, HighPass) for part in parts):
            found += " or what the high-pass left of a random walk"
    return found


def _order(found: OrderFit) -> str:
    alpha = found.alpha
    if alpha.value is None:
        return "an order that the data do not define"
    kind = " (ARFIMA)" if found.arfima else ""
    return f"an order of {alpha.value:.2f} ({alpha.low:.2f} … {alpha.high:.2f}){kind}"


def relaxations(found: Sequence[Relaxation]) -> str:
    """Return words that say how many relaxations there are."""
    return "one relaxation" if len(found) == 1 else f"a sum of {NUMBERS[len(found)]} relaxations"


def corners(found: Sequence[Relaxation], e: Evidence) -> str:
    """Return words for the corner frequencies of relaxations.

    If a corner frequency lies in the fitted band, the words give its value.
    """
    values = sorted(corner_hz(part) for part in found)
    inside = [f"{value:.3g}" for value in values if e.from_hz <= value <= e.to_hz]
    parts = []
    if any(value < e.from_hz for value in values):
        parts.append(f"below {in_hz(e.from_hz)}")
    if inside:
        parts.append(f"at {listed(inside)} Hz")
    if any(value > e.to_hz for value in values):
        parts.append(f"above {in_hz(e.to_hz)}")
    return f"{'its corner' if len(found) == 1 else 'corners'} {listed(parts)}"


def drift(e: Evidence) -> str:
    """Return words for drift, the power below the fitted frequencies."""
    ratio = max(e.slow.offset, e.slow.ratio)
    times = f"{ratio:.2g}" if ratio < 1000 else f"{ratio:.0e}"
    return (
        f"drift below {in_hz(e.slow.below_hz)} with {times} times the model's power there (too few periods "
        "to say what it is)"
    )


def also_found(
    e: Evidence, *, with_peaks: bool = True, with_drift: bool = True, with_median: bool = True
) -> str:
    """Return sentences on what was found in addition to the noise that the verdict names."""
    parts = []
    if e.reading.high_pass is not None:
        parts.append(f" {TAKEN_OUT}")
    if with_peaks and e.peaks:
        parts.append(f" There is also {peaks(e.peaks)}.")
    if with_drift and e.drifts:
        parts.append(f" There is also {drift(e)}.")
    if with_median and e.median is not None:
        parts.append(f" The samples have been through {e.median.words}.")
    return "".join(parts)


def change(e: Evidence) -> str:
    """Return words for how the noise changed."""
    c = e.change
    assert c is not None
    band = f"between {c.low_hz:.3g} and {c.high_hz:.3g} Hz"
    if c.is_step:
        how = "grew" if c.ratio > 1 else "fell"
        ratio = max(c.ratio, 1 / c.ratio)
        when = f"around {duration(c.at_s)} of {duration(e.duration_s)}"
        return f"its power {band} {how} by a factor of {ratio:.2g} {when}"
    every = ""
    if c.period_s is not None:
        every = f", every {c.period_s:.3g} s" if c.period_s < 1000 else f", every {duration(c.period_s)}"
    elif c.half_s is not None:
        every = f", over {duration(c.half_s) if c.half_s >= 2 else f'{c.half_s:.1g} s'} or so"
    return f"its power {band} went up and down by a factor of about {c.size:.2g}{every}"


def band(e: Evidence) -> str:
    """Return words for the fitted frequency band."""
    decades = math.log10(e.to_hz / e.from_hz)
    return f"{in_hz(e.from_hz)} to {in_hz(e.to_hz)}, {decades:.1f} decades"


def either(ordered: str, said: str, value: float | None) -> str:
    """Return a sentence that says that the noise is either one with an order, or one without.

    `ordered`, `said`: words for the noise with an order, and without. `value`: odds of the order, if known.
    """
    if value is None or 1 / LIKELY < value < LIKELY:
        return f"This record cannot separate {ordered} from {said}"
    likely, other = (ordered, said) if value > 1 else (said, ordered)
    return f"Most likely {likely}; {other} is possible, too"


def odds_of_order(e: Evidence) -> str:
    """Return a sentence on the odds of an order, if there may be an order."""
    if e.odds is None:
        return ""
    said = f"for an order are {odds(e.odds)}" if e.odds >= 1 else f"against an order are {odds(1 / e.odds)}"
    regular = " Relaxations a decade apart would look the same." if e.odds > REGULAR else ""
    return f"The odds {said}, if half of all noises have one.{regular}"


def null_test(e: Evidence) -> str:
    """Return words for the result of the null test, and its significance level."""
    level = f"{e.level:.2g}" if e.level >= 0.01 else f"{e.level:.0e}"
    why = "" if e.level >= 0.01 else ", strict since it is repeated live"
    rejects = "rejects" if e.p_clean < e.level else "does not reject"
    return f"The null test {rejects} white noise ({fitted_p(e)}, level {level}{why})"


def fitted_p(e: Evidence) -> str:
    """Return words for the p-value of the null test on what is fitted.

    The field `null_p` has that on the whole spectrum.
    """
    return f"p = {e.p_clean:.2g} without peaks and drift"


def rejected_by(e: Evidence) -> str:
    """Return the reason why white noise was rejected, if it is missing power at low frequencies.

    Return an empty text for any other reason.
    """
    if e.candidates.missing.nll >= e.candidates.null.nll:
        return ""
    return ": low frequencies have less power than the others, as behind AC coupling or an auto-zero"


def names(kinds: Iterable[type[Part]]) -> str:
    """Return a short name of a model with parts of these kinds, for tables."""
    counted = Counter(
        "order (ARFIMA)" if kind is Arfima else str(kind.__struct_config__.tag) for kind in kinds
    )
    return " + ".join(name if count == 1 else f"{count} {name}s" for name, count in counted.items())

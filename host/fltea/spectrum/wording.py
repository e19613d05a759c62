"""What a verdict says in words: what the noise is, how sure that is, and what to do next (pure)."""

import math
from collections.abc import Sequence

from fltea.spectrum.evidence import Evidence
from fltea.spectrum.lines import Peak

NUMBERS = ("no", "one", "two", "three", "four", "five", "six")
MODELS = {
    "white": "white noise",
    "ar1": "AR(1)",
    "ar2": "AR(2)",
    "two_ar1": "two AR(1)",
    "three_ar1": "three AR(1)",
    "four_ar1": "four AR(1)",
    "five_ar1": "five AR(1)",
    "six_ar1": "six AR(1)",
    "rising": "a power of the frequency",
    "fractional": "the fractional model",
    "arfima": "ARFIMA",
}
"""The names of the contest, for people."""
MOSTLY_ONE_STEP = 0.6
"""Share of the differences that one step has to explain to be called so."""
ABOUT_ONE_POLE = 1.0
UNDEFINED = "α and f are undefined"


def hz(value: float) -> str:
    """Return a number with three digits at most."""
    return f"{value:.3g} Hz"


def duration(seconds: float) -> str:
    """Return a duration in the unit that a person would choose."""
    for limit, size, unit in ((120, 1, "s"), (7200, 60, "min"), (172_800, 3600, "h")):
        if seconds < limit:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 86_400:.0f} days"


def listed(parts: Sequence[str], word: str = "and") -> str:
    """Return several things as a part of a sentence."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"


def capital(text: str) -> str:
    """Return the text with a capital, as a sentence begins."""
    return text[:1].upper() + text[1:]


def peaks(found: tuple[Peak, ...]) -> str:
    """Return the strongest few."""
    parts = [
        f"a {peak.kind} at {peak.frequency_hz:.{2 if peak.frequency_hz < 10 else 1}f} Hz "
        f"({peak.power_share:.1%} of the power)"
        for peak in found[:3]
    ]
    if len(found) > 3:
        parts.append(f"{len(found) - 3} more")
    return listed(parts)


def low_pass(e: Evidence) -> str:
    """Return the words for the filter."""
    found = e.low_pass
    assert found is not None
    if found.corner_hz >= e.rate_hz / 2:
        where = f"near or beyond {hz(e.rate_hz / 2)}, half the sample rate"
    else:
        where = f"at {hz(found.corner_hz)}"
    steep = "one pole" if found.poles == ABOUT_ONE_POLE else f"about {found.poles:.0f} poles"
    if found.poles > 8:
        steep = "steep"
    return f"a low-pass with its corner {where} ({steep})"


def corner(value: float, e: Evidence) -> str:
    """Return a corner, as far as the data have it."""
    if value < e.from_hz:
        return f"below {hz(e.from_hz)}"
    if value > e.to_hz:
        return f"above {hz(e.to_hz)}"
    return f"at {hz(value)}"


def corners(parameters: dict[str, float], e: Evidence) -> str:
    """Return those of a sum of relaxations, slowest first."""
    found = [value for name, value in parameters.items() if name.startswith("bend")]
    inside = [f"{value:.3g}" for value in found if e.from_hz <= value <= e.to_hz]
    parts = []
    if any(value < e.from_hz for value in found):
        parts.append(f"below {hz(e.from_hz)}")
    if inside:
        parts.append(f"at {listed(inside)} Hz")
    if any(value > e.to_hz for value in found):
        parts.append(f"above {hz(e.to_hz)}")
    return listed(parts) if parts else "nowhere in the band"


def relaxations(parameters: dict[str, float]) -> str:
    """Return the number of relaxations in words."""
    count = max(sum(name.startswith("bend") for name in parameters), 1)
    return "one relaxation" if count == 1 else f"a sum of {NUMBERS[count]} relaxations"


def drift(e: Evidence) -> str:
    """Return the words for power that is slower than what is fitted."""
    ratio = max(e.slow.offset, e.slow.ratio)
    times = f"{ratio:.2g}" if ratio < 1000 else f"{ratio:.0e}"
    return (
        f"drift below {hz(e.slow.below_hz)}, {times} times the power that the model has there (too few "
        "periods to say what it is)"
    )


def also_found(
    e: Evidence, *, with_low_pass: bool = True, with_peaks: bool = True, with_drift: bool = True
) -> str:
    """Return sentences on all else that was found, whatever the verdict."""
    parts = []
    if with_low_pass and e.low_pass is not None:
        parts.append(f" All of it has gone through {low_pass(e)}.")
    if with_peaks and e.peaks:
        parts.append(f" There is also {peaks(e.peaks)}.")
    if with_drift and e.drifts:
        parts.append(f" There is also {drift(e)}.")
    return "".join(parts)


def change(e: Evidence) -> str:
    """Return a sentence on how the noise changed."""
    c = e.change
    assert c is not None
    band = f"between {c.low_hz:.3g} and {c.high_hz:.3g} Hz"
    if c.share >= MOSTLY_ONE_STEP:
        how = "grew" if c.ratio > 1 else "fell"
        ratio = max(c.ratio, 1 / c.ratio)
        when = f"around {duration(c.at_s)} of {duration(e.duration_s)}"
        return f"its power {band} {how} by a factor of {ratio:.2g} {when}"
    return f"its power {band} went up and down by a factor of about {c.size:.2g}"


def its_corners(parameters: dict[str, float], e: Evidence) -> str:
    """Return the same as what a sum has."""
    one = sum(name.startswith("bend") for name in parameters) == 1
    return f"{'its corner' if one else 'corners'} {corners(parameters, e)}"


def band(e: Evidence) -> str:
    """Return the band of the data in words."""
    decades = math.log10(e.to_hz / e.from_hz)
    return f"{hz(e.from_hz)} to {hz(e.to_hz)}, {decades:.1f} decades"


def record_for(e: Evidence) -> str:
    """Return how long a record has to be to decide for an order or relaxations, and what to do until then."""
    if e.decides_s is None:
        tell = "No record of up to a month would tell"
    else:
        tell = f"A record of some {duration(e.decides_s)} would tell"
    return f"{tell}; a navigation filter can take either, and the sum is the easier one."

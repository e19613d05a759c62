"""Reads units of angle per time, of acceleration and of time, in the spellings that people use.

Blanks, brackets and multiplication signs make no difference. Capital letters mean the same as small letters,
since no logger writes megaradians. Ambiguous words are not accepted: `rps` may be revolutions or radians per
second.
"""

import math
import re
from collections.abc import Mapping
from functools import lru_cache

from fltea.records.errors import UsageError
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.settings.how import TimeUnit


def _spelled(forms: dict[str, str]) -> dict[str, str]:
    """Return a mapping from each word to its meaning.

    `forms`: for each meaning, all its words in one text.
    """
    return {word: meaning for meaning, words in forms.items() for word in words.split()}


_ANGLES = {"rad": math.degrees(1.0), "deg": 1.0, "arcsec": 1 / 3600, "arcmin": 1 / 60, "rev": 360.0}
_TIMES = {"s": 1.0, "min": 60.0, "h": 3600.0}
_PREFIXES = {"": 1.0, "m": 1e-3, "u": 1e-6}

PER_UNIT = {
    f"{prefix}{angle}/{time}": scale * degrees / seconds
    for angle, degrees in _ANGLES.items()
    for prefix, scale in _PREFIXES.items()
    for time, seconds in _TIMES.items()
}
"""Size of each unit of angular rates in deg/s, by the name that the program gives to the unit."""

UNITS_HELP = "deg/s, °/s, dps, mdps, rad/s, mrad/s, deg/h, rpm, or lsb:N for counts, N LSB per deg/s"
ACCEL_UNITS_HELP = "m/s^2, cm/s^2, mm/s^2, g, mg, or lsb:N for counts, N LSB per g"

_ANGLE_WORDS = _spelled(
    {
        "rad": "rad rads radian radians",
        "deg": "deg degs degree degrees °",
        "arcsec": "arcsec arcsecs arcsecond arcseconds as ″",
        "arcmin": "arcmin arcmins arcminute arcminutes ′",
        "rev": "rev revs revolution revolutions rot rots rotation rotations turn turns cycle cycles",
    }
)
_TIME_WORDS = _spelled(
    {"s": "s sec secs second seconds", "min": "min mins minute minutes", "h": "h hr hrs hour hours"}
)
_LENGTHS = {"m": 1.0, "meter": 1.0, "metre": 1.0, "mm": 1e-3, "cm": 1e-2, "ft": 0.3048, "in": 0.0254}
_OF_FREE_FALL = {
    **dict.fromkeys(("g", "gs", "gn", "g0", "g-force", "gforce"), STANDARD_GRAVITY_MS2),
    "gal": 1e-2,
}
_RATES_IN_ONE = {"rads": "rad/s", "rpm": "rev/min", "r/min": "rev/min"}
"""Units of angular rates in spellings to which the general rule, an angle per time, does not apply."""

TIME_UNITS: Mapping[str, TimeUnit] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds", "millisecond"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microseconds", "microsecond"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanoseconds", "nanosecond"), "ns"),
}
"""Words for units of time, in small letters. Such a word may stand after the name of a column of times, or
in place of the name.
"""

_LONG_TIMES_S = {"min": 60.0, "h": 3600.0, "d": 86_400.0}
_DAYS = dict.fromkeys(("d", "day", "days"), "d")

AMBIGUOUS = ("rads",)
"""Words that may mean radians per second, or just radians. As the unit of a gyroscope's column, such a word
means radians per second. As the unit of a column `x`, which may be of any sensor, the word is ambiguous.
"""

_OF_COUNTS = "- 1 lsb lsbs count counts raw adc digit digits bit bits tick ticks no_units unitless"
"""Words that stand where a unit is expected, but mean counts of a sensor's register or numbers without a
dimension.
"""

_OTHERS = (
    "% percent c °c degc deg_c celsius °f degf k kelvin v mv uv ma hz khz pa hpa kpa mbar bar psi mm cm m km"
)
_OTHERS += (
    " ft m/s km/h kmh kn knots ut nt mt tesla gauss g mgauss mga mg local_flux lux lx dbm db ohm ohms kohm"
)
_OTHERS += " kohms min hours rh %rh kg nm bool text string"
"""Units of quantities other than rate, acceleration and time, which a row of units may contain too."""

_NO_RATES = frozenset(f"{_OF_COUNTS} {_OTHERS}".split())

_SIGNS = str.maketrans(
    {
        **dict.fromkeys("µμ", "u"),
        **dict.fromkeys("º˚", "°"),
        **dict.fromkeys("⁻−–", "-"),
        **dict.fromkeys("·⋅*×", " "),
        **dict.fromkeys("[](){}<>^$", ""),
        **dict.fromkeys("’'", "′"),
        "”": "″",
        "²": "2",
        "¹": "1",
        "\\": "/",
        "â": "",
    }
)
"""Other spellings of signs in units, each with the sign that it stands for. The letter "â" is dropped: it
appears before a sign if text in UTF-8 was read in the Windows encoding.
"""

LONGEST_UNIT = 40
"""Longest unit [characters]. A longer text is not examined as a unit."""

_ANY_TIME = "|".join(_TIME_WORDS)
_RATE = re.compile(
    rf"(?P<angle>[a-z°″′][a-z°″′ -]*?)(?:(?: ?/ ?|[ _]?per[ _]?|_|(?P<p>p))(?P<time>{_ANY_TIME})"
    rf"|[ ._]?(?P<of>{_ANY_TIME}) ?-1)"
)
_SECOND = "(?:s|secs?|seconds?)"
_ACCEL = re.compile(
    rf"(?P<length>[a-z]+?)s?(?:(?:[ _]?per[ _]?|[ /_p]*){_SECOND}(?:[ _]?2| squared|(?:[ /_]| per ){_SECOND})"
    rf"|[ ._]?{_SECOND} ?-2)"
)
_PREFIXED = re.compile(r"(?:(?P<m>milli[ -]?|m)|(?:micro[ -]?|u))(?P<bare>.+)")


def rate_unit(text: str) -> str | None:
    """Return the name of a unit of angular rates, a key of `PER_UNIT`; None if the text is no such unit."""
    return _rate(text) if len(text) <= LONGEST_UNIT else None


@lru_cache(maxsize=1024)
def _rate(text: str) -> str | None:
    bare = _bare(text)
    if bare in _RATES_IN_ONE:
        return _RATES_IN_ONE[bare]
    found = _RATE.fullmatch(bare)
    if found is None:
        return None
    word = found["angle"].strip()
    if found["p"] and word in ("d", "md", "ud"):  # the letter d means degree only in dps and in similar words
        word += "eg"
    angle = _angle(word)
    return None if angle is None else f"{angle}/{_TIME_WORDS[found['time'] or found['of']]}"


def parse_units(text: str) -> tuple[float, float | None]:
    """Return a factor that converts numbers to deg/s, and None. For counts: 1, and the counts in 1 deg/s.

    Raises:
        UsageError: the unit is unknown.
    """
    if (unit := rate_unit(text)) is not None:
        return PER_UNIT[unit], None
    return 1.0, _counts("--units", text, UNITS_HELP)


def accel_unit(text: str) -> float | None:
    """Return the size of a unit of acceleration in m/s²; None if the text is no such unit."""
    return _accel(text) if len(text) <= LONGEST_UNIT else None


@lru_cache(maxsize=1024)
def _accel(text: str) -> float | None:
    bare = _bare(text)
    prefix, rest = _without_prefix(bare)
    if bare in _OF_FREE_FALL or rest in _OF_FREE_FALL:
        return _OF_FREE_FALL.get(bare) or _PREFIXES[prefix] * _OF_FREE_FALL[rest]
    found = _ACCEL.fullmatch(bare)
    return None if found is None else _LENGTHS.get(found["length"])


def parse_accel_unit(text: str) -> tuple[float, float | None]:
    """Return the size of a unit of acceleration in m/s². For counts, also return the number in 1 g.

    Raises:
        UsageError: the unit is unknown.
    """
    if (ms2 := accel_unit(text)) is not None:
        return ms2, None
    lsb = _counts("--accel-units", text, ACCEL_UNITS_HELP)
    return STANDARD_GRAVITY_MS2 / lsb, lsb


def time_unit(text: str) -> TimeUnit | None:
    """Return the unit of times that a text means, or None."""
    return TIME_UNITS.get(_bare(text)) if len(text) <= LONGEST_UNIT else None


def time_scale(text: str) -> tuple[TimeUnit, float] | None:
    """Return the unit of times that a text means, and a number of such units: for a minute, s and 60.

    Minutes, hours and days are given as multiples of s. Return None if the text is no unit of time.
    """
    bare = _bare(text[: LONGEST_UNIT + 1])
    if (unit := TIME_UNITS.get(bare)) is not None:
        return unit, 1.0
    seconds = _LONG_TIMES_S.get(_TIME_WORDS.get(bare) or _DAYS.get(bare, ""))
    return None if seconds is None else ("s", seconds)


def is_angle(text: str) -> bool:
    """Return whether a text is a unit of angles, and thus not a unit of angular rates."""
    return len(text) <= LONGEST_UNIT and _angle(_bare(text)) is not None


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of any quantity of an IMU, or states that there is no unit."""
    return _is_unit(text[: LONGEST_UNIT + 1])


@lru_cache(maxsize=4096)
def _is_unit(text: str) -> bool:
    bare = _bare(text)
    is_other = bare.replace(" ", "_") in _NO_RATES or text.strip() in ("[]", "()")
    return is_other or any(kind(text) for kind in (rate_unit, accel_unit, time_scale, is_angle))


def is_physical(text: str) -> bool:
    """Return whether a text is the unit of a physical quantity. Counts and mere numbers are none."""
    return is_unit(text) and _bare(text) not in ("", *_OF_COUNTS.split())


def _bare(text: str) -> str:
    """Return a unit in small letters, with only one spelling of each sign."""
    return " ".join(text.strip().strip('"').lower().translate(_SIGNS).rstrip(".").split())


def _without_prefix(bare: str) -> tuple[str, str]:
    found = _PREFIXED.fullmatch(bare)
    return ("", bare) if found is None else ("m" if found["m"] else "u", found["bare"])


def _angle(word: str) -> str | None:
    if word in _ANGLE_WORDS:
        return _ANGLE_WORDS[word]
    prefix, rest = _without_prefix(word)
    return prefix + _ANGLE_WORDS[rest] if rest in _ANGLE_WORDS else None


def _counts(option: str, text: str, known: str) -> float:
    """Return N from a unit `lsb:N`: the number of counts in 1 deg/s or 1 g.

    Raises:
        UsageError: the unit has another form.
    """
    try:
        lsb = float(text.strip().lower().removeprefix("lsb:")) if ":" in text else math.nan
    except ValueError:
        lsb = math.nan
    if not (lsb > 0 and math.isfinite(lsb)):
        raise UsageError(f"{option} {text}: not a unit that this program knows. Give {known}.")
    return lsb

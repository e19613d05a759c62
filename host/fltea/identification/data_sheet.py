"""Compare the measured noise density of a gyroscope with that of its data sheet.

A data sheet's rate noise density is one-sided (positive frequencies only), so it is √2 N. The ADIS16470's
sheet
gives both: 0.34 deg/√h are 0.00567 (deg/s)/√Hz, and √2 times this is its density, 0.008.

The figures of MPU-9250, MPU-6050, ICM-42688-P and BMI270 were read in a copy of the sheet. The figures of the
other parts were compared with what other projects quote from the same sheet.
"""

import math
import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Literal, NamedTuple

import msgspec

from fltea.records.errors import UsageError
from fltea.records.fit import Interval, Level
from fltea.records.quantity import factor


class DataSheet(NamedTuple):
    """The noise figures of a gyroscope's data sheet."""

    density: float
    """Typical rate noise density [(deg/s)/√Hz]."""
    measured_at: str
    """The condition of measurement, as far as the sheet states it."""
    source: str


SHEETS = {
    "MPU-9250": DataSheet(0.01, "low-pass 92 Hz", "PS-MPU-9250A-01 rev. 1.0, 3.1"),
    "MPU-6050": DataSheet(0.005, "at 10 Hz, range ±250 deg/s", "PS-MPU-6000A-00 rev. 3.4, 6.1"),
    "ICM-20948": DataSheet(0.015, "bandwidth 10 Hz, range ±250 deg/s", "DS-000189 rev. 1.3, 3.1"),
    "ICM-42688-P": DataSheet(0.0028, "at 10 Hz", "DS-000347 rev. 1.6, 3.1"),
    "BMI088": DataSheet(0.014, "bandwidth 47 Hz", "BST-BMI088-DS001 rev. 1.4, table 3"),
    "BMI160": DataSheet(0.008, "at 10 Hz", "BST-BMI160-DS000 rev. 0.8, table 3"),
    "BMI270": DataSheet(0.007, "performance mode", "BST-BMI270-DS000 rev. 1.3, key features"),
    "BNO055": DataSheet(0.014, "bandwidth 47 Hz", "BST-BNO055-DS000 rev. 1.4, table 0-2"),
    "LSM6DS33": DataSheet(0.007, "high-performance mode", "DocID027423 rev. 4, table 3"),
    "LSM6DSO": DataSheet(0.0038, "high-performance mode", "DS12140 rev. 2, table 2"),
    "LSM6DSOX": DataSheet(0.0038, "high-performance mode", "DS12814 rev. 3, table 2"),
    "LSM6DSV": DataSheet(0.0028, "high-performance mode", "DS13476 rev. 5, table 3"),
    "ISM330DHCX": DataSheet(0.005, "high-performance mode", "DS13012 rev. 7, table 2"),
    "ADIS16470": DataSheet(0.008, "10 to 40 Hz", "ADIS16470 rev. C, table 1"),
}
"""The data sheets, by the name of the gyroscope."""

SCATTER = 1.2
"""An axis counts as good as its data sheet if its figure is at most this many times the sheet's typical
figure.

Data sheets rarely state a maximum.
"""
MUCH = 2.0
SEEN = 0.1
"""Rounding to counts is mentioned as a cause of noise if it gives more than this fraction of the white
noise's power.
"""
BEST, WORST = 1e-7, 1.0
"""Range in which the densities of all gyroscopes lie [(deg/s)/√Hz]."""
GIVEN = "given by --sheet"
"""Name of the data sheet in texts if the user gave a density instead of a gyroscope's name."""

_NUMBER = re.compile(r"\s*(?P<number>(?:\d+[.,]?\d*|[.,]\d+)(?:e[+-]?\d+)?)\s*(?P<unit>.*)", re.IGNORECASE)
_THOUSANDS = re.compile(r"\s*[1-9]\d{0,2}(,\d{3})+(?![\d,])")
"""Matches a number such as 1,500, in which the comma may separate thousands or decimals."""
_PER_ROOT_HZ = re.compile(r"hz\W*$", re.IGNORECASE)

SheetKind = Literal["better", "as good", "noisier", "not known"]


class SheetComparison(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The measured noise density of an axis and that of a data sheet, both in (deg/s)/√Hz."""

    part: str
    """Name of the gyroscope; empty if the user gave a density instead."""
    source: str
    typical: float
    density: Interval
    """√2 N of the axis, with its 95 % interval."""
    ratio: float | None
    """Ratio of the measured density to that of the data sheet."""
    kind: SheetKind
    text: str


def sheet_name(text: str) -> str:
    """Return a gyroscope's name as it stands in `SHEETS`, or a density in (deg/s)/√Hz as text of a number.

    Dashes and capitals in a name do not matter. A density is written as `0.007`, `0,007`, `0.007dps/rtHz` or
    `7 mdps/√Hz`; or the angle random walk N is given, as in `0.3 deg/√h`, and √2 N is the density.

    Raises:
        UsageError: the gyroscope is not known, or no gyroscope has this density.
    """
    plain = re.sub(r"[^A-Z0-9]", "", text.upper())
    names = {name.replace("-", ""): name for name in SHEETS}
    for its, name in names.items():
        if plain in (its, its.removesuffix("P")):
            return name
    if _THOUSANDS.match(text):
        raise UsageError(
            f"--sheet {text}: the comma may separate thousands or decimals. Write a decimal point: a "
            "number in dps/√Hz or with its unit, as in --sheet 0.007 or --sheet 7mdps/rtHz."
        )
    density = _density(text)
    if density is not None and BEST <= density <= WORST:
        return f"{density:g}"
    what = "no data sheet of such a gyroscope is known."
    if density is not None:
        what = f"no gyroscope has {density:g} (deg/s)/√Hz."
    near = [names[its] for its in get_close_matches(plain, names, 3, 0.4)]
    nearest = f" Nearest: {', '.join(near)}." if near else ""
    raise UsageError(
        f"--sheet {text}: {what}{nearest} Known are {', '.join(SHEETS)}. For another gyroscope give the "
        "rate noise density of its sheet, a number in dps/√Hz or with its unit: --sheet 0.007 or "
        "--sheet 7mdps/rtHz; or its angle random walk: --sheet 0.3deg/√h."
    )


def _density(text: str) -> float | None:
    """Return the density in (deg/s)/√Hz that a text states, or None.

    A number without a unit is in (deg/s)/√Hz. A figure per √h or √s is N, and the one-sided density is √2 N.
    """
    found = _NUMBER.fullmatch(text)
    if found is None:
        return None
    number, unit = float(found["number"].replace(",", ".")), found["unit"].strip()
    if not unit:
        return number
    try:
        figure = number * factor(unit, "deg/s/√Hz")
    except ValueError:
        return None
    return figure if _PER_ROOT_HZ.search(unit) else math.sqrt(2) * figure


def on_their_sides(values: Sequence[float], limits: Sequence[float]) -> list[str]:
    """Format numbers with three digits.

    More digits are used if rounding would move a number from one side of a limit to the other. For example,
    1.2004 must not look equal to a limit of 1.2.
    """
    for digits in range(3, 17):
        found = [f"{value:.{digits}g}" for value in values]
        shown = (_sides(float(text), limits) for text in found)
        if all(its == _sides(value, limits) for its, value in zip(shown, values, strict=True)):
            return found
    return [repr(value) for value in values]


def _sides(value: float, limits: Sequence[float]) -> list[tuple[bool, bool]]:
    """Return on which side of each limit the value is: two truth values for "above" and "below"."""
    return [(value > one, value < one) for one in limits]


def compare(
    part: str, level: Level, rate_hz: float, lsb: float | None = None, low_pass_hz: float | None = None
) -> SheetComparison:
    """Compare an axis in deg/s with the data sheet of `part`.

    Args:
        part: a name or density that `sheet_name` returned.
        level: N and K of the axis.
        rate_hz: sampling rate [Hz].
        lsb: one count [deg/s]; None if not known.
        low_pass_hz: bandwidth of the sensor's own low-pass [Hz]; None if not known.
    """
    known = part in SHEETS
    sheet = SHEETS[part] if known else DataSheet(float(part), "", GIVEN)
    name, typical = part if known else "", sheet.density
    N = level.N
    if N.value is None or N.low is None or N.high is None:
        why = f"not compared. {level.reason}"
        return SheetComparison(name, sheet.source, typical, Interval(), None, "not known", why)
    value, low, high = (math.sqrt(2) * one for one in (N.value, N.low, N.high))
    # The interval of N covers several models of the noise. Some of them count part of the white noise as a
    # fast relaxation (a first-order Gauss-Markov process), and their N is too low to be compared with a data
    # sheet. So the interval's lower end is limited: value / low is at most high / value.
    density = Interval(value, min(value, max(low, value**2 / high)), high)
    half = rate_hz / 2
    folded = max((low_pass_hz or half) / half, 1.0) ** 0.5
    # The limits are rounded to three digits before the comparison, as the text shows them.
    most, least = (float(f"{one:.3g}") for one in (SCATTER * folded, 1 / SCATTER))
    ratio, lowest, highest = (one / typical for one in (value, density.low or 0.0, high))
    kind: SheetKind = "as good"
    side = (
        f", not all above {most:g}" if ratio > most else f", not all below {least:g}" if ratio < least else ""
    )
    if lowest > most:
        kind, side = "noisier", f", all above {most:g}"
    elif highest < least:
        kind, side = "better", f", all below {least:g}"
    limits = (least, 1 / MUCH, SCATTER, most)
    its, to = ("its data sheet", "typical") if known else ("the density that was given", "given")
    verdict = {"as good": "as good as", "better": "better than", "noisier": "noisier than"}[kind]
    at = f" ({sheet.measured_at})" if sheet.measured_at else ""
    text = (
        f"{verdict} {its}. Measured {_shown(density, 1.0, [one * typical for one in limits])} (deg/s)/√Hz, "
        f"{_shown(density, typical, limits)} times the {to} {typical:g}{at}{side}."
    )
    if ratio * MUCH < 1:
        text += f" That is less than half: check the units{' and the name of the part' if known else ''}."
    if ratio > SCATTER:
        text += _why_more(ratio, half, low_pass_hz)
        counting = 0.0 if lsb is None else lsb / math.sqrt(12 * half)
        if counting**2 > SEEN * value**2:
            text += (
                f" Rounding to counts of {lsb:.3g} deg/s alone has a density of {counting:.2g} (deg/s)/√Hz: "
                "choose a finer range."
            )
    return SheetComparison(name, sheet.source, typical, density, ratio, kind, text)


def _shown(density: Interval, per: float, limits: Sequence[float]) -> str:
    """Format a density and its interval, both divided by `per`.

    `limits`: the values at which the verdict of the comparison changes. Rounding moves no number to the other
    side of a limit.
    """
    rounded = [float(f"{one:.12g}") for one in limits]
    ends = (density.value or 0.0, density.low or 0.0, density.high or 0.0)
    value, low, high = on_their_sides([one / per for one in ends], rounded)
    return f"{value} ({low}…{high})"


def _why_more(ratio: float, half: float, low_pass_hz: float | None) -> str:
    """Return a sentence that says whether aliasing explains why there is more noise than on the data sheet.

    If the sensor's low-pass passes frequencies above half the sample rate, aliasing adds their noise.
    """
    if low_pass_hz is None:
        return (
            f" At this sample rate all noise above {half:.3g} Hz is folded down: a low-pass of "
            f"{half * ratio**2:.3g} Hz in the sensor would explain the ratio. Compare its setting."
        )
    if low_pass_hz <= half:
        return f" The sensor's low-pass, {low_pass_hz:g} Hz, folds nothing down at this sample rate."
    return (
        f" The sensor's low-pass, {low_pass_hz:g} Hz, lets noise above {half:.3g} Hz be folded down, which "
        f"explains {(low_pass_hz / half) ** 0.5:.2g} times."
    )

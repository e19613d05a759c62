"""Whether a gyroscope is as good as its data sheet: the measured density beside the sheet's (pure).

A sheet's rate noise density is of positive frequencies only, so it is √2 N. The ADIS16470's sheet has both:
0.34 deg/√h are 0.00567 (deg/s)/√Hz, and √2 times that is its density, 0.008.

Read in a copy of the sheet: MPU-9250, MPU-6050, ICM-42688-P, BMI270. The others were compared with what other
projects quote of the same table.
"""

import math
import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Literal, NamedTuple

import msgspec

from fltea.recording.units import PER_UNIT, rate_unit
from fltea.records.errors import UsageError
from fltea.records.fit import Interval, Level


class DataSheet(NamedTuple):
    """What a data sheet says of a gyroscope's noise."""

    density: float
    """Typical, (deg/s)/√Hz."""
    measured_at: str
    """The condition that the sheet names, or nothing."""
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
"""By the name of the part."""

SCATTER = 1.2
"""Parts are taken for as good as a typical figure up to so many times it: sheets rarely give a highest."""
MUCH = 2.0
SEEN = 0.1
"""A share of the noise's power from which on it is worth a word."""
BEST, WORST = 1e-7, 1.0
"""Densities of gyroscopes in (deg/s)/√Hz; beyond these a number is something else."""
GIVEN = "given by --sheet"
"""Where a density is from that is no part's."""

_NUMBER = re.compile(r"\s*(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(?P<unit>.*)", re.IGNORECASE)
_PER_ROOT = re.compile(r"\s*/\s*(?:√|rt|root|sqrt)\s*\(?\s*hz\s*\)?\s*$", re.IGNORECASE)

SheetKind = Literal["better", "as good", "noisier", "not known"]


class SheetComparison(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The density of an axis beside that of a data sheet, both in (deg/s)/√Hz."""

    part: str
    """Empty where a density was given in place of a part."""
    source: str
    typical: float
    density: Interval
    """√2 N of the axis with its 95 % interval."""
    ratio: float | None
    """The density over the typical one."""
    kind: SheetKind
    text: str


def sheet_name(text: str) -> str:
    """Return the name of a part as `SHEETS` has it, or a density in (deg/s)/√Hz as a number.

    Dashes and capitals of a name do not matter. A density is `0.007`, `0.007dps/rtHz`, `7 mdps/√Hz` and such.

    Raises:
        UsageError: the part is not known, or no gyroscope has this density.
    """
    plain = re.sub(r"[^A-Z0-9]", "", text.upper())
    names = {name.replace("-", ""): name for name in SHEETS}
    for its, name in names.items():
        if plain in (its, its.removesuffix("P")):
            return name
    density = _density(text)
    if density is not None and BEST <= density <= WORST:
        return f"{density:g}"
    what = "no data sheet of this part is known."
    if density is not None:
        what = f"no gyroscope has {density:g} (deg/s)/√Hz."
    near = [names[its] for its in get_close_matches(plain, names, 3, 0.4)]
    nearest = f" Nearest: {', '.join(near)}." if near else ""
    raise UsageError(
        f"--sheet {text}: {what}{nearest} Known are {', '.join(SHEETS)}. Of another part give the rate noise "
        "density of its sheet, a number in dps/√Hz or with its unit: --sheet 0.007 or --sheet 7mdps/rtHz."
    )


def _density(text: str) -> float | None:
    """Return a density in (deg/s)/√Hz; without a unit it is one already. None: the text is none."""
    found = _NUMBER.fullmatch(text)
    if found is None:
        return None
    number, unit = float(found["number"]), found["unit"].strip()
    if not unit:
        return number
    rate, per_root = _PER_ROOT.subn("", unit)
    name = rate_unit(rate) if per_root else None
    return None if name is None else number * PER_UNIT[name]


def on_their_sides(values: Sequence[float], limits: Sequence[float]) -> list[str]:
    """Return numbers with three digits, or as many as show on which side of each limit every one is."""
    for digits in range(3, 17):
        found = [f"{value:.{digits}g}" for value in values]
        shown = (_sides(float(text), limits) for text in found)
        if all(its == _sides(value, limits) for its, value in zip(shown, values, strict=True)):
            return found
    return [repr(value) for value in values]


def _sides(value: float, limits: Sequence[float]) -> list[tuple[bool, bool]]:
    """Return for each limit whether the value is above it, and whether it is below."""
    return [(value > one, value < one) for one in limits]


def compare(
    part: str, level: Level, rate_hz: float, lsb: float | None = None, low_pass_hz: float | None = None
) -> SheetComparison:
    """Return how an axis in deg/s compares with the sheet of `part`.

    part: what `sheet_name` returns. lsb: one count in deg/s. low_pass_hz: the bandwidth of the sensor's own
    low-pass. None: not known.
    """
    known = part in SHEETS
    sheet = SHEETS[part] if known else DataSheet(float(part), "", GIVEN)
    name, typical = part if known else "", sheet.density
    N = level.N
    if N.value is None or N.low is None or N.high is None:
        why = f"not compared. {level.reason}"
        return SheetComparison(name, sheet.source, typical, Interval(), None, "not known", why)
    value, low, high = (math.sqrt(2) * one for one in (N.value, N.low, N.high))
    # A fast relaxation that N may not have is in a sheet's density, and in the value, so that it says nothing
    # of how much lower the density may be: that is as far as it may be higher.
    density = Interval(value, min(value, max(low, value**2 / high)), high)
    half = rate_hz / 2
    folded = max((low_pass_hz or half) / half, 1.0) ** 0.5
    # The limits are those that are printed, to three digits.
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
                f" Rounding to counts of {lsb:.3g} deg/s gives {counting:.2g} of it: choose a finer range."
            )
    return SheetComparison(name, sheet.source, typical, density, ratio, kind, text)


def _shown(density: Interval, per: float, limits: Sequence[float]) -> str:
    """Return a density and its interval over `per`, none of them rounded across a limit."""
    rounded = [float(f"{one:.12g}") for one in limits]
    ends = (density.value or 0.0, density.low or 0.0, density.high or 0.0)
    value, low, high = on_their_sides([one / per for one in ends], rounded)
    return f"{value} ({low}…{high})"


def _why_more(ratio: float, half: float, low_pass_hz: float | None) -> str:
    """Return what the sensor's low-pass has to do with more noise than in the sheet."""
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

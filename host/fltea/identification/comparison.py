"""Compare several recordings, and find which figures of their axes differ by more than chance."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import msgspec

from fltea.identification.axis_report import AxisReport, FileReport
from fltea.identification.forecast import integral, is_any_heading
from fltea.identification.quantities import quantities
from fltea.records.fit import Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.records.quantity import number, quantity_of, shown_units, without_unit
from fltea.records.units import HEADING_AFTER_S

CHANCE = 0.05
"""Probability that at least one figure is said to differ although all sensors are alike."""


class Figure(NamedTuple):
    """A figure of one axis.

    If its value is not known, it is below `at_most` with a probability of 95 %.
    """

    name: str
    unit: str
    found: Interval
    at_most: float | None = None


class Compared(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A figure of an axis of one recording, compared with the first recording that has the axis."""

    axis: str
    figure: str
    unit: str
    file: str
    against: str
    ratio: Interval
    """The figure divided by the same figure of the first recording, whose name is `against`, with the 95 %
    interval.

    Value and ends are null for a bias, and if one of the two figures is not known.
    """
    difference: Interval
    """Difference of two biases, in `unit`; null for other figures."""
    differs: bool | None
    """Whether the two figures differ by more than chance; null if one of them or its interval is not known.

    The more figures are compared, the larger a difference has to be (see `CHANCE`).
    """


def figures(axis: AxisReport) -> list[Figure]:
    """Return N, K, B, bias and heading of an axis; for a gyroscope in the units of data sheets."""
    of, now = shown_units(axis.unit), axis.now
    its, heading = quantities(axis.unit, axis.result.level, axis.allan, now), Interval()
    wanted = {
        "N": its.N.to(of.N),
        "K": its.K.to(of.K),
        "B": its.B.to(of.B),
        "bias": its.bias,
    }
    found = [Figure(name, one.unit, one.interval, one.at_most) for name, one in wanted.items()]
    if now is not None and not is_any_heading(now.heading_std, axis.unit):
        heading = Interval(NORMAL_95 * now.heading_std)
    found.append(Figure(f"± after {HEADING_AFTER_S} s", integral(axis.unit), heading))
    return found


def compared(reports: Sequence[FileReport]) -> list[Compared]:
    """Compare each figure of each axis with the same figure of the first recording that has the axis."""
    pairs = []
    for name, axes in _axes(reports):
        (against, first), *others = axes.items()
        for file, axis in others:
            if axis.unit == first.unit:
                both = zip(figures(first), figures(axis), strict=True)
                pairs += [(name, file, against, a, b) for a, b in both]
    known = sum(_is_known(first.found) and _is_known(its.found) for *_, first, its in pairs)
    reach = NormalDist().inv_cdf(1 - CHANCE / 2 / max(known, 1))
    return [_of_pair(*pair, reach) for pair in pairs]


def _of_pair(axis: str, file: str, against: str, first: Figure, its: Figure, reach: float) -> Compared:
    ratio, difference, differs = Interval(), Interval(), None
    a, b = first.found, its.found
    if first.name == "bias":
        if _is_known(a) and _is_known(b):
            off, std = _value(b) - _value(a), math.hypot(_half(a), _half(b)) / NORMAL_95
            difference = Interval(off, off - NORMAL_95 * std, off + NORMAL_95 * std)
            differs = abs(off) > reach * std
    elif a.value and b.value:
        times = b.value / a.value
        ratio = Interval(times)
        if _is_known(a) and _is_known(b):
            below = math.hypot(_log(b.value, _low(b)), _log(_high(a), a.value))
            above = math.hypot(_log(_high(b), b.value), _log(a.value, _low(a)))
            high = times * math.exp(above) if above < math.inf else None
            ratio = Interval(times, times * math.exp(-below), high)
            # The intervals need not reach equally far above and below the values. If this ratio is above 1,
            # its uncertainty towards 1 is `below`; else it is `above`.
            differs = abs(math.log(times)) > reach / NORMAL_95 * (below if times > 1 else above)
    return Compared(axis, first.name, first.unit, file, against, ratio, difference, differs)


Cells = list[tuple[Figure, Compared | None]]


def rows(reports: Sequence[FileReport]) -> Iterator[tuple[str, list[str], list[list[str]]]]:
    """Yield a table for each axis: name, headings, and rows.

    For two recordings, a row shows one figure: its values in both recordings with their intervals, and the
    second value relative to the first. For more recordings, a row shows all figures of one recording. A star
    marks each figure that differs from that of the first recording.
    """
    pairs = {(one.axis, one.file, one.figure): one for one in compared(reports)}
    labels = _labels(reports)
    for name, axes in _axes(reports):
        cells = [[(one, pairs.get((name, file, one.name))) for one in figures(axes[file])] for file in axes]
        kinds = [axis.result.verdict.kind for axis in axes.values()]
        headings, lines = (_of_two if len(labels) == 2 else _of_more)(
            [labels[file] for file in axes], cells, kinds
        )
        yield name, headings, lines


def _of_two(
    files: list[str], of_files: list[Cells], kinds: Sequence[str]
) -> tuple[list[str], list[list[str]]]:
    lines = []
    for cells in zip(*of_files, strict=True):
        pairs = [_beside(pair) for _, pair in cells if pair is not None]
        lines.append([_named(cells[0][0]), *(_shown(one) for one, _ in cells), *pairs])
    is_compared = len(lines[0]) > 1 + len(files)  # does not compare figures in different units
    lines.append(["verdict", *kinds, *[""] * is_compared])
    return ["", *files, *["second beside first"] * is_compared], lines


def _of_more(
    files: list[str], of_files: list[Cells], kinds: Sequence[str]
) -> tuple[list[str], list[list[str]]]:
    lines = []
    for file, cells, kind in zip(files, of_files, kinds, strict=True):
        shown = [_brief(one) + (" *" if pair is not None and pair.differs else "") for one, pair in cells]
        lines.append([file, *shown, kind])
    return ["", *(_named(one) for one, _ in of_files[0]), "verdict"], lines


def _axes(reports: Sequence[FileReport]) -> Iterator[tuple[str, dict[str, AxisReport]]]:
    """Yield each axis that at least two recordings have.

    A recording that the user named twice counts once.
    """
    for name in dict.fromkeys(name for report in reports for name in report.axes):
        axes = {report.name: report.axes.get(name) for report in reports}
        found = {file: axis for file, axis in axes.items() if isinstance(axis, AxisReport)}
        if len(found) > 1:
            yield name, found


def _labels(reports: Sequence[FileReport]) -> dict[str, str]:
    """Return a label for each recording: its file's name, or its path where two files have the same name."""
    names = Counter(Path(name).name for name in {report.name for report in reports})
    return {
        report.name: report.name if names[Path(report.name).name] > 1 else Path(report.name).name
        for report in reports
    }


def said(reports: Sequence[FileReport]) -> list[str]:
    """Return sentences on the figures that differ by more than chance.

    One sentence names all axes on which a figure of a recording differs.
    """
    pairs = compared(reports)
    known = [one for one in pairs if one.differs is not None]
    labels = _labels(reports)
    found = []
    differing = sorted((one for one in known if one.differs), key=_place)
    for (file, against, figure), some in groupby(differing, key=_place):
        axes = ", ".join(f"{one.axis} ({_beside(one).rstrip(' *')})" for one in some)
        of = f"{figure} of {labels[file]} differs from that of {labels[against]}"
        found.append(f"{of} by more than chance: {axes}.")
    if known and not found:
        found.append("No figure whose interval is known differs by more than chance.")
    elif len(known) > len(differing):
        found.append("Other figures whose intervals are known differ by no more than chance.")
    if len(known) < len(pairs):
        unknown = dict.fromkeys(one.figure for one in pairs if one.differs is None)
        found.append(f"Not compared, as an interval is not known: {', '.join(unknown)} of some axes.")
    return found


def _named(one: Figure) -> str:
    return f"{one.name} [{one.unit}]"


def _place(one: Compared) -> tuple[str, str, str]:
    return one.file, one.against, one.figure


def _beside(one: Compared) -> str:
    mark = " *" if one.differs else ""
    if (off := one.difference).value is not None:
        return f"{off.value:+.3g} ± {_half(off):.2g}{mark}"
    if one.ratio.value is None:
        return "–"
    ends = "" if one.ratio.low is None else f" ({_to_three(one.ratio.low)}…{_to_three(one.ratio.high)})"
    return f"× {_to_three(one.ratio.value)}{ends}{mark}"


def _shown(one: Figure) -> str:
    if one.name == "bias" and one.found.value is not None:
        return f"{one.found.value:.4g} ± {_half(one.found):.2g}"
    return without_unit(quantity_of(one.found, one.unit, one.at_most))


def _brief(one: Figure) -> str:
    if one.found.value is None:
        return "–" if one.at_most is None else f"< {_to_three(one.at_most)}"
    return f"{one.found.value:.4g}" if one.name == "bias" else _to_three(one.found.value)


def _to_three(value: float | None) -> str:
    """Return a number to three digits. Numbers below a million are written without a power of ten."""
    return "∞" if value is None else number(value)


def _is_known(one: Interval) -> bool:
    return one.value is not None and one.low is not None and one.high is not None


def _value(one: Interval) -> float:
    return math.nan if one.value is None else one.value


def _log(larger: float, smaller: float) -> float:
    return math.log(larger / smaller) if smaller > 0 else math.inf


def _low(one: Interval) -> float:
    return math.nan if one.low is None else one.low


def _high(one: Interval) -> float:
    return math.nan if one.high is None else one.high


def _half(one: Interval) -> float:
    return (_high(one) - _low(one)) / 2

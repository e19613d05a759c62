"""The page's tables: their columns, how buckets sum them up, and what an estimate puts into them (pure)."""

from collections.abc import Sequence
from typing import Literal

from fltea.records.fit import AxisFit
from fltea.records.records import AxisEstimate, AxisStats, DeviceAxisEstimate
from fltea.sinks.page.answer import order
from fltea.sinks.page.tiers import Kind, Tiers

Table = Literal["rows", "fits", "checks", "own", "compared"]
"""fits: α and f of the fit with their intervals, NaN where undefined; own: estimates of the device in place
of the host's; compared: those of the device that are compared with the host's, at its own pace."""

ESTIMATE: dict[str, Kind] = dict.fromkeys(("state", "alpha", "alpha_std", "f", "f_std"), "mean")

COMMON: dict[Table, dict[str, Kind]] = {
    "rows": {"time": "mean", "seq": "max", "temperature": "mean"},
    "fits": {"time": "mean"},
    "checks": {"time": "mean"},
    "own": {"time": "mean", "seq": "max"},
    "compared": {"time": "mean"},
}
OF_AXIS: dict[Table, dict[str, Kind]] = {
    "rows": {"y_low": "min", "y": "mean", "y_high": "max", **ESTIMATE},
    "fits": dict.fromkeys(("alpha_low", "alpha_mid", "alpha_high", "f_low", "f_mid", "f_high"), "mean"),
    "checks": dict.fromkeys(("lag1", "nis"), "mean"),
    "own": ESTIMATE,
    "compared": {
        "alpha": "mean",
        "f": "mean",
        "apart_low": "min",
        "apart": "mean",
        "apart_high": "max",
        "f_apart": "max",
    },
}
"""Columns of each axis. y: the sample without its offset; apart: α of the device minus that of the host;
f_apart: how far its f is from the host's."""


def make(table: Table, axes: int, rate_hz: float) -> Tiers:
    """An empty table. axes: how many; rate_hz: rows a second."""
    return Tiers([*COMMON[table].values(), *[*OF_AXIS[table].values()] * axes], rate_hz)


def places(table: Table, axes: Sequence[str], axis: str) -> dict[str, int]:
    """Return where the columns that concern an axis stand in a table's rows."""
    common, names = COMMON[table], OF_AXIS[table]
    first = len(common) + axes.index(axis) * len(names)
    return {name: i for i, name in enumerate(common)} | {name: first + i for i, name in enumerate(names)}


def estimate(e: AxisEstimate | None) -> list[float | None]:
    """What an estimate says, in the order of `ESTIMATE`."""
    if e is None:
        return [None] * len(ESTIMATE)
    return [e.state, e.alpha, e.alpha_std, e.f, e.f_std]


def sample(found: tuple[float, AxisEstimate | None] | None) -> list[float | None]:
    """A sample without its offset, and its estimate, in the order of the columns of `rows`."""
    y, e = found or (None, None)
    return [y, y, y, *estimate(e)]


def checks(stats: AxisStats | None) -> list[float | None]:
    """What statistics say of the innovations of an axis."""
    return [stats.innovation_lag1, stats.innovation_nis] if stats else [None, None]


def fit(found: AxisFit | None) -> list[float | None]:
    """α and f of a fit with their intervals, in the order of the table's columns."""
    if found is None:
        return [None] * len(OF_AXIS["fits"])
    row: list[float | None] = []
    for p in order(found):
        row += [p.low, p.value, p.high] if p else [None] * 3
    return row


def compared(e: DeviceAxisEstimate | None) -> list[float | None]:
    """What a device's own estimate says, in the order of the table's columns."""
    if e is None:
        return [None] * len(OF_AXIS["compared"])
    apart, f_apart = e.alpha_difference, e.f_difference
    return [e.alpha, e.f, apart, apart, apart, None if f_apart is None else abs(f_apart)]

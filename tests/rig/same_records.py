"""Compare the records of the native pipeline with those of the plain Python oracle."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import msgspec
import pytest
from fltea.records.records import AnyRecord, Error, Stats

HOST_NS = 1
"""Largest accepted difference of host times [ns]. The clock fit of the native code may add values in another
order than the oracle.

Another order changes a time by less than 1e-10 s, which sometimes changes the rounding.
"""
OF_AN_AXIS = ("constant_axis", "axis_runaway", "axis_bound")


class Comparable(NamedTuple):
    """The values of a record, divided into those that must be equal (`exact`) and those that may differ."""

    exact: Any
    host_ns: int
    rounded: list[float]


def comparable(record: AnyRecord) -> Comparable:
    if isinstance(record, Error):
        record = msgspec.structs.replace(record, message=words_of(record))
    host_ns, rounded = record.host_ns, list[float]()
    if isinstance(record, Stats):
        figures = [record.rate_hz, record.clock_ppm]
        for axis in record.axes.values():
            figures += [axis.innovation_lag1, axis.innovation_nis]
        rounded = [math.nan if one is None else one for one in figures]
        nothing = {"innovation_lag1": None, "innovation_nis": None}
        axes_ = {name: msgspec.structs.replace(one, **nothing) for name, one in record.axes.items()}
        record = msgspec.structs.replace(record, rate_hz=None, clock_ppm=None, axes=axes_)
    return Comparable(msgspec.structs.replace(record, host_ns=0), host_ns, rounded)


def words_of(error: Error) -> str:
    """Return the part of an error message that is compared: the names of the axes in it."""
    if error.kind in OF_AN_AXIS:
        return error.message.split()[0]
    if error.kind == "rate_differs":
        return error.kind
    if error.kind == "no_axis":
        return error.message.removeprefix("the setting 'channels' asks for ").partition(", which")[0]
    return error.message


def assert_same(found: Iterable[AnyRecord], expected: Iterable[AnyRecord]) -> None:
    """Check that two outputs have bitwise equal records, except for host times and sums over many samples."""
    mine = [comparable(one) for one in found]
    plain = [comparable(one) for one in expected]
    for a, b in zip(mine, plain, strict=False):
        assert a.exact == b.exact
        assert abs(a.host_ns - b.host_ns) <= (HOST_NS if hasattr(b.exact, "seq") else 0), b.exact
        if isinstance(b.exact, Stats):
            assert a.rounded == pytest.approx(b.rounded, rel=1e-9, abs=1e-9, nan_ok=True), b.exact
    assert len(mine) == len(plain)

"""Compare the records of the native pipeline with those of the plain Python oracle."""

import math
from collections.abc import Iterable, Iterator
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
    rounded: dict[str, float]


def comparable(record: AnyRecord) -> Comparable:
    if isinstance(record, Error):
        record = msgspec.structs.replace(record, message=words_of(record))
    host_ns, rounded = record.host_ns, dict[str, float]()
    if isinstance(record, Stats):
        figures = {"rate_hz": record.rate_hz, "clock_ppm": record.clock_ppm}
        for name, axis in record.axes.items():
            figures[f"axes.{name}.innovation_lag1"] = axis.innovation_lag1
            figures[f"axes.{name}.innovation_nis"] = axis.innovation_nis
        rounded = {field: math.nan if one is None else one for field, one in figures.items()}
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


def differences(found: Any, expected: Any, path: str) -> Iterator[str]:
    """Yield the paths of all fields in which two values differ, each with both values."""
    if type(found) is type(expected) and isinstance(found, msgspec.Struct):
        for name in found.__struct_fields__:
            yield from differences(getattr(found, name), getattr(expected, name), f"{path}.{name}")
    elif isinstance(found, dict) and isinstance(expected, dict) and found.keys() == expected.keys():
        for key in found:
            yield from differences(found[key], expected[key], f"{path}.{key}")
    elif found != expected:
        yield f"{path} is {found!r}, and {expected!r} by the oracle"


def assert_same(found: Iterable[AnyRecord], expected: Iterable[AnyRecord]) -> None:
    """Check that two outputs have bitwise equal records.

    Host times, and figures that are sums over many samples, may be rounded differently.
    """
    mine = [comparable(one) for one in found]
    plain = [comparable(one) for one in expected]
    for k, (a, b) in enumerate(zip(mine, plain, strict=False)):
        if a.exact != b.exact:
            name = type(a.exact).__name__
            pytest.fail(f"record {k}: " + "; ".join(differences(a.exact, b.exact, name)))
        assert abs(a.host_ns - b.host_ns) <= (HOST_NS if hasattr(b.exact, "seq") else 0), b.exact
        if isinstance(b.exact, Stats):
            assert a.rounded == pytest.approx(b.rounded, rel=1e-9, abs=1e-9, nan_ok=True), b.exact
    assert len(mine) == len(plain)

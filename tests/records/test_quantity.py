"""Tests of values in the units of data sheets and filters.

The tests are about known conversions, spellings of units, and conversions to another unit and back.
"""

import pytest
from fltea.documents.programs import programs
from fltea.records.quantity import _KINDS, Quantity, coefficient_units, factor, shown_units, without_unit
from hypothesis import given
from hypothesis import strategies as st

UNITS = [(kind.units, unit) for kind in _KINDS for unit in kind.units]


@pytest.mark.parametrize(
    ("value", "unit", "other", "expected"),
    [
        # VectorNav, Inertial Navigation Primer 6.2: 0.03 °/√hour is 0.005° after 100 s, so 0.0005 °/√s.
        (0.03, "deg/√h", "deg/√s", 0.0005),
        # The noise of an MPU-6050 is 0.005 °/s/√Hz by its data sheet. The factor to °/√h is √3600 = 60.
        (0.005, "dps/√Hz", "deg/√h", 0.3),
        (0.005, "deg/s/√Hz", "deg/h/√Hz", 18.0),
        # One arc second is 4.848137e-6 rad (IAU: 1 rad = 206264.806″), and 1 °/h is one arc second per
        # second.
        (1.0, "deg/h", "rad/s", 4.848137e-6),
        # KF-GINS, dataset/kf-gins.yaml: arw is 0.003 deg/√h, which the code of KF-GINS converts to
        # 8.726646e-7 rad/√s.
        (0.003, "deg/sqrt(h)", "rad/√s", 8.726646e-7),
        (1.0, "deg/h/√h", "deg/s/√s", 1 / 3600 / 60),
        # ISO 80000-3: g is 9.80665 m/s².
        (1.0, "mg", "m/s^2", 9.80665e-3),
        (100.0, "µg/√Hz", "m/s/√h", 100e-6 * 9.80665 * 60),
        (300.0, "ug/sqrt(Hz)", "m/s²/√Hz", 2.941995e-3),
        (1.0, "m/s^3/sqrt(Hz)", "m/s²/√s", 1.0),
    ],
)
def test_a_conversion_is_that_of_the_books(value: float, unit: str, other: str, expected: float) -> None:
    assert value * factor(unit, other) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    "spelled",
    [
        "deg/√h",
        "deg/sqrt(h)",
        "deg/rt(h)",
        "deg/rt h",
        "°/√hr",
        "DEG/SQRT(HR)",
        "deg / √(hour)",
        "deg/rt(hr)",
        "degrees/root(hour)",
    ],
)
def test_a_unit_is_known_however_it_is_spelled(spelled: str) -> None:
    assert factor("dps/√Hz", spelled) == 60.0
    assert Quantity(1.0, None, None, None, "deg/s/√Hz").to(spelled).unit == spelled


@given(
    st.sampled_from(UNITS).flatmap(lambda one: st.tuples(st.just(one[1]), st.sampled_from(sorted(one[0])))),
    st.tuples(*[st.none() | st.floats(-1e6, 1e6)] * 4),
)
def test_a_figure_is_the_same_there_and_back(
    units: tuple[str, str], ends: tuple[float | None, float | None, float | None, float | None]
) -> None:
    unit, other = units
    figure = Quantity(*ends, unit)
    back = figure.to(other).to(unit)
    for one, its in zip(ends, (back.value, back.low, back.high, back.at_most), strict=True):
        assert (one is None) == (its is None)
        assert one is None or its == pytest.approx(one, rel=1e-12, abs=1e-300)


def test_each_unit_is_that_of_one_thing() -> None:
    for units, unit in UNITS:
        assert all(factor(unit, other) > 0 for other in units)
        for others, other in UNITS:
            if others is not units:
                with pytest.raises(ValueError, match="the units of"):
                    factor(unit, other)


def test_what_is_no_unit_is_told_with_those_that_are() -> None:
    figure = Quantity(0.3, None, None, None, "deg/√h")
    with pytest.raises(ValueError, match=r"the units of N of a gyroscope are .*rad/s/√Hz.*; got 'deg/h'"):
        figure.to("deg/h")
    with pytest.raises(ValueError, match=r"got 'Mdps/√Hz'"):
        figure.to("Mdps/√Hz")  # "M" is mega, not milli
    with pytest.raises(ValueError, match=r"of K of an accelerometer .*; got 'furlong'"):
        factor("furlong", "deg/h")


def test_programs_have_the_same_factors() -> None:
    """The table of navigation programs has its own factors from rad, m and s to the units of each program.

    These factors must equal those of fltea's units.
    """
    own = {("gyro", "N"): "rad/s/√Hz", ("gyro", "B"): "rad/s", ("gyro", "K"): "rad/s/√s"}
    own |= {("accel", "N"): "m/s²/√Hz", ("accel", "B"): "m/s²", ("accel", "K"): "m/s²/√s"}
    checked = 0
    for program in programs().values():
        for entry in program.entries:
            base = own.get((entry.sensor, entry.figure))
            if base is not None and entry.power == 1 and not entry.per and "*" not in entry.unit:
                assert entry.scale == pytest.approx(factor(base, entry.unit), rel=1e-12)
                checked += 1
    assert checked > 15


@pytest.mark.parametrize(
    ("figure", "shown"),
    [
        (Quantity(0.30123, 0.2981, 0.30436, None, "deg/√h"), "0.3012 deg/√h (0.2981 … 0.3044)"),
        (Quantity(1.23475, 1.2341, 1.2354, None, "deg/s"), "1.23475 deg/s (1.2341 … 1.2354)"),
        (Quantity(-3.0, -11.0, 5.0, None, "deg/h"), "-3 deg/h (-11 … 5)"),
        (Quantity(0.0, -1.0, 1.0, None, "deg/s"), "0 deg/s (-1 … 1)"),
        (Quantity(1080.0, 1074.0, 1092.0, None, "deg/√h"), "1080 deg/√h (1074 … 1092)"),
        (Quantity(0.5, 0.25, None, None, "deg/s"), "0.5 deg/s (0.25 …)"),
        (Quantity(0.5, None, 0.75, None, "deg/s"), "0.5 deg/s (… 0.75)"),
        (Quantity(3.14159, None, None, None, "deg/h"), "3.14 deg/h"),
        (Quantity(None, None, None, 34.28, "deg/h/√h"), "at most 34.3 deg/h/√h"),
        (Quantity(None, None, None, None, "deg/h"), "not known"),
    ],
)
def test_a_figure_is_shown_as_far_as_it_is_known(figure: Quantity, shown: str) -> None:
    assert str(figure) == shown
    assert without_unit(figure) == " ".join(shown.replace(figure.unit, "").split())


@pytest.mark.parametrize(
    ("unit", "factors"), [("deg/s", (60.0, 3600.0, 3600.0 * 60)), ("m/s²", (1.0, 1.0, 1.0))]
)
def test_the_units_that_are_shown_are_those_of_data_sheets(unit: str, factors: tuple[float, ...]) -> None:
    pairs = zip(coefficient_units(unit), shown_units(unit), strict=True)
    assert tuple(1.0 if own == shown else factor(own, shown) for own, shown in pairs) == factors

"""Tests that units are understood in the spellings that people use."""

import math

import pytest
from fltea.recording.units import (
    PER_UNIT,
    accel_unit,
    is_angle,
    is_physical,
    is_unit,
    parse_accel_unit,
    parse_units,
    rate_unit,
    time_unit,
)
from fltea.records.errors import UsageError
from hypothesis import given
from hypothesis import strategies as st

ANGLES = {
    "rad": math.degrees(1),
    "mrad": math.degrees(1e-3),
    "µrad": math.degrees(1e-6),
    "deg": 1,
    "°": 1,
    "º": 1,
    "degrees": 1,
    "mdeg": 1e-3,
    "milli-deg": 1e-3,
    "arcsec": 1 / 3600,
    "″": 1 / 3600,
    "as": 1 / 3600,
    "arcmin": 1 / 60,
    "′": 1 / 60,
    "rev": 360,
    "turns": 360,
    "cycle": 360,
}
TIMES = {"s": 1, "sec": 1, "second": 1, "min": 60, "h": 3600, "hr": 3600, "hour": 3600}
BETWEEN = (
    "{}/{}",
    "{} / {}",
    "{} per {}",
    "{}_per_{}",
    "{}_{}",
    "[{}/{}]",
    "({})/({})",
    "{} {}^-1",
    "{}·{}⁻¹",
    "{} {}**-1",
)


@given(
    st.sampled_from(sorted(ANGLES)), st.sampled_from(sorted(TIMES)), st.sampled_from(BETWEEN), st.booleans()
)
def test_any_angle_per_any_time_is_a_rate(angle: str, time: str, between: str, capitals: bool) -> None:
    text = between.format(angle, time)
    factor, lsb = parse_units(text.upper() if capitals and "µ" not in text else text)
    assert factor == pytest.approx(ANGLES[angle] / TIMES[time], rel=1e-12)
    assert lsb is None


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("dps", "deg/s"),
        ("mdps", "mdeg/s"),
        ("MDPS", "mdeg/s"),
        ("dph", "deg/h"),
        ("degph", "deg/h"),
        ("radps", "rad/s"),
        ("rads", "rad/s"),
        ("rads^-1", "rad/s"),
        ("rad.s-1", "rad/s"),
        ("rad s^{-1}", "rad/s"),
        ("rpm", "rev/min"),
        ("r/min", "rev/min"),
        ("mas/s", "marcsec/s"),
        ("Â°/s", "deg/s"),
        ("degpersec", "deg/s"),
    ],
)
def test_short_and_odd_spellings(text: str, name: str) -> None:
    assert rate_unit(text) == name


@pytest.mark.parametrize(
    "text",
    [
        "rps",
        "r/s",
        "d/s",
        "deg",
        "rad",
        "rad/s^2",
        "deg/s/s",
        "deg/√h",
        "deg/s/√Hz",
        "deg s",
        "Hz",
        "m/s",
        "",
    ],
)
def test_what_is_no_rate_or_may_be_two_is_unknown(text: str) -> None:
    assert rate_unit(text) is None
    with pytest.raises(UsageError, match="not a unit that this program knows"):
        parse_units(text)


def test_the_names_of_units_are_units() -> None:
    assert {rate_unit(name) for name in PER_UNIT} == set(PER_UNIT)
    assert all(parse_units(name) == (factor, None) for name, factor in PER_UNIT.items())


@pytest.mark.parametrize(
    ("text", "ms2"),
    [
        *[
            (text, 1.0)
            for text in ("m/s²", "m/s^2", "m/(s^2)", "m/s2", "m/s/s", "m s^-2", "ms-2", "ms2", "m/s**2")
        ],
        *[(text, 1.0) for text in ("m_s2", "m_per_s2", "M/S^2", "meters/s^2", "metres per second squared")],
        ("mm/s²", 1e-3),
        ("cm/s^2", 1e-2),
        ("ft/s^2", 0.3048),
        ("g", 9.80665),
        ("G", 9.80665),
        ("gn", 9.80665),
        ("mg", 9.80665e-3),
        ("mG", 9.80665e-3),
        ("milli-g", 9.80665e-3),
        ("µg", 9.80665e-6),
        ("Gal", 1e-2),
        ("mGal", 1e-5),
        *[(text, None) for text in ("m/s", "m/s^-2", "m", "ms", "gauss", "s2", "mm", "deg/s", "", "kg")],
    ],
)
def test_accelerations(text: str, ms2: float | None) -> None:
    assert accel_unit(text) == (None if ms2 is None else pytest.approx(ms2, rel=1e-12))


def test_counts_of_both_sensors() -> None:
    assert parse_units("lsb:16.4") == (1.0, 16.4)
    assert parse_accel_unit("lsb:16384") == (pytest.approx(9.80665 / 16384), 16384)
    assert parse_accel_unit("mg") == (pytest.approx(9.80665e-3), None)
    with pytest.raises(
        UsageError, match=r"--accel-units dps: not a unit .* m/s\^2, cm/s\^2, mm/s\^2, g, mg, or lsb:N"
    ):
        parse_accel_unit("dps")


@pytest.mark.parametrize(
    "text", ["lsb", "lsb:", "lsb:0", "lsb:-1", "lsb:nan", "lsb:inf", "lsb:x", "131", "x:131"]
)
def test_counts_without_their_scale_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="not a unit"):
        parse_units(text)


def test_times() -> None:
    found = [time_unit(text) for text in ("s", "[ms]", "µs", "μs", "us", "Nanoseconds", "min", "deg/s")]
    assert found == ["s", "ms", "us", "us", "us", "ns", None, None]


def test_units_of_other_columns_are_units_and_names_are_none() -> None:
    known = (
        "µT uT gauss local_flux mV V hPa °C deg_c % m no_units unitless count dBm adc kohms - deg [rad] ms g"
    )
    assert [text for text in known.split() if not is_unit(text)] == []
    assert [
        text for text in ("", "gx", "t", "time", "x", "nan", "null", "1.5", "w", "x" * 1000) if is_unit(text)
    ] == []
    assert [text for text in ("-", "count", "lsb", "no_units", "?") if is_physical(text)] == []
    assert [is_angle(text) for text in ("°", "°/s")] == [True, False]


@given(st.text(max_size=60))
def test_any_text_is_a_unit_or_none(text: str) -> None:
    unit = rate_unit(text)
    assert unit is None or unit in PER_UNIT
    assert is_unit(text) >= (unit is not None or accel_unit(text) is not None or time_unit(text) is not None)

"""An error message shows candidates for what a file does not state (units, rates). Its figures are correct,
and no value is suggested without evidence.
"""

import math
import re
import warnings

import numpy as np
import pytest
from fltea.recording.candidates import (
    COUNTS,
    GRAVITY,
    GRAVITY_COUNTS,
    MOST_COLUMNS,
    UNITS,
    columns_table,
    gravity_units,
    is_rising,
    times_table,
    units_table,
)
from fltea.recording.sample_times import PLAUSIBLE_HZ, SECONDS
from fltea.recording.units import parse_units
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

ROWS = 2000
NOISE = np.random.default_rng(7).normal(size=(ROWS, 3))
OPTION = re.compile(r"--([\w-]+) (\S+)")


def lines_of(table: str) -> dict[str, tuple[str, list[float], list[float]]]:
    """Return the rows of a message's table of candidate units, by unit. A row consists of the name of the
    noise figure (N or σ), this figure for each axis, and the mean of the samples [deg/s] of each axis.
    """
    found = {}
    for line in table.split("\n"):
        if (option := OPTION.search(line)) is not None:
            shown, means = line[option.end() :].strip().split("; mean in deg/s ")
            what, figures = re.split(r"(?<=eg/s|g/√h) ", shown)
            means = means.partition("  (")[0]
            found[option[2]] = what, [*map(float, figures.split(", "))], [*map(float, means.split(", "))]
    return found


LOGARITHM = st.floats(-3, 3).map(lambda exponent: 10**exponent)


@given(
    n=st.tuples(LOGARITHM, LOGARITHM, LOGARITHM),
    mean=st.tuples(*[st.floats(-50, 50)] * 3),
    rate_hz=st.none() | st.sampled_from([10.0, 100.0, 1600.0]),
    unit=st.sampled_from(UNITS),
    slope=st.floats(-1, 1),
)
def test_noise_and_mean_are_those_of_the_data(
    n: tuple[float, ...], mean: tuple[float, ...], rate_hz: float | None, unit: str, slope: float
) -> None:
    """The rates are white noise with a density N in deg/√h, and a drift. The tolerance includes rounding,
    since the table of units shows two digits.
    """
    std = np.array(n) * math.sqrt(rate_hz or 3600) / 60
    drift = slope * std * np.linspace(-0.5, 0.5, ROWS)[:, np.newaxis] * 20
    dps = NOISE * std + drift + mean
    found = lines_of(units_table(dps / parse_units(unit)[0], rate_hz))
    assert [*found] == [*UNITS]
    what, figures, means = found[unit]
    assert what == ("σ in deg/s" if rate_hz is None else "N in deg/√h")
    error = 5 / math.sqrt(ROWS) + 0.05
    assert figures == pytest.approx(n, rel=error)
    assert means == pytest.approx(dps.mean(axis=0), rel=0.051, abs=1e-9)
    for other, (_, others, _) in found.items():
        assert others == pytest.approx(np.array(n) * parse_units(other)[0] / parse_units(unit)[0], rel=error)


@given(st.sampled_from([0.0, 0.5]), st.sampled_from([131.0, 16.4, 1000.0]))
def test_counts_come_into_question_where_all_numbers_are_whole(fraction: float, scale: float) -> None:
    table = units_table(np.rint(NOISE * scale) + fraction, 100.0)
    found = lines_of(table)
    assert [*found] == [*UNITS, *(COUNTS if not fraction else ())]
    assert table.endswith("mean of up to some 10 deg/s.")


def test_where_a_dialect_knows_what_it_may_be_only_that_is_shown() -> None:
    when = {"rad/s": "one sketch", "lsb:10": "another"}
    table = units_table(NOISE, 100.0, when)
    assert [*lines_of(table)] == [*when]
    assert all(f"({why})" in table for why in when.values())


def test_too_few_rows_show_nothing() -> None:
    values = np.full((9, 3), np.nan)
    values[:2] = 1.0
    assert units_table(values, 100.0) == units_table(np.empty((0, 3)), None) == ""
    assert columns_table(None, values[:2]) == ""


def test_steps_of_a_coarse_sensor_are_noise_too() -> None:
    """A coarse sensor repeats most values, so the median difference of neighbouring samples is 0. The noise
    shown must not be 0: it is the standard deviation of the samples.
    """
    values = (np.random.default_rng(1).random((ROWS, 3)) < 0.2).astype(float)
    figures = lines_of(units_table(values, None))["deg/s"][1]
    assert figures == pytest.approx(values.std(axis=0), rel=0.1)


# --- gravity ---

DIRECTIONS = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda one: math.hypot(*one) > 0.1)
OF_COUNTS = {f"lsb:{g}": float(g) for g in GRAVITY_COUNTS}


def at_rest(direction: tuple[float, ...], offset: tuple[float, ...], g: float) -> np.ndarray:
    """Return samples of an accelerometer at rest, with noise of 0.5 % of gravity and an offset on each axis.

    The three offsets, as a vector, are at most 5 % of gravity. `g`: gravity in the unit of the samples.
    """
    there = np.array(direction) / math.hypot(*direction)
    off = np.array(offset) / math.sqrt(3)
    return g * (there + off + 0.005 * NOISE[:200])


@given(DIRECTIONS, st.tuples(*[st.floats(-0.05, 0.05)] * 3), st.sampled_from([*GRAVITY]))
def test_gravity_tells_the_unit_whatever_the_orientation(
    direction: tuple[float, ...], offset: tuple[float, ...], unit: str
) -> None:
    values = at_rest(direction, offset, GRAVITY[unit])
    values[::7] = np.nan
    alike = ["mg", "cm/s^2"]
    assert gravity_units(values) == (alike if unit in alike else [unit])


@given(DIRECTIONS, st.tuples(*[st.floats(-0.05, 0.05)] * 3), st.sampled_from([*OF_COUNTS, "mg", "mm/s^2"]))
def test_whole_numbers_may_be_counts_and_are_never_taken_for_others(
    direction: tuple[float, ...], offset: tuple[float, ...], unit: str
) -> None:
    """Gravity is 9,807 in mm/s², and 8,192 in counts of a sensor with 8,192 counts per g. A sensor at rest
    with an offset may show a whole number between these, which could be in either unit. In this case, no unit
    is shown.
    """
    g = OF_COUNTS.get(unit) or GRAVITY[unit]
    found = gravity_units(np.rint(at_rest(direction, offset, g)))
    alike = ["mg", "cm/s^2"] if unit == "mg" else [unit]
    assert found == alike or (not found and unit in ("lsb:8192", "mm/s^2"))


@given(st.floats(0.1, 1e4).filter(lambda size: all(abs(size / g - 1) > 0.25 for g in GRAVITY.values())))
def test_what_has_another_length_or_moves_is_no_gravity(size: float) -> None:
    assert gravity_units(at_rest((0.3, -0.5, 0.8), (0, 0, 0), size)) == []
    assert gravity_units(NOISE[:200] * size) == []
    assert gravity_units(np.full((9, 3), np.nan)) == []


# --- tables of columns and times ---

ANY = st.floats(width=64) | st.sampled_from([0.0, 1.0, 1e-308, 1e99, 1e300, -1e308])


@given(npst.arrays(np.float64, st.tuples(st.integers(3, 8), st.integers(1, 5)), elements=ANY))
def test_any_numbers_give_a_table_without_a_warning_or_a_value_to_take_over(values: np.ndarray) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        named = columns_table(["a", "--rate 5", "c", "d", "e"][: values.shape[1]], values)
        units_table(values, 100.0)
        bare = columns_table(None, values)
    assert OPTION.search(bare) is None
    assert len(bare.split("\n")) == len(named.split("\n")) == values.shape[1] + 1
    assert "inf" not in bare
    assert not re.search(r"\bnan\b", bare)


def test_the_columns_are_told_by_what_they_show() -> None:
    seconds = np.arange(100)[:, np.newaxis] / 50
    accel = at_rest((1, 2, 3), (0.01, 0, 0), GRAVITY["m/s^2"])[:100]
    values = np.hstack([seconds, NOISE[:100], accel, np.full((100, 1), np.nan)])
    names = ["when", "p", "q", "r", "s", "u", "v", "note"]
    lines = columns_table(names, values).split("\n")[1:]
    assert lines[0].startswith("  1  when: mean 0.99, σ 0.577: rises, as times and counters do (s: 50 Hz")
    assert all("gravity" not in line and "rises" not in line for line in lines[1:4])
    for line in lines[4:7]:
        assert re.search(r": columns 5 to 7 have the length 9\.\d+, which is gravity in m/s\^2$", line)
    assert lines[7] == "  8  note: no numbers"


def test_a_wide_table_is_cut() -> None:
    lines = columns_table(None, np.zeros((5, MOST_COLUMNS + 3))).split("\n")
    assert len(lines) == MOST_COLUMNS + 2
    assert lines[-1] == f"  … {MOST_COLUMNS + 3} columns in all"


@given(st.floats(1e-9, 1e9))
def test_units_of_times_are_shown_with_the_rate_that_each_means(step: float) -> None:
    shown = dict(re.findall(r"--time-unit (\w+): (\S+) Hz", "\n".join(times_table(step))))
    for unit, unit_s in SECONDS.items():
        rate_hz = 1 / (step * unit_s)
        if PLAUSIBLE_HZ[0] <= rate_hz <= PLAUSIBLE_HZ[1]:
            assert float(shown[unit]) == pytest.approx(rate_hz, rel=1e-5)
        # units that give a somewhat slower or faster sampling rate than usual may be shown, too
        elif unit in shown:
            assert PLAUSIBLE_HZ[0] / 6 < rate_hz < PLAUSIBLE_HZ[1] * 3
    assert times_table(-step) == times_table(0.0) == []


@pytest.mark.parametrize(
    ("column", "rises"),
    [([1, 2, 3], True), ([1, 1, 2], True), ([1, 1, 1], False), ([1, 3, 2], False), ([1, np.nan, 2], False)],
)
def test_what_rises(column: list[float], rises: bool) -> None:
    assert is_rising(np.array(column)) == rises

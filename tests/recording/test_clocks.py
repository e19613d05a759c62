"""Tests which columns of times count as a sensor's clock. The times are rounded, come in bursts, are in a
wrong unit, or are times of day written as numbers.
"""

import math
from collections.abc import Sequence
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.clocks import clock_of
from fltea.recording.csv_file import open_csv
from fltea.recording.reading import ASK
from fltea.recording.sample_numbers import Numbering
from fltea.recording.sample_times import Elapsed, Floats
from fltea.records.events import Trouble
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.rig.text_files import refusal, stored

N = 4000
SEEDS = st.integers(0, 1 << 20)


def table(times: Sequence[object] | NDArray[Any], name: str = "time_s") -> str:
    values = np.random.default_rng(0).normal(size=len(times))
    rows = zip(times, values, strict=True)
    return f"{name},gyro_x_dps\n" + "".join(f"{time},{value:.4f}\n" for time, value in rows)


def fixed(times: Floats, digits: int = 6) -> list[str]:
    return [f"{time:.{digits}f}" for time in times]


def assert_asks_the_rate(text: str) -> None:
    """Check that the message asks for the rate, and suggests no value for it from the uneven times."""
    command = text.partition(ASK)[2].partition("\n")[0]
    assert command == "--rate ?"


# --- an impossible unit ---


@pytest.mark.parametrize(("step", "unit"), [(10, "ms"), (1, "ms"), (10_000, "us"), (5_000_000, "ns")])
def test_a_stated_unit_that_gives_no_rate_of_a_gyroscope_is_not_believed(
    step: int, unit: str, tmp_path: Path
) -> None:
    text = table(step * np.arange(N), "t_s")
    asked = refusal(tmp_path, text)
    assert f"nothing says the rate: a step of {step:.6g} s is no gyroscope" in asked
    assert_asks_the_rate(asked)
    rate_hz = {"ms": 1e3, "us": 1e6, "ns": 1e9}[unit] / step
    assert f"  --time-unit {unit} --overrule: {rate_hz:g} Hz" in asked
    assert stored(tmp_path, text, time_unit=unit, overrule=True).rate_hz == pytest.approx(rate_hz)
    assert stored(tmp_path, text, rate_hz=rate_hz).rate_hz == rate_hz
    assert "says otherwise" in refusal(tmp_path, text, rate_hz=rate_hz * 1.7)
    for slow in ({"overrule": True}, {"rate_hz": 1 / step}) if step < 100 else ():
        assert stored(tmp_path, text, **slow).rate_hz == pytest.approx(1 / step)


@pytest.mark.parametrize("text", [table(10 * np.arange(N), "timestamp"), "gyro_x_dps\n" + "1\n2\n" * 9])
def test_a_period_is_no_rate(text: str, tmp_path: Path) -> None:
    assert "--rate 0.0001 would be a sample in 1e+04 s" in refusal(tmp_path, text, rate_hz=1e-4)


# --- times that are uneven or misread ---


def test_parts_of_seconds_that_are_not_padded_advise_no_rate(tmp_path: Path) -> None:
    """`printf("%d.%d", seconds, microseconds)` writes 0.01 s as 0.10000."""
    asked = refusal(tmp_path, table([f"{k // 100}.{k % 100 * 10_000}" for k in range(N)]))
    assert_asks_the_rate(asked)
    assert "too uneven for a sensor's clock" in asked


@pytest.mark.parametrize("separator", [",", " ", "\t"])
def test_the_minus_of_typography_is_one(separator: str, tmp_path: Path) -> None:
    text = table(fixed(np.arange(N) / 100)).replace(",", separator)
    found = stored(tmp_path, text.replace("-", "\N{MINUS SIGN}")).whole()
    assert found.gyro.tolist() == stored(tmp_path, text).whole().gyro.tolist()


def test_how_many_lines_are_left_out_is_told(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    text = table(fixed(np.arange(N) / 100)).splitlines()
    text[2:] = [line if random.random() < 0.35 else f"{line}x" for line in text[2:]]
    asked = refusal(tmp_path, "\n".join(text))
    assert_asks_the_rate(asked)
    count = sum(line.endswith("x") for line in text)
    assert f"{count} of {N + 1} lines hold no sample; the first is " in asked


@pytest.mark.parametrize("begin_s", [0, 9 * 3600 + 59 * 60 + 50, 12 * 3600, 86_390])
@pytest.mark.parametrize(("name", "per_s"), [("time", 1), ("time_ms", 1000)])
def test_times_of_day_without_colons_go_on_at_each_minute(
    begin_s: int, name: str, per_s: int, tmp_path: Path
) -> None:
    """As times of day, 95959.99 and 100000.00 are 0.01 s apart. At midnight, the number returns to 0."""
    lost = {1005, 5000, 5001}
    k = np.array([one for one in range(7000) if one not in lost])
    s = (begin_s * 100 + k) % 8_640_000
    clock = s // 360_000 * 10_000 + s // 6000 % 60 * 100 + s % 6000 / 100
    found = stored(tmp_path, table([f"{one:.3f}" for one in clock * per_s], name))
    whole = found.whole()
    assert found.rate_hz == pytest.approx(100)
    assert whole.seq is not None
    assert whole.seq.tolist() == k.tolist()
    assert whole.epoch is None or not np.any(whole.epoch)
    assert "hhmmss" in str(found.reading[-1])


# --- bursts ---


@given(st.integers(2, 100), SEEDS, st.floats(0, 0.2))
def test_rows_in_bursts_are_no_clock(rows: int, seed: int, jitter: float) -> None:
    random = np.random.default_rng(seed)
    burst, place = np.divmod(np.arange(40 * rows), rows)
    times = burst * rows / 100 + place * 2e-4 + np.repeat(random.uniform(0, jitter * rows / 100, 40), rows)
    elapsed = Elapsed("s")
    clock = clock_of(lambda: [elapsed.add(times, times[:, np.newaxis])[0]], elapsed)
    assert clock is not None
    assert not clock.even
    assert clock.bursts is not None
    assert clock.bursts.rows == rows
    assert clock.bursts.every == pytest.approx(rows / 100, rel=0.1 + jitter)


def test_bursts_ask_for_the_rate(tmp_path: Path) -> None:
    burst, place = np.divmod(np.arange(N), 10)
    text = table(fixed(burst * 0.1 + place * 2e-4))
    asked = refusal(tmp_path, text)
    assert_asks_the_rate(asked)
    assert "the rows come in bursts, 10 every 0.1 s" in asked
    assert "these times give 100 Hz" in asked
    found = stored(tmp_path, text, rate_hz=100.0)
    assert (found.samples, found.rate_hz) == (N, 100.0)
    assert found.whole().seq.tolist() == [*range(N)]  # type: ignore[union-attr]


def test_a_logger_that_sleeps_most_of_the_time_is_read_with_its_rate(tmp_path: Path) -> None:
    burst, place = np.divmod(np.arange(N), 100)
    text = table(fixed(burst * 10 + place / 100))
    assert "in bursts" in refusal(tmp_path, text)
    whole = stored(tmp_path, text, rate_hz=100.0).whole()
    assert whole.seq is not None
    assert whole.seq.tolist() == (burst * 1000 + place).tolist()


@given(SEEDS, st.floats(0.0, 0.4), st.integers(0, 3), st.integers(2000, 6000))
def test_losses_and_pauses_are_no_bursts(seed: int, loss: float, pauses: int, pause: int) -> None:
    random = np.random.default_rng(seed)
    k = np.flatnonzero(random.random(N) >= loss)
    for place in random.integers(1, len(k), pauses):
        k[place:] += pause
    elapsed = Elapsed("s")
    times, _ = elapsed.add(k / 100, random.normal(size=(len(k), 1)))
    clock = clock_of(lambda: [times], elapsed)
    assert clock is not None
    assert clock.bursts is None
    assert clock.even == (loss < 0.44)


# --- rounded times ---


@given(st.sampled_from([*range(150, 1000, 13), 476, 833, 952, 990, 999]), st.floats(0, 1), SEEDS)
def test_rounded_times_tell_the_rate_and_no_losses(rate_hz: float, begin: float, seed: int) -> None:
    """Samples at 952 Hz whose times are in whole ms must not be read as 1000 Hz with every twentieth sample
    missing.
    """
    elapsed = Elapsed("ms")
    values = np.random.default_rng(seed).normal(size=(N, 1))
    times, begins = elapsed.add(np.floor(begin + np.arange(N) * 1000 / rate_hz), values)
    clock = clock_of(lambda: [times], elapsed)
    assert clock is not None
    assert clock.even
    assert 1000 / clock.typical == pytest.approx(rate_hz, rel=1.5e-3)
    numbers = Numbering(clock.typical, 1000 / clock.typical, is_rounded=clock.is_rounded)
    assert numbers.add(times, begins).sequence[-1] <= N + 5


@pytest.mark.parametrize("rate_hz", [208, 416, 500, 800, 833, 952, 1000])
@pytest.mark.parametrize("loss", [0.005, 0.02, 0.04])
def test_rounded_times_tell_samples_that_are_missing(rate_hz: float, loss: float, tmp_path: Path) -> None:
    k = np.flatnonzero(np.random.default_rng(3).random(3 * N) >= loss)
    found = stored(tmp_path, table(np.floor(k * 1000 / rate_hz + 1e-6).astype(int), "time_ms"))
    assert found.rate_hz == pytest.approx(rate_hz, rel=2e-3)
    whole = found.whole()
    assert whole.seq is not None
    lost = k[-1] - k[0] + 1 - len(k)
    assert whole.seq[-1] + 1 - len(k) == pytest.approx(lost, abs=3 + 0.02 * lost)


def test_a_clock_that_is_just_coarser_than_the_samples_is_refused(tmp_path: Path) -> None:
    """At 1010 Hz with times in whole ms, every hundredth sample repeats the time of the sample before it."""
    text = table(np.floor(np.arange(N) / 1.01).astype(int), "time_ms")
    asked = refusal(tmp_path, text)
    assert_asks_the_rate(asked)
    assert "the clock is coarser than the samples" in asked
    assert stored(tmp_path, text, rate_hz=1010.0).whole().seq.tolist() == [*range(N)]  # type: ignore[union-attr]


def test_rows_that_stand_twice_are_told_once(tmp_path: Path) -> None:
    lines = table(fixed(np.arange(N) / 100)).splitlines(keepends=True)
    path = tmp_path / "rest.csv"
    path.write_text(lines[0] + "".join(2 * line for line in lines[1:]))
    found = open_csv(path, How())
    (note,) = found.notes
    assert f"{N} rows have the time of the row before them, and are left out" in note.text
    assert found.samples == len(found.whole().gyro) == N


@pytest.mark.parametrize("rows", [1, 10])
def test_the_table_of_units_shows_n_only_where_the_rate_is_known(rows: int, tmp_path: Path) -> None:
    burst, place = np.divmod(np.arange(N), rows)
    text = table(fixed(burst * rows / 100 + place * 2e-4)).replace("gyro_x_dps", "gx")
    asked = refusal(tmp_path, text)
    assert ("N in deg/√h" in asked) == (rows == 1)
    assert ("σ in deg/s" in asked) == (rows == 10)


def test_a_sentence_with_a_wrong_checksum_names_no_columns(tmp_path: Path) -> None:
    sentences = [f"$PIMU,{10 * k},{math.sin(k):.4f},1.0000,2.0000" for k in range(N)]
    sums = [reduce(xor, line[1:].encode()) ^ (k % 3 == 0) for k, line in enumerate(sentences)]
    text = "".join(f"{line}*{check:02X}\n" for line, check in zip(sentences, sums, strict=True))
    how = {"columns": ["3", "4", "5"], "units": "dps", "time_column": "2", "time_unit": "ms"}
    found = stored(tmp_path, text, **how)
    assert found.samples == N - len(range(0, N, 3))
    assert "columns: 3, 4, 5 as x, y, z" in "; ".join(f"{one.question}: {one}" for one in found.reading)


def test_live_rows_in_bursts_tell_no_rate() -> None:
    live = TextEvents("stdin:", How(units="dps"), fatal=False)
    live.open(0, within_line=False)
    burst, place = np.divmod(np.arange(N), 10)
    events = live.feed(table(fixed(burst * 0.1 + place * 2e-4)).encode(), 0)
    assert "no_rate" in [event.kind for event in events if isinstance(event, Trouble)]

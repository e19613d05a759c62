"""Simulated noise is reproducible and has the sensor's scale, and every key of the URL is checked."""

import time

import numpy as np
import pytest
from fltea.records.errors import UsageError
from fltea.records.events import RawBlock
from fltea.records.records import Hello
from fltea.sources.synthetic import NoiseSettings, SyntheticSource, parse_noise

from tests.rig.blocks import in_samples


def events(query: str) -> list:
    return in_samples(SyntheticSource(query, realtime=False).events())


def gyro(query: str) -> np.ndarray:
    return np.array([raw.gyro for raw in events(query)[1:]])


def test_every_key_is_read() -> None:
    query = (
        "?alpha=0.5&f=-2&Q=0.1&R=0.03&offset_dps=1&rate_hz=200&lsb_per_dps=131&range_dps=250"
        "&seed=9&window=50&n=7"
    )
    assert parse_noise(query) == NoiseSettings(0.5, -2.0, 0.1, 0.03, 1.0, 200.0, 131.0, 250.0, 9, 50, 7)
    assert parse_noise("") == parse_noise("?") == NoiseSettings()


def test_hello_and_samples() -> None:
    first, *rest = events("?n=300&rate_hz=50")
    assert (first.rate_hz, first.sampling_mode) == (50.0, "simulated")
    assert (first.gyro_lsb_per_dps, first.gyro_range_dps) == (16.4, 2000.0)
    assert first.source == "synthetic:?n=300&rate_hz=50"
    assert [(raw.sequence, raw.device_us, raw.host_ns) for raw in rest] == [
        (k, 20_000 * k, 20_000_000 * k) for k in range(300)
    ]
    assert all(len(raw.gyro) == 3 and all(count.is_integer() for count in raw.gyro) for raw in rest)


def test_same_seed_same_samples() -> None:
    assert events("?n=50&seed=3") == events("?n=50&seed=3")
    assert (gyro("?n=50&seed=3") != gyro("?n=50&seed=4")).any()


def test_axes_are_independent() -> None:
    correlation = np.corrcoef(gyro("?n=2000&Q=0").T)
    assert np.abs(correlation - np.eye(3)).max() < 0.1


def test_scale_and_offset() -> None:
    counts = gyro("?n=2000&Q=0&R=0.04&lsb_per_dps=131&offset_dps=-3")
    assert counts.mean(axis=0) / 131 == pytest.approx([-3] * 3, abs=0.03)
    assert counts.std(axis=0) / 131 == pytest.approx([0.2] * 3, rel=0.1)


def test_unquantised() -> None:
    first, *rest = events("?n=20&lsb_per_dps=0")
    assert first.gyro_lsb_per_dps is None
    assert any(value != round(value, 6) for raw in rest for value in raw.gyro)


def test_saturates_at_the_range() -> None:
    # 2000 deg/s would be 32800 LSB, which is beyond int16
    assert set(gyro("?n=20&offset_dps=5000").ravel()) == {32767}
    assert set(gyro("?n=20&offset_dps=-5000&range_dps=100&lsb_per_dps=10").ravel()) == {-1000}


@pytest.mark.slow
def test_wraps_like_a_device() -> None:
    *_, last = events("?n=65537&rate_hz=10&window=1&Q=0")
    assert last.sequence == 0
    assert last.device_us == 65536 * 100_000 - 2**32


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("?alfa=1", "`alfa`|Known keys: alpha, f, Q, R"),
        ("?alpha", "alpha"),
        ("?alpha=x", "alpha"),
        ("?n=1.5", "`$.n`"),
        ("?n=-5", "n has to be 0"),
        ("?alpha=nan", "alpha has to be a finite number"),
        ("?f=inf", "f has to be a finite number"),
        ("?f=1000", "runs away where f is positive"),
        ("?alpha=2.5", "alpha = 2.5: such noise runs away"),
        ("?alpha=1e308", "alpha = 1e+308: such noise runs away"),
        ("?offset_dps=nan", "offset_dps has to be a finite number"),
        ("?rate_hz=0", "rate_hz has to be positive"),
        ("?rate_hz=nan", "rate_hz has to be a finite number"),
        ("?Q=-1", "Q is a variance"),
        ("?lsb_per_dps=-1", "lsb_per_dps must be > 0"),
        ("?lsb_per_dps=nan", "lsb_per_dps has to be a finite number"),
        ("?range_dps=0", "full_scale_dps must be > 0"),
        ("?seed=-1", "non-negative"),
        ("?window=0", "window has to be 1 to"),
    ],
)
def test_bad_query_is_refused_before_the_first_sample(query: str, words: str) -> None:
    with pytest.raises(UsageError) as caught:
        SyntheticSource(query, realtime=False)
    assert str(caught.value).startswith(f"synthetic:{query}: ")
    for word in words.split("|"):
        assert word in str(caught.value)


def test_own_pace_counts_from_now(now_ns: list[int]) -> None:
    now_ns[0] = 5_000
    source = SyntheticSource("?n=30", realtime=True)
    assert source.unix_offset_ns == 10**18
    for event in source.events():
        assert now_ns[0] == event.host_ns
    assert now_ns[0] == 5_000 + 29 * 10_000_000
    assert SyntheticSource("?n=30", realtime=False).unix_offset_ns == 0


def test_endless_until_closed() -> None:
    source = SyntheticSource("?window=10", realtime=False)
    found = []
    for event in source.events():
        found.append(event)
        if len(found) == 30:
            source.close()
    assert len(found) == 30
    assert source.link_stats().frames == 0


def test_close_ends_a_long_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    source = SyntheticSource("?rate_hz=0.001&window=10&f=-0.1", realtime=True)
    monkeypatch.setattr(time, "sleep", lambda seconds: source.close())
    assert [type(event) for event in source.events()] == [Hello, RawBlock]

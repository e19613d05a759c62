"""The live fit of a sensor: its results are the same for any division into blocks, and after a restart."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.identification.sums import examined
from fltea.records.arrays import Array
from fltea.records.fit import AxisFit
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import FEWEST_SAMPLES, POINTS, LiveAxes
from fltea.spectrum.verdict import decide
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.identify_support import H, long_recursion, white

AXES = ("gyro_x", "gyro_y")


def live(config: LiveConfig | None = None, saved: bytes | None = None) -> LiveAxes:
    return LiveAxes(AXES, H, config or LiveConfig(), "deg/s", saved)


def two(n: int, seed: int = 0) -> Array:
    """Return samples of two axes: one with noise of a known order, and one with white noise."""
    known = long_recursion(0.8, -0.025, n, seed) + white(n, 1, seed + 50)[0] / np.sqrt(3)
    return np.column_stack([known, white(n, 1, seed + 90)[0]])


def test_what_is_known_after_ten_minutes() -> None:
    axes = live()
    axes.add(two(60_000, 8))
    known, plain = axes.fit(curves=True).values()
    assert known.verdict == "fractional or relaxations"
    for interval, truth in ((known.alpha, 0.8), (known.f, -0.025 * H**-0.8), (known.s2, 1), (known.R, 1 / 3)):
        assert interval.low < truth < interval.high
    assert known.until_s.seconds == 0
    assert plain.verdict == "white"
    assert plain.alpha.low is None
    assert plain.until_s.seconds is None
    for fit in (known, plain):
        assert fit.unit == "deg/s"
        assert not any(fit.left_out.values())
        assert 50 < len(fit.spectrum.hz) <= POINTS
        assert fit.allan.tau_s[0] == H
        assert fit.allan.adev[0] == pytest.approx(fit.allan.model[0], rel=0.05)
        msgspec.json.encode(fit)


def test_until_is_kept() -> None:
    axes, y = live(), two(9000, 1)
    axes.add(y[:3000])
    until = axes.fit(curves=False)["gyro_x"].until_s
    assert 20 < until.seconds < 200


@settings(deadline=None, max_examples=8)
@given(st.lists(st.integers(1, 2500), min_size=1, max_size=6))
def test_any_blocks(sizes: list[int]) -> None:
    y = two(6000, 2)
    whole, parts = live(), live()
    whole.add(y)
    for size in sizes:
        parts.add(y[parts.samples : parts.samples + size])
    parts.add(y[parts.samples :])
    assert parts.fit(curves=True) == whole.fit(curves=True)


def test_looks_on_the_way_hardly_change_the_end() -> None:
    """A fit that starts at the parameters of the previous fit gives the result of a fit from all starting
    points.
    """
    y = two(20_000, 3)
    often, once = live(), live()
    for begin in range(0, len(y), 500):
        often.add(y[begin : begin + 500])
        often.fit(curves=False)
    once.add(y)
    looked, at_once = often.fit(curves=False)["gyro_x"], once.fit(curves=False)["gyro_x"]
    assert looked.verdict == at_once.verdict
    assert looked.alpha.value == pytest.approx(at_once.alpha.value, abs=2e-3)
    assert looked.alpha.high == pytest.approx(at_once.alpha.high, abs=4e-3)


def test_saved_and_gone_on() -> None:
    y = two(12_000, 4)
    one = live()
    one.add(y[:5000])
    other = live(saved=one.save())
    for axes in (one, other):
        axes.skip(100)
        axes.add(y[5000:])
    assert other.samples == 12_000
    assert other.fit(curves=True) == one.fit(curves=True)
    assert other.fit(curves=False)["gyro_x"].left_out["lost"] == 100


def test_what_was_saved_is_a_stranger_s() -> None:
    axes = live()
    axes.add(two(4000, 5))
    saved = axes.save()
    with pytest.raises(ValueError, match="not sound"):
        live(saved=b"nonsense")
    with pytest.raises(ValueError, match="other axes"):
        LiveAxes(("gyro_x", "gyro_z"), H, LiveConfig(), "deg/s", saved)
    with pytest.raises(ValueError, match="or have another rate"):
        LiveAxes(AXES, 0.02, LiveConfig(), "deg/s", saved)
    with pytest.raises(ValueError, match="or memory"):
        live(LiveConfig(memory="10s"), saved)
    fields = msgspec.msgpack.decode(saved)
    fields[-1] = fields[-1][:-8]
    with pytest.raises(ValueError, match="cannot be read"):
        live(saved=msgspec.msgpack.encode(fields))


def test_too_few_and_constant() -> None:
    axes = live()
    assert {fit.verdict for fit in axes.fit(curves=True).values()} == {"too few samples"}
    axes.add(two(FEWEST_SAMPLES - 2, 5))
    for fit in axes.fit(curves=False).values():
        assert "a fit needs 136 samples without a break, and there are 134" in fit.text
    axes.add(two(2, 5))
    assert {fit.verdict for fit in axes.fit(curves=True).values()} != {"too few samples"}
    axes = live()
    axes.add(np.column_stack([np.full(1000, 3.0), white(1000, 1, 1)[0]]))
    constant, white_one = axes.fit(curves=True).values()
    assert constant.verdict == "constant"
    assert constant.text[0].isupper()
    assert white_one.verdict == "white"


def test_a_knock_is_left_out_and_counted() -> None:
    y = two(30_000, 6)
    axes, still = live(), live()
    still.add(y)
    y[12_345:12_400] += 50
    axes.add(y)
    found, same = axes.fit(curves=False)["gyro_x"], still.fit(curves=False)["gyro_x"]
    assert found.left_out["knocked"] in (128, 256)
    assert found.alpha.value == pytest.approx(same.alpha.value, abs=0.02)


def test_forgetting_follows_a_change() -> None:
    """A live fit with a limited memory follows a change of the noise. Three time constants of the memory
    after the power has doubled, the fit shows only the new power.
    """
    y = white(24_000, 1, 7)[0]
    y[12_000:] *= np.sqrt(2)
    forgetful, faithful = live(LiveConfig(memory="40s")), live()
    for axes in (forgetful, faithful):
        axes.add(np.column_stack([y, y]))
    fit = forgetful.fit(curves=True)["gyro_x"]
    assert fit.verdict == "white"
    assert np.median(np.square(fit.spectrum.density)) == pytest.approx(2 * 2 * H, rel=0.1)
    assert faithful.fit(curves=False)["gyro_x"].verdict == "not stationary"


def fits_of(file: Path) -> tuple[dict[str, AxisFit], Array, float]:
    with np.load(file) as d:
        y, h = d["gyro_raw"] / float(d["lsb_per_dps"]), 1 / float(d["fs_hz"])
    axes = LiveAxes(("x", "y", "z"), h, LiveConfig(), "deg/s")
    for begin in range(0, len(y), 1000):
        axes.add(y[begin : begin + 1000])
        if begin % 10_000 == 0:
            axes.fit(curves=False)
    return axes.fit(curves=True, last=True), y, h


@pytest.mark.parametrize("name", ["mpu6050_sunsided_10min", "mpu6050_tomisuarez_100s"])
def test_at_the_end_it_says_what_identify_says(recordings: Path, name: str) -> None:
    fits, y, h = fits_of(recordings / f"{name}.npz")
    for i, fit in enumerate(fits.values()):
        seen = examined(y[:, i], h)
        kind = decide(seen.evidence).kind
        # The resolution of the live spectrum cannot distinguish a spectral line from a narrow resonance.
        assert fit.verdict == ("line or resonance" if kind in ("line", "resonance") else kind)
        assert fit.null_p == pytest.approx(seen.evidence.p_all, rel=0.05)

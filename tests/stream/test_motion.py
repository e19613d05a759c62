"""Motion within a record is left out of the fit, so the bias is known as well afterwards as before."""

from collections.abc import Callable

import fltea
import numpy as np
import pytest
from fltea.records.arrays import Array
from fltea.records.block import Block
from fltea.records.events import RawBlock
from fltea.records.records import AnyRecord, Fit
from fltea.spectrum.live_axes import LONGEST_MOTION_S, LiveAxes
from fltea.spectrum.octaves import Octaves
from fltea.stream import live

from tests.rig.blocks import in_blocks, ndjson, of
from tests.rig.device_stream_support import run_pipeline
from tests.rig.host_support import hello

LSB_DPS, SIGMA, OFFSET = 1 / 16.4, 6.0, 20.0
REST, MOVES, END = 4000, 6000, 8000
"""Sample numbers at 100 Hz: the sensor rests before REST, moves until MOVES, and rests until END. The motion
lasts longer than eight chunks of 128 samples. Eight disturbed chunks that are not recognised as motion would
be accepted as a new power of the noise.
"""


def smooth(rng: np.random.Generator, n: int, width: float) -> Array:
    """Return noise of standard deviation 1 that has passed through a Gaussian filter."""
    window = np.exp(-0.5 * (np.arange(-4 * width, 4 * width + 1) / width) ** 2)
    found = np.convolve(rng.standard_normal(n), window, "same")
    return np.asarray(found / found.std())


MOTIONS: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "turning to and fro": lambda t, rng: 45 * np.sin(2 * np.pi * t / 5),
    "shaken": lambda t, rng: 45 * np.sin(2 * np.pi * t),
    "by hand": lambda t, rng: 30 * smooth(rng, len(t), 50),
    "driven": lambda t, rng: 10 * smooth(rng, len(t), 150) + 1.5 * rng.standard_normal(len(t)),
}


@pytest.fixture(autouse=True)
def true_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "LiveAxes", LiveAxes)


def record(kind: str) -> RawBlock:
    rng = np.random.default_rng(1)
    y = rng.normal(OFFSET, SIGMA, (END, 1))
    y[REST:MOVES, 0] += MOTIONS[kind](np.arange(MOVES - REST) / 100, rng) / LSB_DPS
    n = np.arange(END)
    return RawBlock(n, n * 10_000, n * 10_000_000, np.rint(y))


def columns(items: list[AnyRecord | Block], name: str) -> Array:
    return np.concatenate([getattr(block.tracked[0], name) for block in of(Block, items)])


@pytest.mark.parametrize("kind", MOTIONS)
def test_what_is_learnt_at_rest_is_known_after_motion(kind: str) -> None:
    items, pipeline = run_pipeline([hello(), record(kind)], live__period_s=5)
    moving, bias, std = (columns(items, name)[:, 0] for name in ("moving", "bias", "bias_std"))
    assert moving[REST:MOVES].mean() > 0.93  # the motion is detected only after one or two chunks
    assert not moving[:REST].any()
    assert not moving[MOVES + 100 :].any()
    assert np.abs(bias[MOVES + 200 :] - OFFSET * LSB_DPS).max() < 3 * std[MOVES + 200]
    assert std[-1] < 0.05 * SIGMA * LSB_DPS
    last = of(Fit, pipeline.finish())[-1]
    fit = last.axes["gyro_x"]
    assert (fit.verdict, last.samples) == ("white", END)
    assert moving.sum() <= fit.left_out["moved"] < moving.sum() + 128 * fit.breaks["motions"]
    assert fit.breaks["changes"] == 0


def test_motion_is_left_out_in_the_same_way_in_any_cut_and_after_any_snapshot() -> None:
    block = record("by hand").rows(REST - 1000, MOVES + 500)
    whole, pipeline = run_pipeline([hello(), block], live__period_s=7)
    saved = pipeline.save()
    assert saved is not None
    for cuts in ((1, 2, 900, 1031, 1700, 2999, 3100), range(0, 3500, 97)):
        items, other = run_pipeline([hello(), *in_blocks(block, cuts)], live__period_s=7)
        assert ndjson(of(Fit, items)) == ndjson(of(Fit, whole))
        for name in ("bias", "bias_std", "moving"):
            np.testing.assert_array_equal(columns(items, name), columns(whole, name))
        again = other.save()
        assert again is not None
        assert (again.gyro_fit, again.gyro_track) == (saved.gyro_fit, saved.gyro_track)


@pytest.mark.parametrize("louder", [4.5, 5.5, 30.0])
def test_what_lasts_is_noise_in_the_end(louder: float) -> None:
    rate_hz = 1.0
    y = np.random.default_rng(1).normal(0, 0.1, (4000, 1))
    y[1000:] *= louder
    one, longest, fits = fltea.Live(rate_hz, "x", unit="deg/s"), round(LONGEST_MOTION_S * rate_hz), []
    moving = []
    for begin in range(0, len(y), 100):
        moving.append(one.add(y[begin : begin + 100]).moving)
        fits.append(one.fit(curves=False)["x"])
    found = np.concatenate(moving)[:, 0]
    assert not found[-500:].any()
    last = fits[-1]
    assert 100 < last.left_out["moved"] <= longest + 128 * last.breaks["motions"]
    assert (last.R.value or 0) > 0.3 * (0.1 * louder) ** 2


def test_samples_that_are_motion_are_left_out_however_they_are_cut() -> None:
    rng = np.random.default_rng(3)
    y, moving = rng.standard_normal((20_000, 2)), np.zeros((20_000, 2), np.bool_)
    moving[100:160, 0] = moving[5000:9000, 0] = moving[5000:5003, 1] = moving[9001:9003] = True
    whole, parts = Octaves(2), Octaves(2)
    whole.add(y, moving, 3000)
    begin = 0
    for end in (7, 130, 131, 6000, 8100, 20_000):
        parts.add(y[begin:end], moving[begin:end], 3000)
        parts, begin = Octaves.restore(2, 0, parts.save()), end
    assert parts.save() == whole.save()
    counts = whole.counts(0)
    assert (counts.motions, whole.samples) == (2, len(y))
    assert 3060 <= counts.moved <= 3060 + 2 * 127
    assert counts.used == len(y) - counts.moved
    with pytest.raises(ValueError, match="moving must have shape"):
        whole.add(y, moving[:, :1], 3000)


def test_a_later_stretch_brings_its_motion_with_it() -> None:
    y, moving = np.random.default_rng(3).standard_normal((3000, 1)), np.zeros((3000, 1), np.bool_)
    moving[1000:1200] = True
    one, other = Octaves(1), Octaves(1)
    for sums in (one, other):
        sums.add(y, moving, 1e6)
    moved = one.counts(0).moved
    one.merge(other)
    assert one.counts(0)[-2:] == (2 * moved, 2)
    assert one.samples == 6000

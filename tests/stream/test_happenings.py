"""Tests the records of steps of the bias and of motions. Their time and size are right, and the same for any
division of samples into blocks.
"""

from collections.abc import Sequence

import numpy as np
import pytest
from fltea.records.block import Block
from fltea.records.events import RawBlock
from fltea.records.records import AnyRecord, Fit, Motion, Step
from fltea.spectrum.live_axes import LiveAxes
from fltea.stream import live

from tests.rig.blocks import in_blocks, ndjson, of
from tests.rig.device_stream_support import run_pipeline
from tests.rig.host_support import hello

STEP, TURN, STOP, TILT, END = 5000, 5700, 6100, 6500, 7000
SIGMA, SIZE = 2.0, 4.0
"""Standard deviation of the noise, and size of the step [counts]. The step is two standard deviations."""
LSB_PER_DPS = 16.4


@pytest.fixture(autouse=True)
def true_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "LiveAxes", LiveAxes)


def record(accel: bool = True) -> RawBlock:
    """Return the samples of a sensor whose y rate has a step while the sensor rests.

    Later the sensor is turned, and then tilted so slowly that its rates stay the same.
    """
    rng, n = np.random.default_rng(1), np.arange(END)
    gyro = rng.normal([20, -30, 5], SIGMA, (END, 3))
    gyro[STEP:, 1] += SIZE
    gyro[TURN:STOP, 2] += 200
    forces = rng.normal([0, 0, 16384], 20, (END, 3))
    forces[TILT : TILT + 200, 0] += np.linspace(0, 6000, 200)
    forces[TILT + 200 :, 0] += 6000
    of_accel = np.rint(forces) if accel else None
    return RawBlock(n, n * 10_000, n * 10_000_000, np.rint(gyro), of_accel)


def details(items: Sequence[AnyRecord | Block]) -> list[Step | Motion]:
    return [one for one in items if isinstance(one, Step | Motion)]


def test_a_step_and_motion_are_told_with_time_and_size() -> None:
    items, pipeline = run_pipeline([hello(), record()], live__period_s=5)
    step, turns, stops, tilts, lies = details(items)
    assert isinstance(step, Step)
    assert (step.axis, step.unit) == ("gyro_y", "deg/s")
    assert abs(step.seq - STEP) < 10
    assert step.host_ns == step.seq * 10_000_000
    assert step.device_us == step.seq * 10_000
    assert abs(step.size - SIZE / LSB_PER_DPS) < 4 * step.size_std
    assert 0 < step.found_after < 60
    for begins, ends, by, first, last in (
        (turns, stops, "gyro_z", TURN, STOP),
        (tilts, lies, "accel", TILT, TILT + 200),
    ):
        assert isinstance(begins, Motion)
        assert isinstance(ends, Motion)
        assert (begins.begins, begins.by, begins.samples, begins.largest) == (True, by, None, None)
        assert (ends.begins, ends.by) == (False, by)
        assert abs(begins.seq - first) < 70
        assert 0 <= ends.seq - last < 130
        assert ends.samples == ends.seq - begins.seq + 1
        assert ends.largest is not None
    assert stops.largest == pytest.approx(200 / LSB_PER_DPS, rel=0.05)
    stats = pipeline.stats().axes["gyro_y"].tracker
    assert stats is not None
    assert (stats.steps, stats.moving, stats.bias_for_s) == (1, False, 1.0)
    assert {1, 10} <= set(stats.checked)
    last_fit = of(Fit, pipeline.finish())[-1].axes
    assert last_fit["gyro_x"].breaks["motions"] == 2
    # on the y axis, the step of the bias is counted in `motions` as well
    assert last_fit["gyro_y"].breaks["motions"] == 3
    assert [one.verdict for one in last_fit.values()] == ["white"] * 3


def test_the_bias_is_known_again_after_all_of_it() -> None:
    items, _ = run_pipeline([hello(), record()], live__period_s=5)
    bias, std, moving = (
        np.concatenate([getattr(block.tracked[0], name) for block in of(Block, items)])
        for name in ("bias", "bias_std", "moving")
    )
    truth = np.array([20, -30 + SIZE, 5]) / LSB_PER_DPS
    assert (moving == moving[:, :1]).all()
    assert moving[TURN + 32 : STOP, 0].all()
    assert moving[TILT + 100 : TILT + 200, 0].all()
    for at in (STOP - 1, STOP + 110, END - 1):
        assert (np.abs(bias[at] - truth) < 4 * std[at]).all()


@pytest.mark.parametrize("settings", [{}, {"live__on": False}, {"channels": ["gyro_y", "accel_x"]}])
def test_they_stand_behind_the_same_samples_in_any_cut(settings: dict[str, object]) -> None:
    changes = {"live__period_s": 5, "estimator__startup": 300} | settings
    block = record()
    whole = ndjson(run_pipeline([hello(), block], **changes)[0])
    assert any(b'"class":"motion"' in line for line in whole)
    cuts = [*range(0, END, 37), STEP + 20, TURN + 31, TURN + 32]
    assert ndjson(run_pipeline([hello(), *in_blocks(block, cuts)], **changes)[0]) == whole


def test_without_an_accelerometer_a_tilt_is_not_seen() -> None:
    items, _ = run_pipeline([hello(), record(accel=False)], live__period_s=5)
    assert [one.by for one in details(items) if isinstance(one, Motion)] == ["gyro_z", "gyro_z"]

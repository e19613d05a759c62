"""The native device gives the same results for single samples as for all samples in one block."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from fltea.records.block import Block
from fltea.records.events import Event, RawBlock
from fltea.records.records import AnyRecord
from fltea.settings.config import load_config
from fltea.stream.pipeline import HANDLERS, Pipeline, Stop

from tests.rig.blocks import ndjson
from tests.rig.device_stream_support import SMALL, Source, raw, reads
from tests.rig.host_support import hello
from tests.rig.tiers import long, slow

N = 1000
SETTINGS: list[dict[str, Any]] = [
    {},
    {"live.on": False},
    {"estimator.startup": 470, "live.period_s": 0.7},
    {"output.every": 7, "output.corrected": True},
    {"channels": ["gyro_z", "accel_x"], "accel.startup": 35, "accel.window": 50},
    {"live.period_s": 0.3, "estimator.tuning": "live"},
    {"live.period_s": 0.3, "estimator.tuning": "live", "estimator.variant": "triple"},
    {"estimator.R": 1e-4, "estimator.bias": "none", "estimator.guard": "off", "estimator.variant": "triple"},
]


def run_pipeline(events: Iterable[Event], changes: dict[str, Any], *, watched: bool = True) -> list[bytes]:
    pipeline = Pipeline(Source(), load_config(None, SMALL | changes), watched=watched)
    found: list[AnyRecord | Block] = [item for event in events for item in pipeline.feed(event)]
    return ndjson([*found, *pipeline.finish()])


@pytest.mark.parametrize("watched", [True, long(False)])
@pytest.mark.parametrize("changes", [slow(one) if k in (5, 6) else one for k, one in enumerate(SETTINGS)])
def test_reads_of_any_size_say_what_single_samples_say(changes: dict[str, Any], watched: bool) -> None:
    single = run_pipeline(reads([1] * N), changes, watched=watched)
    several = [1, 2, 1, 3] * 8 + [130, 150, 20, 100, 256, 257, 31]
    assert run_pipeline(reads(several), changes, watched=watched) == single
    assert run_pipeline(reads([N]), changes, watched=watched) == single


@pytest.mark.parametrize("said", [{"gyro_lsb_per_dps": 65.5}, {"accel_lsb_per_g": 0.0}, {"rate_hz": 101.0}])
def test_a_hello_with_other_numbers_counts_for_the_samples_behind_it(said: dict[str, Any]) -> None:
    other = hello(host_ns=6_390_000_000, **said)
    single, whole = list(reads([1] * 900)), list(reads([639, 261]))
    assert run_pipeline([*single[:640], other, *single[640:]], {}) == run_pipeline(
        [*whole[:2], other, whole[2]], {}
    )
    assert (
        run_pipeline(single, {}) != run_pipeline([*single[:640], other, *single[640:]], {})
        or "rate_hz" in said
    )


def test_columns_of_any_type_and_order_are_taken() -> None:
    events = list(reads([2] * 600))
    plain = run_pipeline(events, {})
    for k in range(300, 420):
        block = events[k]
        assert isinstance(block, RawBlock)
        wide = np.asfortranarray(block.gyro) if k % 3 == 0 else block.gyro.astype(np.int16)
        events[k] = block._replace(gyro=wide)
    assert run_pipeline(events, {}) == plain


def test_an_accelerometer_may_be_left_out_for_a_while() -> None:
    events = list(reads([2] * 600))
    for k in range(300, 420):
        block = events[k]
        assert isinstance(block, RawBlock)
        events[k] = block._replace(accel=None)
    records = run_pipeline(
        events, {"channels": ["gyro_z", "accel_x"], "accel.startup": 35, "accel.window": 50}
    )
    of_both = [b'"accel_x"' in line for line in records if b'"class":"estimate"' in line]
    assert len(of_both) == 2 * 600 - 20  # 600 reads of 2 samples, less the gyroscope's start-up window
    assert of_both.count(False) == 2 * 120 + 35 - 20


def test_numbers_beyond_all_measure_change_nothing() -> None:
    pipeline = Pipeline(Source(), load_config(None, SMALL))
    events = list(reads([1] * 400))
    for event in events[:300]:
        list(pipeline.feed(event))
    before = pipeline.save()
    block = events[300]
    assert isinstance(block, RawBlock)
    with pytest.raises(ValueError, match="have to be finite"):
        list(pipeline.feed(block._replace(gyro=np.full((1, 3), np.nan))))
    after = pipeline.save()
    assert before is not None
    assert after is not None
    assert (after.gyro, after.gyro_fit, after.gyro_track) == (before.gyro, before.gyro_fit, before.gyro_track)


def test_each_stop_but_the_ends_has_a_handler() -> None:
    assert set(Stop) - set(HANDLERS) == {Stop.END, Stop.MORE}


def test_fits_of_an_epoch_count_its_own_samples() -> None:
    """The sample numbers may begin again at 0 after a restart.

    A fit then counts only samples since the restart (of the new epoch).
    """
    events: list[Event] = [hello(), raw(range(500, 700)), hello(boot_id=8), raw(range(300))]
    single: list[Event] = [
        one
        for event in events
        for one in (
            [event]
            if not isinstance(event, RawBlock)
            else [event.rows(k, k + 1) for k in range(len(event.sequence))]
        )
    ]
    records = run_pipeline(events, {"live.period_s": 0.7})
    assert run_pipeline(single, {"live.period_s": 0.7}) == records
    numbers = [line.split(b'"seq":')[1].split(b",")[0] for line in records if b'"class":"fit"' in line]
    assert numbers == [b"569", b"639", b"69", b"139", b"209", b"279", b"299"]

"""The whole device stream at 10 Hz, 1 kHz and 8 kHz: no part of it may assume the Due's 100 Hz."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from fltea.records.block import Block
from fltea.records.errors import UsageError
from fltea.records.events import Event, RawBlock
from fltea.records.records import AnyRecord, Epoch, Estimate, Fit, Gap
from fltea.settings.config import load_config
from fltea.sources.replay import TOGETHER_NS, _paced
from fltea.sources.synthetic import SyntheticSource
from fltea.stream.pipeline import Pipeline

from tests.rig.blocks import of, records_of
from tests.rig.dashboard_support import told
from tests.rig.tiers import slow

LASTS_S = 2
STARTUP_S = 1
LOST_S = (1.2, 1.7)
S = 1_000_000_000


def events(rate_hz: int, *, gap: bool) -> Iterator[Event]:
    """Return LASTS_S seconds of noise. With `gap`, samples between the two times LOST_S are missing."""
    source = SyntheticSource(f"?rate_hz={rate_hz}&n={LASTS_S * rate_hz}&alpha=0.5&f=-3", realtime=False)
    for event in source.events():
        if not gap or not isinstance(event, RawBlock):
            yield event
            continue
        time_s = event.device_us * 1e-6
        kept = (time_s < LOST_S[0]) | (time_s >= LOST_S[1])
        if kept.any():
            yield RawBlock(*(None if column is None else column[kept] for column in event))


def walk(rate_hz: int, *, gap: bool = False, **changes: Any) -> list[AnyRecord | Block]:
    settings = {"channels": ["gyro_z"], "estimator.startup": f"{STARTUP_S} s", "estimator.window": "500 ms"}
    config = load_config(None, settings | {key.replace("__", "."): value for key, value in changes.items()})
    pipeline = Pipeline(SyntheticSource("", realtime=False), config)
    found = [output for event in events(rate_hz, gap=gap) for output in pipeline.feed(event)]
    return [*found, *pipeline.finish(), pipeline.stats()]


@pytest.mark.parametrize("rate_hz", [10, 1000, slow(8000)])
def test_every_sample_is_estimated_and_shown(rate_hz: int) -> None:
    found = records_of(walk(rate_hz))
    (epoch,), estimates, stats = of(Epoch, found), of(Estimate, found), found[-1]
    assert epoch.estimator is not None
    assert (epoch.estimator.startup_samples, epoch.estimator.window) == (rate_hz, max(1, rate_hz // 2))
    assert [e.seq for e in estimates] == list(range(STARTUP_S * rate_hz, LASTS_S * rate_hz))
    steps_ns = np.diff([e.host_ns for e in estimates])
    assert np.all(np.abs(steps_ns - S / rate_hz) <= 1000)
    assert stats.rate_hz == pytest.approx(rate_hz)
    assert (stats.sample_counts.lost, stats.sample_counts.gaps) == (0, 0)
    assert of(Fit, found)[-1].samples == LASTS_S * rate_hz
    history = told(found)
    assert history.samples_of_epoch == LASTS_S * rate_hz


@pytest.mark.parametrize("rate_hz", [10, 1000, slow(8000)])
def test_fits_come_once_a_second(rate_hz: int) -> None:
    """A fit is made once a second if an output shows the fits. Otherwise the time between fits grows with the
    record.
    """
    *fits, last = of(Fit, walk(rate_hz, live__period_s=1.0))
    assert [fit.samples for fit in fits] == [rate_hz * second for second in range(1, LASTS_S + 1)]
    assert last.samples == LASTS_S * rate_hz  # at the end of a recording, the fit uses all samples


@pytest.mark.parametrize("rate_hz", [10, 1000, slow(8000)])
@pytest.mark.parametrize(("longest", "reasons"), [("600 ms", ["start"]), ("400 ms", ["start", "gap"])])
def test_a_gap_is_as_long_as_it_lasts(rate_hz: int, longest: str, reasons: list[str]) -> None:
    found = walk(rate_hz, gap=True, link__max_gap=longest, live__on=False)
    (gap,) = of(Gap, found)
    assert gap.missing == rate_hz // 2
    assert [epoch.reason for epoch in of(Epoch, found)] == reasons


def test_a_window_that_is_too_long_at_this_rate_is_named() -> None:
    with pytest.raises(
        UsageError, match="estimator: at 8000 Hz: window must be a whole number from 0 to 10000000 samples"
    ):
        walk(8000, estimator__window="2 h")


@pytest.mark.parametrize(("rate_hz", "most"), [(10, 1), (100, 1), (1000, 10), (8000, 80)])
def test_in_real_time_what_is_due_within_10_ms_comes_together(
    monkeypatch: pytest.MonkeyPatch, rate_hz: int, most: int
) -> None:
    """At 8 kHz, samples are processed in blocks, since single samples would take too much time.

    At the Due's 100 Hz, each sample is processed when it arrives.
    """
    monkeypatch.setattr("fltea.sources.synthetic.sleep_until", lambda due_ns, closed: None)
    source = SyntheticSource(f"?rate_hz={rate_hz}&n=400", realtime=True)
    blocks = of(RawBlock, source.events())
    assert max(len(block.sequence) for block in blocks) == most
    assert [k for block in blocks for k in block.sequence] == list(range(400))
    for block in blocks:
        parts = list(_paced(block))
        arrivals = [np.asarray(part.host_ns) for part in parts]
        assert max(int(host_ns[-1] - host_ns[0]) for host_ns in arrivals) < TOGETHER_NS
        assert [k for part in parts for k in part.sequence] == block.sequence.tolist()

"""Tests the simulated devices of the daemon's benchmark: what they send and when. Further tests are about
daemons that fail to start.
"""

import os
import resource
import time
from pathlib import Path

import numpy as np
import pytest

from tools.bench import measured
from tools.bench.bench_daemon import Reader, Setting, _arrived, run_once
from tools.bench.feeder import FRAME_NS, PERIOD_NS, noises, offsets_ns, ports, send
from tools.bench.programs import Program


def test_devices_are_spread_over_the_period_in_frames_of_usb() -> None:
    offsets = offsets_ns(1000)
    assert offsets == sorted(offsets)
    assert {at % FRAME_NS for at in offsets} == {0}
    assert (offsets[0], offsets[-1]) == (0, PERIOD_NS - FRAME_NS)
    assert np.bincount(np.array(offsets) // FRAME_NS).tolist() == [100] * 10


def test_each_port_takes_what_is_noted_and_none_before_it_is_due(tmp_path: Path) -> None:
    masters, slaves = ports(tmp_path, 3)
    times, due, taken = send(masters, 20, noises(3, 20, coloured=False))
    assert (times >= due).all()
    assert np.diff(due, axis=1).tolist() == [[PERIOD_NS] * 19] * 3
    for slave, count in zip(slaves, taken.tolist(), strict=True):
        while count:  # the system delivers bytes of a pseudo-terminal with a delay
            count -= len(os.read(slave, count))
    for port in masters + slaves:
        os.close(port)


def test_a_port_that_is_full_is_noted(tmp_path: Path) -> None:
    masters, slaves = ports(tmp_path, 1)
    refused = 0
    # the port counts as full only after 20 refusals, since the system may move bytes to another buffer a
    # little later
    while refused < 20:
        try:
            os.write(masters[0], bytes(1 if refused else 1000))
            refused = 0
        except BlockingIOError:
            refused += 1
            time.sleep(0.002)
    times, _, taken = send(masters, 2, noises(1, 2, coloured=False))
    assert times[0].tolist() == [0, 0]
    assert taken[0] < 200
    for port in masters + slaves:
        os.close(port)


def test_a_daemon_that_ends_early_is_said() -> None:
    with pytest.raises(RuntimeError, match="the daemon ended early"):
        run_once(Setting(1, 0.1, settle_s=0.1), Program("none", "/bin/false"))


@pytest.mark.parametrize("counts", ["sample_counts", "samples"])
def test_what_did_not_come_is_missing(counts: str) -> None:
    reader = Reader(None, 1, 3)
    reader.seen_ns[0] = [0, 5_000_000, 0]
    link = {"overflow_bytes": 0}
    reader.stats["d0"] = {counts: {"lost": 2}, "link": link, "outputs": {"stdout": {"dropped": 1}}}
    fed = {"times": np.array([[1_000_000, 3_000_000, 0]]), "due": np.array([[0, 2_000_000, 4_000_000]])}
    found = _arrived(reader, fed, 500_000)
    assert (found["p50_ms"], found["estimates"], found["missing"]) == (2.0, 1, 1)
    assert (found["lost"], found["dropped"], found["port_full"]) == (2, 1, 1)
    assert found["feeder_late_ms"] == pytest.approx(1.0)
    reader.seen_ns[:] = 0
    assert _arrived(reader, fed, 500_000)["p99_ms"] is None


def test_open_files_are_raised_as_far_as_the_system_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "getrlimit", lambda which: (1024, 4096))
    monkeypatch.setattr(resource, "setrlimit", lambda which, limit: asked.append(limit))
    measured.allow_open_files(1000)
    measured.allow_open_files(2100)
    assert asked == [(2100, 4096)]
    with pytest.raises(RuntimeError, match="5000 open files are needed, and 4096 are allowed"):
        measured.allow_open_files(5000)

"""Tests of recordings that begin and end while the program runs.

Each recording contains the samples between its beginning and its end, and recording disturbs nothing else.
"""

from pathlib import Path

import msgspec
import pytest
from fltea.records.errors import FlteaError, UsageError
from fltea.records.events import Chunk
from fltea.records.records import Error, Hello, Sample
from fltea.service.device_stream import DeviceStream
from fltea.service.hub import Hub
from fltea.service.recorder import REPLAYED, RecorderOfHub
from fltea.settings.config import load_config
from fltea.settings.outputs import RecordConfig
from fltea.sinks.record import RecordSink
from fltea.sources.synthetic import SyntheticSource

from tests.rig.blocks import of
from tests.rig.host_support import closed, hello, wait_until
from tests.rig.mcap_support import replay, sink_in, transport, written


def made(record_to: Path, **settings: object) -> tuple[Hub, RecorderOfHub]:
    hub = Hub(lambda error: None)
    config = RecordConfig(**settings).for_devices(1)  # type: ignore[arg-type]
    return hub, RecorderOfHub(hub, config, str(record_to), {"old"})


def test_what_came_between_start_and_stop_is_recorded_and_can_be_replayed(tmp_path: Path) -> None:
    hub, recorder = made(tmp_path / "recordings")
    tap = hub.tap("due", wait=True)
    items = transport(samples=600)
    for item in items[:200]:
        tap(item)
    before = recorder.view("due")
    assert (before.on, before.file, before.folder) == (False, None, str(tmp_path / "recordings"))
    assert before.free_bytes is not None
    said = next(r for r in replay_of(items, tmp_path / "whole") if isinstance(r, Hello))
    recorder.start("due", said)
    recorder.start("due", said)
    for item in items[200:400]:
        tap(item)
    wait_until(lambda: recorder.view("due").size_bytes > 0, "something in the file")
    during = recorder.view("due")
    assert (during.on, during.fixed, during.lost, during.trouble) == (True, False, 0, None)
    recorder.stop("due")
    recorder.stop("due")
    for item in items[400:]:
        tap(item)
    (path,) = (tmp_path / "recordings").iterdir()
    after = recorder.view("due")
    assert (after.on, after.file, after.size_bytes) == (False, path.name, path.stat().st_size)
    found = replay(path)
    seqs = [sample.seq for sample in of(Sample, found)]
    between = sum(isinstance(item, Chunk) for item in items[200:400])
    assert seqs == list(range(seqs[0], seqs[0] + len(seqs)))
    assert abs(len(seqs) - between) <= 5, "from the first whole frame on, without waiting for a HELLO"
    assert [e.kind for e in of(Error, found)] == []
    recorder.start("due", said)
    recorder.stop("due")
    assert len(list((tmp_path / "recordings").iterdir())) == 1, "nothing came, so there is no second file"
    assert closed(hub)


def replay_of(items: list, folder: Path) -> list:
    written(sink_in(folder), *items)
    return replay(folder)


def test_a_source_without_a_wire_is_recorded_from_then_on(tmp_path: Path) -> None:
    hub, recorder = made(tmp_path)
    config = load_config(None, {"name": "due", "estimator.startup": 20, "estimator.window": 50})
    source = SyntheticSource("n=900&seed=1", realtime=False)
    stream = DeviceStream(source, config, hub, None)
    said: Hello | None = None
    seen = 0
    for event in source.events():
        if isinstance(event, Hello):
            said = event
        stream.take(event)
        seen += len(getattr(event, "sequence", ()))
        if seen >= 300 and not recorder.view("due").on and not list(tmp_path.iterdir()):
            began = seen
            recorder.start("due", said)
        if seen >= 600 and recorder.view("due").on:
            recorder.stop("due")
            ended = seen
    stream.finish()
    assert closed(hub)
    (path,) = tmp_path.iterdir()
    seqs = [sample.seq for sample in of(Sample, replay(path))]
    assert len(seqs) == ended - began


def test_one_that_runs_with_the_program_is_shown_and_not_ended(tmp_path: Path) -> None:
    hub, recorder = made(tmp_path, folder=str(tmp_path / "a"))
    sink = sink_in(tmp_path / "a")
    recorder.adopt("due", hub.add(sink, "due"))
    for item in transport(samples=50):
        hub.tap("due", wait=True)(item)
    recorder.start("due", hello())
    view = recorder.view("due")
    assert (view.on, view.fixed, view.folder) == (True, True, str(tmp_path / "a"))
    with pytest.raises(FlteaError, match="--record"):
        recorder.stop("due")
    assert closed(hub)
    assert len(list((tmp_path / "a").iterdir())) == 1


def test_what_cannot_be_recorded_says_why_and_ends_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    hub, recorder = made(tmp_path / "file" / "sub")
    with pytest.raises(UsageError, match="cannot be made"):
        recorder.start("due", hello())
    _, recorder = made(tmp_path)
    with pytest.raises(UsageError, match="is a recording already"):
        recorder.start("old", hello())
    assert recorder.view("old").why_not == REPLAYED
    with pytest.raises(UsageError, match="No message has come"):
        recorder.start("due", None)
    with pytest.raises(UsageError, match="not in counts"):
        recorder.start("due", msgspec.structs.replace(hello(), gyro_lsb_per_dps=None))
    assert not recorder.view("due").on
    assert not hub.tap("due", wait=False).wanted


def test_a_recording_that_ended_by_a_fault_of_its_own_does_not_look_alive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub, recorder = made(tmp_path)
    recorder.start("due", hello())

    def fail(self: RecordSink, item: object) -> None:
        raise RuntimeError("broken on purpose")

    monkeypatch.setattr(RecordSink, "write", fail)
    hub.tap("due", wait=True)(transport(samples=5)[0])
    wait_until(lambda: recorder.view("due").trouble is not None, "the fault")
    assert "because of a fault" in str(recorder.view("due").trouble)
    recorder.stop("due")
    assert not recorder.view("due").on

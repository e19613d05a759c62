"""Tests of snapshots of a device's state. From a sound snapshot, a later run's estimates continue bit for
bit. An unsound snapshot must not be used.
"""

import errno
import os
import random
import shutil
from pathlib import Path

import msgspec
import pytest
from fltea.records.errors import UsageError
from fltea.records.estimate import FlteaEstimate
from fltea.records.events import Event, RawSample
from fltea.records.records import AnyRecord, Epoch, Error, Estimate, Stats
from fltea.service import state as state_module
from fltea.service.state import DeviceState, StateFile
from fltea.settings.config import Config
from fltea.settings.outputs import StateConfig
from fltea.stream.pipeline import Pipeline

from tests.rig.blocks import of, of_samples, records_of
from tests.rig.device_stream_support import Source, small_config
from tests.rig.host_support import fltea_here, hello, wait_until

PERIOD_NS = 10**7
S = 10**9
BEGIN_NS = 1_700_000_000 * S


def config(**changes: object) -> Config:
    return small_config(**{"accel__startup": 30, "accel__window": 40, "link__max_gap": 100} | changes)


def source() -> Source:
    return Source(prompt=True, unix_offset_ns=BEGIN_NS)


def raw(k: int) -> RawSample:
    noise = random.Random(k)
    gyro, accel = ([round(noise.gauss(0, 3)) for _ in range(3)] for _ in range(2))
    return RawSample(
        k % 65536, k * 10_000, k * PERIOD_NS, tuple(gyro), (accel[0], accel[1], 16384 + accel[2])
    )


def walk(pipeline: Pipeline, *events: Event | RawSample) -> list[AnyRecord]:
    return records_of(item for event in of_samples(events) for item in pipeline.feed(event))


def snapshot(settings: Config, samples: int = 200, **changes: object) -> DeviceState:
    pipeline = Pipeline(source(), settings)
    walk(pipeline, hello(**changes), *map(raw, range(samples)))
    state = pipeline.save()
    assert state is not None
    decoded = msgspec.json.decode(msgspec.json.encode(state), type=DeviceState)
    assert decoded == state
    return decoded


def later(state: DeviceState, settings: Config, begin: int, end: int, **changes: object) -> list[AnyRecord]:
    """Return the records of a later run that continues from a snapshot. The board was reset, and the run's
    first sample has the sequence number `begin`.
    """
    pipeline = Pipeline(source(), settings, state=state)
    said = hello(**{"boot_id": 99, "host_ns": begin * PERIOD_NS, **changes})
    return walk(pipeline, said, *map(raw, range(begin, end)))


def estimates(records: list[AnyRecord]) -> dict[int, object]:
    """Return the estimates by sample number, without the fields of the live fit.

    These fields would differ, since the times of live fits depend on when the epoch (the run since the last
    restart) began.
    """
    return {
        r.seq: {
            axis: msgspec.structs.replace(one, null_p=None, whiteness=None) for axis, one in r.axes.items()
        }
        for r in records
        if isinstance(r, Estimate)
    }


ALL = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_z"]


@pytest.mark.parametrize("channels", [None, ["gyro_y", "accel_z"], ALL, ["accel_x"]])
@pytest.mark.parametrize("missing", [0, 1, 30])
def test_estimates_go_on_as_if_the_program_had_not_been_stopped(
    channels: list[str] | None, missing: int
) -> None:
    # no live fits: their times count from the beginning of a run, so the later run would fit at other
    # samples
    untuned = {"live.on": False}
    settings = config(channels=channels, **untuned)
    unbroken = Pipeline(source(), settings)
    events = [hello(), *map(raw, range(200)), *map(raw, range(200 + missing, 400))]
    expected = estimates(walk(unbroken, *events))
    records = later(snapshot(settings), settings, 200 + missing, 400)
    [epoch] = of(Epoch, records)
    assert epoch.reason == "resumed"
    assert epoch.resumed_after_s == pytest.approx((1 + missing) * 0.01)
    found = estimates(records)
    assert found == {seq: expected[seq] for seq in range(200 + missing, 400)}


def test_a_date_that_was_set_in_between_does_not_change_the_age() -> None:
    """Times are computed with the machine's date at the last restart of the device (the epoch's beginning),
    which may be months ago and may have been wrong. The age of a snapshot must not depend on this date.
    """
    settings, clock = config(), source()
    pipeline = Pipeline(clock, settings)
    walk(pipeline, hello(), *map(raw, range(100)))
    clock.unix_offset_ns = BEGIN_NS + 3600 * S
    walk(pipeline, *map(raw, range(100, 200)))
    state, after = pipeline.save(), source()
    after.unix_offset_ns = clock.unix_offset_ns
    records = walk(Pipeline(after, settings, state=state), hello(), *map(raw, range(250, 260)))
    [epoch] = of(Epoch, records)
    assert (epoch.reason, epoch.resumed_after_s) == ("resumed", pytest.approx(0.51))


def of_filters(records: list[AnyRecord]) -> list[FlteaEstimate]:
    return [axis.fltea for record in of(Estimate, records) for axis in record.axes.values()]


def test_what_is_longer_ago_than_the_memory_is_bridged_by_its_length() -> None:
    settings = config()
    far, farther = (later(snapshot(settings), settings, k, k + 20) for k in (1000, 1300))
    assert estimates(far)[1000] != estimates(farther)[1300]  # these runs have different samples
    state = snapshot(settings)
    moved = msgspec.structs.replace(state, unix_ns=state.unix_ns - 100 * S)
    assert of_filters(later(moved, settings, 1000, 1020)) == of_filters(far)


def test_bias_and_r_are_kept_and_no_start_up_window_begins() -> None:
    settings = config()
    state = snapshot(settings)
    records = later(state, settings, 260, 300)
    assert next(r for r in records if isinstance(r, Estimate)).seq == 260
    stats = of(Stats, records)
    assert not stats or stats[-1].startup_remaining == 0
    assert state.gyro is not None
    pipeline = Pipeline(source(), settings, state=state)
    walk(pipeline, hello(), raw(260))
    assert pipeline.stats().axes["gyro_x"].bias == state.gyro.bias_dps[0]
    assert state.gyro.R[2] == pipeline.stats().axes["gyro_z"].R_in_use


@pytest.mark.parametrize(
    ("board", "settings", "text"),
    [
        ({"device_id": "b1"}, {}, "differ in: device_id"),
        ({"who_am_i": 0x70}, {}, "differ in: who_am_i"),
        ({"gyro_lsb_per_dps": 131.0}, {}, "differ in: scales"),
        ({"rate_hz": 99.0}, {}, "differ in: rate_hz"),
        ({"gyro_dlpf_hz": 5.0}, {}, "differ in: filter_hz"),
        ({}, {"estimator__window": 60}, "differ in: settings"),
        ({}, {"estimator__state.Q": 0.2}, "differ in: settings"),
        ({}, {"channels": ["gyro_x"]}, "differ in: channels"),
    ],
)
def test_another_sensor_or_other_settings_begin_again(
    board: dict[str, object], settings: dict[str, object], text: str
) -> None:
    records = later(snapshot(config()), config(**settings), 200, 260, **board)
    [error] = of(Error, records)
    assert (error.kind, text in error.message) == ("state_unused", True)
    [epoch] = of(Epoch, records)
    assert (epoch.reason, epoch.resumed_after_s) == ("start", None)
    assert min(estimates(records)) == 220


def test_too_old_or_from_the_future() -> None:
    settings = config(state__max_age_s=2.0)
    state = snapshot(settings)
    for unix_ns, text in ((state.unix_ns - 3 * S, "s old"), (state.unix_ns + 9 * S, "future")):
        records = later(msgspec.structs.replace(state, unix_ns=unix_ns), settings, 200, 230)
        [error] = of(Error, records)
        assert text in error.message
    records = later(msgspec.structs.replace(state, unix_ns=state.unix_ns - S), settings, 200, 230)
    assert [r.reason for r in of(Epoch, records)] == ["resumed"]


def test_only_the_first_epoch_resumes() -> None:
    settings = config()
    pipeline = Pipeline(source(), settings, state=snapshot(settings))
    records = walk(pipeline, hello(), *map(raw, range(200, 220)), hello(boot_id=3), *map(raw, range(40)))
    assert [r.reason for r in of(Epoch, records)] == ["resumed", "restart"]


def test_nothing_is_kept_of_a_start_up_window() -> None:
    for settings, samples in ((config(), 20), (config(channels=["gyro_x", "accel_x"]), 25)):
        pipeline = Pipeline(source(), settings)
        walk(pipeline, hello(), *map(raw, range(samples - 1)))
        assert pipeline.save() is None


# --- the file of snapshots ---


def state_file(path: Path, **settings: object) -> tuple[StateFile, list[tuple[str, str]]]:
    said: list[tuple[str, str]] = []
    return StateFile(StateConfig(str(path), **settings), lambda kind, text: said.append((kind, text))), said


def written(path: Path, **devices: DeviceState) -> bytes:
    """Write a file with snapshots of these devices, and return its content."""
    file, _ = state_file(path)
    for name, state in devices.items():
        file.put(name, state)
    file.close()
    return path.read_bytes()


def test_all_devices_are_written_at_the_end_and_found_again(tmp_path: Path) -> None:
    path = tmp_path / "fltea.state"
    file, said = state_file(path)
    one, two = snapshot(config()), snapshot(config(), 250)
    file.put("left", two)
    file.put("left", one)
    file.put("right", two)
    file.close()
    again, _ = state_file(path)
    assert again.found == {"left": one, "right": two}
    again.put("right", one)
    again.close()
    assert state_file(path)[0].found == {"left": one, "right": one}
    assert said == []
    assert sorted(p.name for p in tmp_path.iterdir()) == [".fltea.state.lock", "fltea.state"]


@pytest.mark.slow
def test_a_second_program_is_told_who_has_the_file(tmp_path: Path) -> None:
    path = tmp_path / "state"
    held, _ = state_file(path)
    held.put("left", snapshot(config()))
    command = ["run", "-s", "synthetic:?n=300", "--once", "--format", "none", "--state", str(path)]
    done = fltea_here(*command)
    assert done.returncode == 2
    assert f"another fltea (process {os.getpid()}) keeps its snapshots there" in done.stderr
    held.close()
    assert fltea_here(*command).returncode == 0


def test_a_file_system_without_locks_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file system without locks, such as NFS without its lock daemon, is named in the message. The message
    must not blame the command line.
    """

    def refuse(held: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(state_module.fcntl, "flock", refuse)
    done = fltea_here("run", "-s", "synthetic:?n=300", "--once", "--state", str(tmp_path / "state"))
    assert done.returncode == 1
    assert "lock cannot be taken ([Errno 37] No locks available)" in done.stderr
    assert "On a file system without locks" in done.stderr


def test_what_is_new_is_written_soon_and_not_a_period_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first snapshot of a device is written soon, not after a whole period. So a program that is killed
    loses at most what came in its last period.
    """
    monkeypatch.setattr(state_module, "POLL_S", 0.01)
    path = tmp_path / "state"
    file, said = state_file(path, period_s=3600)
    state = snapshot(config())
    file.put("left", state)
    wait_until(path.exists, "the file")
    copy = tmp_path / "copy"
    copy.write_bytes(path.read_bytes())
    assert state_file(copy)[0].found == {"left": state}
    file.close()
    assert said == []


def test_a_folder_that_goes_is_told_once_and_the_old_file_kept(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "state"
    path.parent.mkdir()
    file, said = state_file(path, period_s=0.01)
    shutil.rmtree(path.parent)
    file.put("left", snapshot(config()))
    while not said:
        file.put("left", snapshot(config()))
    file.put("left", snapshot(config()))
    file.close()
    assert [kind for kind, _ in said] == ["state_failed"]


@pytest.mark.parametrize("content", [b"{}", b"[1]", b'{"version":1,"devices":3}', b"\xff"])
def test_a_file_that_is_none_of_ours_is_refused_and_left_alone(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    for _ in range(2):  # the second attempt shows that the first one has not left the file locked
        with pytest.raises(UsageError, match="no snapshot of fltea"):
            state_file(path)
    assert path.read_bytes() == content


@pytest.mark.parametrize("version", [3, 99])
def test_a_snapshot_of_another_version_is_told_and_replaced(version: int, tmp_path: Path) -> None:
    """A service must start after an update, even if nobody removes the old file."""
    path = tmp_path / "state"
    path.write_bytes(b'{"version":%d,"devices":{"due":{"new":1}},"more":2}' % version)
    file, said = state_file(path)
    assert file.found == {}
    [(kind, text)] = said
    assert kind == "state_unused"
    assert f"another version of fltea ({version})" in text
    kept = snapshot(config())
    file.put("due", kept)
    file.close()
    assert state_file(path)[0].found == {"due": kept}


def test_a_file_that_cannot_be_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no folder"):
        state_file(tmp_path / "no" / "state")
    with pytest.raises(UsageError, match="cannot be"):
        state_file(tmp_path)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"bias_dps": (0.0,)}, "bias_dps has 1 numbers for 3 axes"),
        ({"engine": None}, ""),  # this case stands for a snapshot whose last bytes are changed
    ],
    ids=str,
)
def test_a_snapshot_that_is_not_sound_is_set_aside_and_the_window_begins(
    changes: dict[str, object], reason: str, tmp_path: Path
) -> None:
    """A service must not fail to start because of the content of its file."""
    path = tmp_path / "state"
    state, other = snapshot(config()), snapshot(config(), 250)
    assert state.gyro is not None
    damaged = {"engine": state.gyro.engine[:-9] + b"123456789"} if changes == {"engine": None} else changes
    broken = msgspec.structs.replace(state, gyro=msgspec.structs.replace(state.gyro, **damaged))
    held = written(path, left=broken, right=other)
    file, said = state_file(path)
    pipeline = Pipeline(source(), config(), state=file.found["left"], refuse=lambda: file.refuse("left"))
    records = walk(pipeline, hello(boot_id=99, host_ns=200 * PERIOD_NS), *map(raw, range(200, 260)))
    [error] = of(Error, records)
    assert error.kind == "state_unused"
    assert reason in error.message
    assert min(estimates(records)) == 220
    assert (tmp_path / "state.refused").read_bytes() == held
    assert [kind for kind, _ in said] == ["state_refused"]
    assert "state.refused" in said[0][1]
    file.close()
    assert state_file(path)[0].found == {"right": other}


@pytest.mark.parametrize(
    ("field", "value"), [(b'"R":[', b'"much",'), (b'"unix_ns":', b"9" * 400), (b'"boot_id":', b"9" * 400)]
)
def test_a_file_of_ours_with_what_no_snapshot_holds_is_set_aside(
    field: bytes, value: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "state"
    whole = written(path, due=snapshot(config()))
    broken = whole.replace(field, field + value)
    assert broken != whole
    path.write_bytes(broken)
    file, said = state_file(path)
    assert file.found == {}
    [(kind, text)] = said
    assert kind == "state_refused"
    assert field.decode().strip('":[') in text
    assert path.with_name("state.refused").read_bytes() == broken
    assert not path.exists()
    file.close()
    assert state_file(path)[1] == []


def test_a_file_that_cannot_be_set_aside_is_told_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "state"
    written(path, due=snapshot(config()))
    (tmp_path / "state.refused" / "in the way").mkdir(parents=True)
    file, said = state_file(path)
    file.refuse("due")
    assert [kind for kind, _ in said] == ["state_failed"]
    kept = snapshot(config(), 250)
    file.put("due", kept)
    file.close()
    assert state_file(path)[0].found == {"due": kept}

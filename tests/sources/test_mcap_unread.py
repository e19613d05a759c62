"""No file of a recording is skipped silently.

Files that cannot be read are named and counted, with exit code 1.
"""

import json
import os
import shutil
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import pytest
from fltea.recording.session import check_hello
from fltea.records.events import Event
from fltea.records.records import AnyRecord, Sample
from fltea.sources.as_wire import AsWire
from fltea.sources.mcap import find_session
from fltea.sources.synthetic import SyntheticSource
from fltea.sources.wire_events import hello_problem
from fltea.wire import layout as wire
from fltea.wire.message_events import hello_event
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.blocks import of
from tests.rig.fake_smbus import Pi
from tests.rig.host_support import fltea_here
from tests.rig.mcap_support import record, replay, transport
from tools import standin


def taken(records: list[AnyRecord]) -> list[tuple[object, ...]]:
    """Return what the test compares of each sample. The temperature is left out, since simulated samples have
    one only if they come from frames.
    """
    return [(one.seq, one.device_us, one.gyro_dps, one.accel_ms2) for one in of(Sample, records)]


def parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"))


@given(rate=st.integers(0, 2**32 - 1), gyro=st.integers(0, 2**16 - 1), accel=st.integers(0, 2**16 - 1))
def test_a_hello_that_is_taken_live_is_taken_from_a_recording(rate: int, gyro: int, accel: int) -> None:
    hello = wire.Hello(*[0] * len(wire.Hello._fields))._replace(
        device_id=bytes(16), sample_rate=rate, gyro_lsb=gyro, accel_lsb=accel, firmware_version=""
    )
    if hello_problem(hello) is None:
        check_hello(hello_event(hello, "x", 0))


@pytest.mark.parametrize("accel_lsb", [0, 2048])
def test_a_recording_in_parts_is_read_whole_with_and_without_an_accelerometer(
    tmp_path: Path, accel_lsb: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(standin, "HELLO", standin.HELLO._replace(accel_lsb=accel_lsb))
    records, _ = record(tmp_path, transport(samples=300), rotate_s=1.0)
    assert len(parts(tmp_path)) > 2
    assert taken(replay(tmp_path)) == taken(records)
    (summary,) = fltea_here("info", "--json", tmp_path).stdout.splitlines()
    assert json.loads(summary)["files"] == len(parts(tmp_path))
    assert json.loads(summary)["whole"]


@pytest.mark.parametrize("how", [shutil.copy, os.link, os.symlink])
def test_a_part_under_another_number_is_read_once_and_named(
    how: Callable[[Path, Path], object], tmp_path: Path
) -> None:
    records, _ = record(tmp_path, transport(samples=300))
    (first,) = parts(tmp_path)
    second = first.with_name(first.name.replace("_000.", "_001."))
    how(first, second)
    assert taken(replay(tmp_path)) == taken(records)
    (why,) = find_session([tmp_path]).unread.values()
    assert why == f"{second}: holds the same part of the recording as {first}, which is used."


@pytest.fixture(params=["head", "chunk"])
def damaged(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Damage one of the files of a recording by a wrong byte, at this file's beginning or in a chunk.

    The other files of the recording are long enough to be read alone.
    """
    record(tmp_path, transport(samples=1200), rotate_s=1.0)
    file = parts(tmp_path)[1]
    data = bytearray(file.read_bytes())
    data[data.index(b"format") + 1 if request.param == "head" else len(data) // 3] ^= 8
    file.write_bytes(data)
    return file


@pytest.mark.parametrize(
    "command",
    [
        ["info"],
        ["identify"],
        ["run", "--once", "--format", "none", "--startup", "20", "--source"],
        ["export", "--to", "OUT"],
    ],
    ids=lambda command: command[0],
)
def test_a_file_that_cannot_be_read_is_named_and_makes_the_exit_code_1(
    damaged: Path, command: list[str], tmp_path: Path
) -> None:
    folder = f"replay:{damaged.parent}" if command[0] == "run" else str(damaged.parent)
    command = [str(tmp_path / "out.csv") if word == "OUT" else word for word in command]
    done = fltea_here(*command, folder)
    assert done.returncode == 1
    assert f"a part of the recording could not be read; the rest is used: {damaged}: " in done.stderr


def test_info_counts_it(damaged: Path) -> None:
    (line,) = fltea_here("info", "--json", damaged.parent).stdout.splitlines()
    summary = json.loads(line)
    assert (len(parts(damaged.parent)) - summary["files"] in (0, 1), summary["whole"]) == (True, False)
    assert [str(damaged) in why for why in summary["unread"]] == [True]
    assert "not all could be read" in fltea_here("info", damaged.parent).stdout


def test_a_stray_file_is_told_and_the_recordings_beside_it_are_summed_up(tmp_path: Path) -> None:
    for _ in range(2):
        record(tmp_path, transport(samples=100))
    (tmp_path / "a.mcap").touch()
    done = fltea_here("info", "--json", tmp_path)
    assert (len(done.stdout.splitlines()), done.returncode) == (2, 2)
    assert f"{tmp_path / 'a.mcap'}: is no recording of fltea" in done.stderr


@pytest.mark.parametrize("name", ["NAME_009.mcap", "a copy.mcap", "NAME_001.recovered (1).mcap"])
def test_of_two_files_with_one_part_the_other_is_named(name: str, tmp_path: Path) -> None:
    records, _ = record(tmp_path, transport(samples=300), rotate_s=1.0)
    whole = parts(tmp_path)
    twin = tmp_path / name.replace("NAME", whole[1].stem[:-4])
    twin.write_bytes(whole[1].read_bytes())
    done = fltea_here("info", "--json", tmp_path)
    (summary,) = map(json.loads, done.stdout.splitlines())
    assert (summary["files"], summary["whole"], summary["breaks"]) == (len(whole), False, 0)
    assert (done.returncode, str(twin) in done.stderr, str(whole[1]) in done.stderr) == (1, True, True)
    assert taken(replay(tmp_path)) == taken(records)


def test_a_part_that_is_missing_between_others_is_named(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=500), rotate_s=1.0)
    first, second, *_ = parts(tmp_path)
    assert not find_session([second]).unread
    second.unlink()
    done = fltea_here("info", tmp_path)
    assert (done.returncode, "not all could be read" in done.stdout) == (1, True)
    assert f"{second}: is missing" in done.stderr
    first.unlink()
    assert not find_session([tmp_path]).unread, "what is left has no hole"


def test_a_damaged_file_with_a_recovered_copy_is_read(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=300), rotate_s=1.0)
    file = parts(tmp_path)[1]
    whole = file.read_bytes()
    file.write_bytes(whole.replace(b"format", b"farmat", 1))
    file.with_name(f"{file.stem}.recovered.mcap").write_bytes(whole)
    assert not find_session([tmp_path]).unread


def _synthetic() -> Iterator[Event]:
    return islice(SyntheticSource("seed=1&n=400", realtime=False).events(), 2)


def _pi() -> Iterator[Event]:
    return iter(Pi().run_until(5.0).events)


@pytest.mark.parametrize("source", [_synthetic, _pi])
def test_what_has_no_wire_is_read_whole_from_parts(
    source: Callable[[], Iterator[Event]], tmp_path: Path
) -> None:
    wire_of = AsWire(lambda: 0)
    items = [item for event in source() for item in wire_of.encode(event)]
    records, _ = record(tmp_path, items, rotate_s=1.0)
    assert len(parts(tmp_path)) > 2
    assert taken(replay(tmp_path)) == taken(records)

"""Bags of ROS 1 and ROS 2, made by `rosbags`, as recordings."""

import contextlib
import re
import sqlite3
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_support import KINDS, START_NS, Messages, even, gathered, serialised, write_bag
from fltea.recording.bag_imu import read_imu
from fltea.recording.kind import is_one_file
from fltea.recording.ros_bag import open_bag
from fltea.recording.spool import Spool
from fltea.records.errors import UsageError
from fltea.records.events import RawBlock, Trouble
from fltea.settings.how import How
from fltea.settings.limits import Limits
from fltea.sources.replay import ReplaySource
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

N = 900


def told(stored: Any) -> dict[str, str]:
    return {note.kind: note.text for note in stored.notes}


@pytest.mark.parametrize("kind", KINDS)
def test_all_kinds_hold_the_same(tmp_path: Path, kind: str) -> None:
    rest = even(N)
    path = write_bag(tmp_path / f"rest.{kind}", {"/imu/data": rest}, words=["/chatter"])
    assert is_one_file(path)
    stored = open_bag(path)
    whole = stored.whole()
    assert stored.samples == N
    assert stored.rate_hz == pytest.approx(200, rel=1e-9)
    np.testing.assert_allclose(gathered(stored), rest.gyro_rads, rtol=1e-14)
    np.testing.assert_array_equal(whole.accel_ms2, rest.accel_ms2)
    assert whole.host_s is not None
    np.testing.assert_allclose(whole.host_s, np.arange(N) / 200, atol=1e-8)
    assert stored.notes == ()
    assert stored.start_unix_ns == START_NS + 300_000


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_file_of_a_folder_is_a_bag_too(tmp_path: Path, kind: str) -> None:
    folder = write_bag(tmp_path / f"rest.{kind}", {"/imu": even(50)})
    (file,) = folder.glob(f"*.{kind}")
    assert is_one_file(file)
    assert open_bag(file).samples == 50
    (folder / "metadata.yaml").unlink()
    assert is_one_file(folder)
    assert open_bag(folder).samples == 50


@pytest.mark.parametrize(
    ("kind", "packed"),
    [
        ("bag", "lz4"),
        ("bag", "bz2"),
        ("db3", "file"),
        ("db3", "message"),
        ("mcap", "file"),
        ("mcap", "message"),
        ("mcap", "storage"),
    ],
)
def test_packed_bags(tmp_path: Path, kind: str, packed: str) -> None:
    rest = even(300)
    path = write_bag(tmp_path / f"rest.{kind}", {"/imu": rest}, packed=packed)
    np.testing.assert_allclose(gathered(open_bag(path)), rest.gyro_rads, rtol=1e-14)


@pytest.mark.parametrize("profile", ["ros1", "ros2", ""])
@pytest.mark.parametrize("packed", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD, None])
def test_mcap_by_other_hands(tmp_path: Path, profile: str, packed: CompressionType | None) -> None:
    """Whatever wrote it: with chunks or without, also messages of ROS 1, also without a profile."""
    rest = even(50)
    ros1 = profile == "ros1"
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        unpacked = packed or CompressionType.NONE
        writer = Writer(file, chunk_size=4000, compression=unpacked, use_chunking=packed is not None)
        writer.start(profile)
        name = "sensor_msgs/Imu" if ros1 else "sensor_msgs/msg/Imu"
        schema = writer.register_schema(name, "ros1msg" if ros1 else "ros2msg", b"")
        channel = writer.register_channel("/imu", "ros1" if ros1 else "cdr", schema)
        for arrival, data in serialised(rest, ros1):
            writer.add_message(channel, arrival, data, arrival)
        writer.finish()
    assert is_one_file(path)
    stored = open_bag(path)
    np.testing.assert_allclose(gathered(stored), rest.gyro_rads, rtol=1e-14)
    assert not stored.notes


@pytest.mark.parametrize(
    ("kind", "packed", "library"),
    [("bag", "lz4", "lz4"), ("db3", "message", "zstandard"), ("mcap", None, "mcap")],
)
def test_a_library_that_is_not_there(
    tmp_path: Path, kind: str, packed: str | None, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(tmp_path / f"a.{kind}", {"/imu": even(30)}, packed=packed)
    for name in [
        library,
        *(name for name in sys.modules if name.startswith((f"{library}.", "fltea.recording.scan"))),
    ]:
        monkeypatch.delitem(sys.modules, name, raising=False)
    for name in (library, f"{library}.frame"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(UsageError, match=rf"package {library}, which is not installed: .*\[ros\]"):
        open_bag(path)


@given(
    frame=st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=40),
    stamp_ns=st.integers(0, 2**31 * 10**9 - 1),
    values=st.lists(st.floats(allow_nan=False), min_size=6, max_size=6),
    how=st.sampled_from(["ros1", "little", "big"]),
)
@settings(max_examples=60)
def test_messages_are_read_as_rosbags_writes_them(
    frame: str, stamp_ns: int, values: list[float], how: str
) -> None:
    message = Messages([stamp_ns], [values[:3]], [values[3:]], frame=frame)
    ((_, data),) = serialised(message, how == "ros1", little_endian=how != "big")
    found = read_imu([data, data[:-1], b"", data], "ros1" if how == "ros1" else "cdr")
    assert found.row.tolist() == [0, 3]
    assert found.stamp_ns.tolist() == [stamp_ns] * 2
    assert found.gyro_rads.tolist() == [values[:3]] * 2
    assert found.accel_ms2.tolist() == [values[3:]] * 2


@pytest.mark.parametrize("frame", ["imu", "imu0", "imu_link", ""])
def test_messages_of_xcdr_2_are_aligned_to_four_bytes(frame: str) -> None:
    ((_, data),) = serialised(Messages([START_NS], [[1.5, 2.5, 3.5]], [[4.5, 5.5, 6.5]], frame=frame), False)
    text = 4 + 12 + len(frame) + 1  # the head, two numbers, the length of a text, and the text with its zero
    numbers = data[len(data) - 37 * 8 :]
    packed = b"\0\7\0\0" + data[4:text] + bytes(-text % 4) + numbers
    found = read_imu([packed], "cdr")
    assert found.gyro_rads.tolist() == [[1.5, 2.5, 3.5]]
    assert found.accel_ms2.tolist() == [[4.5, 5.5, 6.5]]
    assert not len(read_imu([b"\0\2\0\0" + packed[4:]], "cdr").row)  # a list of parameters


# --- topics ---


@pytest.mark.parametrize("kind", KINDS)
def test_several_topics_are_listed_and_one_is_named(tmp_path: Path, kind: str) -> None:
    left, right = even(40), even(30, seed=2)
    path = write_bag(tmp_path / f"two.{kind}", {"/left/imu": left, "/right/imu": right}, words=["/chatter"])
    with pytest.raises(UsageError, match=r"2 Imu topics.*--topic /left/imu") as several:
        open_bag(path)
    assert "/right/imu  (sensor_msgs/" in str(several.value)
    assert "30 messages)" in str(several.value)
    assert "/chatter" not in str(several.value)
    np.testing.assert_allclose(gathered(open_bag(path, How(topic="/right/imu"))), right.gyro_rads, rtol=1e-14)
    assert open_bag(path, How(topic="right/imu")).samples == 30
    with pytest.raises(UsageError, match="no Imu messages of the topic '/chatter'"):
        open_bag(path, How(topic="/chatter"))


@pytest.mark.parametrize("kind", KINDS)
def test_without_an_imu_topic_it_says_what_there_is(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path / f"words.{kind}", {}, words=["/chatter", "/rosout"])
    with pytest.raises(UsageError, match="no messages of the type sensor_msgs/Imu") as none:
        open_bag(path)
    assert "/chatter  (std_msgs/" in str(none.value)
    assert "/rosout" in str(none.value)


def test_a_topic_without_a_gyroscope_is_refused(tmp_path: Path) -> None:
    still = even(40)._replace(gyro_rads=np.zeros((40, 3)), unknown=("gyro",))
    path = write_bag(tmp_path / "two.bag", {"/accel": still, "/gyro": even(40)})
    with pytest.raises(UsageError, match=r"is 0 in all 40 messages.*not measured.*Other Imu topics.*: /gyro"):
        open_bag(path, How(topic="/accel"))


def test_acceleration_that_was_not_measured_is_none(tmp_path: Path) -> None:
    rest = even(40)
    for one in (rest._replace(unknown=("accel",)), rest._replace(accel_ms2=None)):
        assert open_bag(write_bag(tmp_path / "a.bag", {"/imu": one})).whole().accel_ms2 is None


# --- times ---


def test_gaps_are_counted_by_header_stamps(tmp_path: Path) -> None:
    rest = even(600, 100.0)
    keep = np.setdiff1d(np.arange(600), [50, 51, 52, *range(200, 350)])
    some = Messages(*(np.asarray(column)[keep].tolist() for column in rest[:3]))  # type: ignore[arg-type]
    stored = open_bag(write_bag(tmp_path / "a.bag", {"/imu": some}))
    whole = stored.whole()
    assert whole.seq is not None
    np.testing.assert_array_equal(whole.seq, keep)
    assert stored.rate_hz == pytest.approx(100, rel=1e-9)


def test_messages_that_stand_there_twice_are_taken_once(tmp_path: Path) -> None:
    rest = even(60)
    twice = np.repeat(np.arange(60), np.where(np.arange(60) % 20 == 5, 2, 1))
    some = Messages(*(np.asarray(column)[twice].tolist() for column in rest[:3]))  # type: ignore[arg-type]
    stored = open_bag(write_bag(tmp_path / "a.bag", {"/imu": some}))
    assert stored.samples == 60
    assert re.search(r"(^| )3 messages stand there twice", told(stored)["bag_messages"])


def test_without_stamps_the_arrivals_are_taken_and_it_says_so(tmp_path: Path) -> None:
    rest = even(200)
    some = rest._replace(stamp_ns=[0] * 200, arrival_ns=rest.stamp_ns)
    stored = open_bag(write_bag(tmp_path / "a.bag", {"/imu": some}))
    assert stored.rate_hz == pytest.approx(200, rel=1e-6)
    assert "are 0, so the times of arrival are taken" in told(stored)["bag_stamps"]
    with pytest.raises(UsageError, match="neither header stamps nor arrivals"):
        open_bag(write_bag(tmp_path / "b.bag", {"/imu": some._replace(arrival_ns=[START_NS] * 200)}))


def test_a_clock_that_is_set_back_begins_a_new_stretch(tmp_path: Path) -> None:
    rest = even(400)
    stamps = [t - (3_600_000_000_000 if i >= 150 else 0) for i, t in enumerate(rest.stamp_ns)]
    some = rest._replace(stamp_ns=stamps, arrival_ns=rest.stamp_ns)
    stored = open_bag(write_bag(tmp_path / "a.bag", {"/imu": some}))
    whole = stored.whole()
    assert whole.epoch is not None
    assert np.bincount(whole.epoch).tolist() == [150, 250]
    assert stored.rate_hz == pytest.approx(200, rel=1e-6)
    assert "1 stamps run backwards; the clock was set 1 times" in told(stored)["bag_stamps"]


def test_values_that_are_no_numbers_are_missing_samples(tmp_path: Path) -> None:
    rest = even(300)
    gyro = np.array(rest.gyro_rads)
    gyro[[70, 71, 200], 1] = np.nan
    stored = open_bag(write_bag(tmp_path / "a.mcap", {"/imu": rest._replace(gyro_rads=gyro)}))
    whole = stored.whole()
    assert whole.seq is not None
    assert np.setdiff1d(np.arange(300), whole.seq).tolist() == [70, 71, 200]
    assert "3 messages hold what is no number" in told(stored)["bag_messages"]


def test_accelerations_that_are_no_numbers(tmp_path: Path) -> None:
    rest = even(300)
    accel = np.array(rest.accel_ms2)
    accel[[10, 20], 2] = np.inf
    whole = open_bag(write_bag(tmp_path / "a.bag", {"/imu": rest._replace(accel_ms2=accel)})).whole()
    assert whole.accel_ms2 is not None
    assert whole.seq is not None
    assert np.setdiff1d(np.arange(300), whole.seq).tolist() == [10, 20]
    stored = open_bag(write_bag(tmp_path / "b.bag", {"/imu": rest._replace(accel_ms2=accel * np.nan)}))
    assert stored.samples == 300
    assert stored.whole().accel_ms2 is None
    assert "the acceleration is left out" in told(stored)["bag_messages"]


# --- limits and damage ---


def test_more_than_the_limit_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", {"/imu": even(3000)})
    with pytest.raises(UsageError, match=r"replay\.max_mb"):
        open_bag(path, limits=Limits(max_mb=0.1))
    with pytest.raises(UsageError, match=r"replay\.max_chunk_mb"):
        open_bag(path, limits=Limits(max_chunk_mb=0.1))
    packed = write_bag(tmp_path / "b.bag", {"/imu": even(3000)}, packed="bz2")
    with pytest.raises(UsageError, match=r"replay\.max_chunk_mb"):
        open_bag(packed, limits=Limits(max_chunk_mb=0.5))


class Files(dict[str, bytes]):
    """By kind; hypothesis prints what it was given, and these are long."""

    def __repr__(self) -> str:
        return "the files"


def test_what_is_no_bag(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    for data in (b"", b"hello", b"#ROSBAG V1.2\n"):
        path.write_bytes(data)
        with pytest.raises(UsageError, match=r"a\.bag: cannot be read as a bag \(it"):
            open_bag(path)


def test_other_files_of_sqlite(tmp_path: Path) -> None:
    endless = (
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT i AS id, 1 AS topic_id FROM n"
    )
    for name, schema in {
        "empty": "CREATE TABLE words(id)",
        "view": f"CREATE TABLE topics(id, name, type); CREATE VIEW messages AS {endless}",
    }.items():
        path = tmp_path / f"{name}.db3"
        with contextlib.closing(sqlite3.connect(path)) as connection:
            connection.executescript(schema)
        with pytest.raises(UsageError, match=r"it has no table (topics|messages)"):
            open_bag(path)
    path = write_bag(tmp_path / "odd.db3", {"/imu": even(30)})
    (file,) = path.glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("UPDATE messages SET timestamp = 'soon' WHERE id = 3")
        connection.execute("UPDATE messages SET data = 'words' WHERE id = 4")
        connection.execute("UPDATE messages SET data = zeroblob(200000) WHERE id = 5")
        connection.execute("INSERT INTO topics SELECT 9, name, type, 'json', '', '' FROM topics")
    stored = open_bag(path)
    assert stored.samples == 28
    assert "2 messages have not the layout" in told(stored)["bag_messages"]
    with pytest.raises(UsageError, match="no Imu messages of the topic '/other'"):
        open_bag(path, How(topic="/other"))


def test_a_full_disk_for_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_bag(tmp_path / "a.bag", {"/imu": even(30)})

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Spool, "append", full)
    with pytest.raises(UsageError, match=r"a\.bag: its numbers cannot be kept in a temporary file.*No space"):
        open_bag(path)


@pytest.fixture(scope="module")
def whole_files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = tmp_path_factory.mktemp("bags")
    found = Files()
    for kind in KINDS:
        topics = {"/imu": even(N)}
        path = write_bag(folder / f"rest.{kind}", topics, words=["/chatter"], chunk_bytes=60_000)
        file = path if path.is_file() else next(path.glob(f"*.{kind}"))
        found[kind] = file.read_bytes()
    found["lz4"] = write_bag(folder / "packed.bag", {"/imu": even(N)}, packed="lz4").read_bytes()
    return found


def read_anything(path: Path, data: bytes) -> Any:
    """What such a file gives: a recording, or None if it is refused in words."""
    path.write_bytes(data)
    try:
        source = ReplaySource(path, limits=Limits(max_chunk_mb=1, max_mb=1))
    except UsageError:
        return None
    return list(source.events())


@pytest.mark.parametrize("kind", [*KINDS, "lz4"])
@given(share=st.floats(0, 1))
@settings(max_examples=25)
def test_a_bag_that_is_cut_gives_what_it_holds(
    kind: str, share: float, whole_files: Files, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = whole_files[kind]
    path = tmp_path_factory.getbasetemp() / f"cut.{'bag' if kind == 'lz4' else kind}"
    size = int(share * (len(data) - 1))
    events = read_anything(path, data[:size])
    if events is None:
        assert share < 0.5 or kind in ("mcap", "lz4")  # whose only chunk is cut
        return
    troubles = [event for event in events if isinstance(event, Trouble)]
    assert "cut_recording" in {event.kind for event in troubles}
    blocks = [event for event in events if isinstance(event, RawBlock)]
    rows = np.concatenate([block.gyro for block in blocks])
    number = np.concatenate([block.sequence for block in blocks])  # of half a page the later rows are left
    np.testing.assert_allclose(np.radians(rows), np.asarray(even(N).gyro_rads)[number], rtol=1e-14)
    if kind == "bag":
        assert len(rows) > 0.8 * share * N - 60


def test_a_bag_without_its_index_was_not_closed(whole_files: Files, tmp_path: Path) -> None:
    data = whole_files["bag"]
    index = int.from_bytes(data[data.index(b"index_pos=") + 10 :][:8], "little")
    for end in (index, data.rindex(b"chunk_pos=") - 20, len(data) - 1):
        events = read_anything(tmp_path / "a.bag", data[:end])
        assert sum(len(event.gyro) for event in events if isinstance(event, RawBlock)) == N
        assert [event.kind for event in events if isinstance(event, Trouble)] == ["cut_recording"]
    never_closed = data[:index].replace(b"index_pos=" + index.to_bytes(8, "little"), b"index_pos=" + bytes(8))
    assert len(read_anything(tmp_path / "b.bag.active", never_closed)) > 1


@pytest.mark.parametrize("kind", [*KINDS, "lz4"])
@given(places=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=6))
@settings(max_examples=25)
def test_bags_that_were_changed_anywhere(
    kind: str,
    places: list[tuple[float, int]],
    whole_files: Files,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    data = bytearray(whole_files[kind])
    for share, value in places:
        data[int(share * (len(data) - 1))] = value
    path = tmp_path_factory.getbasetemp() / f"changed.{'bag' if kind == 'lz4' else kind}"
    read_anything(path, bytes(data))


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.binary(max_size=300), begin=st.integers(0, 200))
@settings(max_examples=25)
def test_any_bytes(
    kind: str,
    data: bytes,
    begin: int,
    whole_files: Files,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    path = tmp_path_factory.getbasetemp() / f"any.{kind}"
    read_anything(path, whole_files[kind][:begin] + data)

"""Tests bags of ROS 1 and ROS 2, written by the library `rosbags`, as recordings."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.bag_imu import GYRO, Encoding, Imu, read_ros, ros_layout
from fltea.recording.files import Stored
from fltea.recording.kind import is_one_file
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import UsageError
from fltea.settings.how import How
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType

from tests.rig.bag_support import (
    KINDS,
    START_NS,
    Messages,
    even,
    gathered,
    serialised,
    told,
    write_bag,
    write_mcap,
)

N = 900


def read_imu(messages: list[bytes], encoding: Encoding) -> Imu:
    layout = ros_layout("sensor_msgs/msg/Imu", encoding, b"")
    assert layout is not None
    assert layout.gyro == (f"{GYRO}.x", f"{GYRO}.y", f"{GYRO}.z")
    return read_ros(messages, layout, is_ros1=encoding == "ros1")


def opened(path: Path, messages: Messages) -> Stored:
    return open_bag(write_bag(path, {"/imu": messages}))


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
    """MCAP files of other programs are read: with or without chunks, with the profile of ROS 1 or of ROS 2,
    or without a profile.
    """
    rest = even(50)
    how = {"compression": packed or CompressionType.NONE, "use_chunking": packed is not None}
    path = write_mcap(tmp_path / "a.mcap", rest, profile=profile, chunk_size=4000, **how)
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
    assert found.time.tolist() == [[*divmod(stamp_ns, 10**9)]] * 2
    assert found.gyro.tolist() == [values[:3]] * 2
    assert found.accel.tolist() == [values[3:]] * 2


@pytest.mark.parametrize("frame", ["imu", "imu0", "imu_link", ""])
def test_messages_of_xcdr_2_are_aligned_to_four_bytes(frame: str) -> None:
    ((_, data),) = serialised(Messages([START_NS], [[1.5, 2.5, 3.5]], [[4.5, 5.5, 6.5]], frame=frame), False)
    # length of the message up to the end of the frame id: header of ROS 2's encoding, two numbers and the
    # text's length, then the text and its final zero
    text = 4 + 12 + len(frame) + 1
    numbers = data[len(data) - 37 * 8 :]
    packed = b"\0\7\0\0" + data[4:text] + bytes(-text % 4) + numbers
    found = read_imu([packed], "cdr")
    assert found.gyro.tolist() == [[1.5, 2.5, 3.5]]
    assert found.accel.tolist() == [[4.5, 5.5, 6.5]]
    # a header that states the encoding as a parameter list: such messages are not read
    assert not len(read_imu([b"\0\2\0\0" + packed[4:]], "cdr").row)


# --- topics ---


@pytest.mark.parametrize("kind", KINDS)
def test_several_topics_are_listed_and_one_is_named(tmp_path: Path, kind: str) -> None:
    left, right = even(40), even(30, seed=2)
    path = write_bag(tmp_path / f"two.{kind}", {"/left/imu": left, "/right/imu": right}, words=["/chatter"])
    with pytest.raises(UsageError, match=r"which of its 2 Imu topics is meant.*: --topic \?\n") as several:
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
        assert opened(tmp_path / "a.bag", one).whole().accel_ms2 is None


# --- times ---


def missing_in(stored: Stored, n: int) -> list[int]:
    """Return the missing numbers among n samples, given those present."""
    whole = stored.whole()
    assert whole.seq is not None
    return np.setdiff1d(np.arange(n), whole.seq).tolist()


def test_gaps_are_counted_by_header_stamps(tmp_path: Path) -> None:
    lost = [50, 51, 52, *range(200, 350)]
    stored = opened(tmp_path / "a.bag", even(600, 100.0).rows(np.setdiff1d(np.arange(600), lost)))
    assert missing_in(stored, 600) == lost
    assert stored.rate_hz == pytest.approx(100, rel=1e-9)


def test_messages_that_stand_there_twice_are_taken_once(tmp_path: Path) -> None:
    twice = np.repeat(np.arange(60), np.where(np.arange(60) % 20 == 5, 2, 1))
    stored = opened(tmp_path / "a.bag", even(60).rows(twice))
    assert stored.samples == 60
    assert re.search(r"(^| )3 messages repeat", told(stored)["bag_messages"])


def test_without_stamps_the_arrivals_are_taken_and_it_says_so(tmp_path: Path) -> None:
    rest = even(200)
    some = rest._replace(stamp_ns=[0] * 200, arrival_ns=rest.stamp_ns)
    stored = opened(tmp_path / "a.bag", some)
    assert stored.rate_hz == pytest.approx(200, rel=1e-6)
    assert "are 0, so the times of arrival are used" in told(stored)["bag_stamps"]
    with pytest.raises(UsageError, match="neither header stamps nor arrivals"):
        opened(tmp_path / "b.bag", some._replace(arrival_ns=[START_NS] * 200))


def test_a_clock_that_is_set_back_begins_a_new_stretch(tmp_path: Path) -> None:
    rest = even(400)
    stamps = [t - (3_600_000_000_000 if i >= 150 else 0) for i, t in enumerate(rest.stamp_ns)]
    stored = opened(tmp_path / "a.bag", rest._replace(stamp_ns=stamps, arrival_ns=rest.stamp_ns))
    whole = stored.whole()
    assert whole.epoch is not None
    assert np.bincount(whole.epoch).tolist() == [150, 250]
    assert stored.rate_hz == pytest.approx(200, rel=1e-6)
    assert "1 stamps run backwards; the clock was set 1 times" in told(stored)["bag_stamps"]


def test_values_that_are_no_numbers_are_missing_samples(tmp_path: Path) -> None:
    rest = even(300)
    gyro = np.array(rest.gyro_rads)
    gyro[[70, 71, 200], 1] = np.nan
    stored = opened(tmp_path / "a.mcap", rest._replace(gyro_rads=gyro))
    assert missing_in(stored, 300) == [70, 71, 200]
    assert "3 messages hold a value that is not a number" in told(stored)["bag_messages"]


def test_accelerations_that_are_no_numbers(tmp_path: Path) -> None:
    rest = even(300)
    accel = np.array(rest.accel_ms2)
    accel[[10, 20], 2] = np.inf
    stored = opened(tmp_path / "a.bag", rest._replace(accel_ms2=accel))
    assert stored.whole().accel_ms2 is not None
    assert missing_in(stored, 300) == [10, 20]
    stored = opened(tmp_path / "b.bag", rest._replace(accel_ms2=accel * np.nan))
    assert stored.samples == 300
    assert stored.whole().accel_ms2 is None
    assert "the acceleration is left out" in told(stored)["bag_messages"]

"""If a log of PX4 (ULog) is damaged anywhere, its intact parts are read, and the losses are reported."""

import struct
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.readers.ulog import mended
from fltea.records.errors import UsageError
from hypothesis import given
from hypothesis import strategies as st
from pyulog import ULog

from tests.rig.log_files import ulog
from tests.rig.table_support import open_here

N = 400
FORM = "float[3] gyro_rad;uint32_t gyro_integral_dt;float[3] accelerometer_m_s2;"
RADS = np.random.default_rng(1).normal(scale=0.01, size=(N, 3)).astype(np.float32)
ROWS: list[tuple[Any, ...]] = [
    (0, "3fI3f", 1_000_000 + 5_000 * k, *RADS[k], 5_000, 0.1, 0.2, -9.8) for k in range(N)
]
WHOLE = ulog({"sensor_combined": FORM}, [("sensor_combined", 0)], ROWS)
MESSAGE = 3 + 2 + 8 + 12 + 4 + 12
BEGIN = len(WHOLE) - N * MESSAGE
TOPIC = WHOLE[BEGIN - 3 - 3 - len("sensor_combined") : BEGIN]
"""The message that gives the topic its number."""
MIDDLE = BEGIN + N // 2 * MESSAGE


def read(folder: Path, data: bytes) -> Stored:
    path = folder / "log.ulg"
    path.write_bytes(data)
    return open_here("ulg", path)


def told(found: Stored) -> dict[str, str]:
    return {note.kind: note.text for note in found.notes}


def put(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


def test_a_whole_log_is_read_as_it_is(tmp_path: Path) -> None:
    found = read(tmp_path, WHOLE)
    assert (found.samples, found.notes, mended(WHOLE).data) == (N, (), b"")


@pytest.mark.parametrize("length", [0, 1, 65_535, MESSAGE - 3 + MESSAGE, (MESSAGE - 3) ^ 0x2000])
def test_a_length_that_is_wrong_costs_one_message(length: int, tmp_path: Path) -> None:
    """A wrong length of one message costs only this message, even if the wrong length ends exactly where a
    later message begins.
    """
    found = read(tmp_path, put(WHOLE, MIDDLE, struct.pack("<H", length)))
    assert found.whole().seq.tolist() == [k for k in range(N) if k != N // 2]
    assert (
        f"is damaged: {MESSAGE} bytes in one place, at byte {MIDDLE}, belong to no message"
        in told(found)["recording_gap"]
    )


@pytest.mark.parametrize("change", [(2, b"E"), (3, b"\x4d\x00")], ids=["kind", "topic"])
def test_messages_that_the_log_does_not_declare_are_counted(
    change: tuple[int, bytes], tmp_path: Path
) -> None:
    found = read(tmp_path, put(WHOLE, MIDDLE + change[0], change[1]))
    assert found.samples == N - 1
    assert "one message is of a kind or a topic that the log does not declare" in told(found)["recording_gap"]


def test_a_last_message_that_is_cut_is_told(tmp_path: Path) -> None:
    found = read(tmp_path, WHOLE[: MIDDLE + 20])
    assert found.samples == N // 2
    assert "ends in the middle of a message, whose 20 bytes are left out" in told(found)["cut_recording"]


def test_a_topic_whose_declaration_is_damaged_is_not_just_missing(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"with no topic .*angular_velocity\. It is damaged: \d+ bytes"):
        read(tmp_path, WHOLE.replace(b"\x00\x00\x00sensor_c", b"\x00\x00\x00sensor_d"))


@given(
    at=st.integers(BEGIN, len(WHOLE)),
    new=st.binary(max_size=12) | st.sampled_from([b"\x00\x00", b"\xff\xff"]),
    gone=st.integers(0, 100),
)
def test_all_messages_beside_any_damage_are_read(at: int, new: bytes, gone: int) -> None:
    data = WHOLE[:at] + new + WHOLE[at + gone :]
    before = (at - BEGIN) // MESSAGE
    behind = N - (min(at + gone, len(WHOLE)) - BEGIN + MESSAGE - 1) // MESSAGE
    found = mended(data)
    (topic,) = ULog(BytesIO(found.data or data)).data_list
    expected = [row[2] for row in (*ROWS[:before], *ROWS[N - behind :])]
    assert set(expected) <= set(topic.data["timestamp"].tolist())
    assert len(topic.data["timestamp"]) == found.counts["sensor_combined", 0]
    length = len(data) - found.lost_bytes - found.cut_bytes
    assert found.odd or length == BEGIN + MESSAGE * found.counts["sensor_combined", 0]


def test_padding_behind_the_last_field_may_be_logged_or_not(tmp_path: Path) -> None:
    """A message in a PX4 log may be logged with or without the padding after its last field.

    The library pyulog takes messages with padding for damaged, but they are read here.
    """
    form = f"{FORM}uint8_t[4] _padding0;"
    padded = [(row[0], f"{row[1]}4B", *row[2:], 0, 0, 0, 0) for row in ROWS]
    for one in (ROWS, padded, [*ROWS[: N // 2], *padded[N // 2 :]]):
        found = read(tmp_path, ulog({"sensor_combined": form}, [("sensor_combined", 0)], one))
        assert (found.samples, told(found).get("recording_gap")) == (N, None)


def test_a_log_with_a_part_appended_after_a_crash(tmp_path: Path) -> None:
    """A log has a part that was appended after a crash. The message that was being written at the crash is
    truncated.

    The file states the offset of the appended part. This offset still counts if bytes before it are damaged.
    """
    flags = bytes(8) + b"\x01" + bytes(7) + struct.pack("<3Q", MIDDLE + 20, 0, 0)
    data = WHOLE[: MIDDLE + 20] + WHOLE[MIDDLE + MESSAGE :]
    data = put(data, 16 + 3, flags)
    found = read(tmp_path, put(data, BEGIN + MESSAGE, b"\x00\x00"))
    assert found.whole().seq.tolist() == [k for k in range(N) if k not in (1, N // 2)]
    assert (
        f"{MESSAGE + 20} bytes in 2 places, the first at byte {BEGIN + MESSAGE},"
        in told(found)["recording_gap"]
    )


def test_a_topic_that_is_declared_again_keeps_its_messages(tmp_path: Path) -> None:
    found = read(tmp_path, WHOLE[:MIDDLE] + TOPIC + WHOLE[MIDDLE:])
    assert (found.samples, found.notes) == (N, ())


@pytest.mark.parametrize("number", [lambda k: k % 2, lambda k: int(k >= N // 2)], ids=["in turn", "halves"])
def test_a_topic_with_two_numbers_keeps_its_messages(number: Callable[[int], int], tmp_path: Path) -> None:
    rows = [(number(k), *row[1:]) for k, row in enumerate(ROWS)]
    found = read(tmp_path, ulog({"sensor_combined": FORM}, [("sensor_combined", 0)] * 2, rows))
    assert (found.samples, found.notes) == (N, ())
    assert found.rate_hz == pytest.approx(read(tmp_path, WHOLE).rate_hz)


def test_messages_that_the_library_forgets_are_counted(tmp_path: Path) -> None:
    """If a log gives a topic's number to a second sensor, PX4's library forgets the messages of the first."""
    found = read(tmp_path, WHOLE[:MIDDLE] + put(TOPIC, 3, b"\x07") + WHOLE[MIDDLE:])
    assert found.samples == N // 2
    assert f": the library of PX4 read {N // 2} of {N} messages of" in told(found)["recording_gap"]


def test_a_log_that_the_library_takes_for_damaged(tmp_path: Path) -> None:
    """One format names a field twice, so PX4's library refuses the topic of this format."""
    twice = {"sensor_combined": FORM, "sensor_gyro": "float x;float x;"}
    rows = [*ROWS, *((1, "2f", 1_000_000 + k, 0.1, 0.2) for k in range(10))]
    found = read(tmp_path, ulog(twice, [("sensor_combined", 0), ("sensor_gyro", 0)], rows))
    said = f": the library of PX4 takes the log for damaged, and read {N} of {N + 10} messages of"
    assert (found.samples, said in told(found)["recording_gap"]) == (N, True)


def declared_again(fields: str, *, is_first: bool = False) -> bytes:
    """Return the log with another declaration of its format, before or after the one that is right."""
    body = f"sensor_combined:uint64_t timestamp;{fields}".encode()
    right = WHOLE.index(b"sensor_combined:") - 3
    at = right if is_first else right + 3 + len(f"sensor_combined:uint64_t timestamp;{FORM}")
    return WHOLE[:at] + struct.pack("<HB", len(body), ord("F")) + body + WHOLE[at:]


@pytest.mark.parametrize("is_first", [True, False])
@pytest.mark.parametrize("fields", ["float[3] gyro_rad;", f"{FORM}float[3] more;"])
def test_a_format_that_is_declared_twice_is_the_one_that_fits(
    fields: str, is_first: bool, tmp_path: Path
) -> None:
    """No message has the length of the other declaration, so all would seem to be damaged."""
    found = read(tmp_path, declared_again(fields, is_first=is_first))
    assert found.whole().gyro == pytest.approx(np.rad2deg(RADS), rel=1e-6)
    assert "declares the fields of sensor_combined twice" in told(found)["recording_gap"]


def test_a_format_with_other_fields_of_the_same_length_is_refused(tmp_path: Path) -> None:
    again = "float[3] accelerometer_m_s2;uint32_t gyro_integral_dt;float[3] gyro_rad;"
    with pytest.raises(
        UsageError, match="declares the fields of sensor_combined twice, each time others, and"
    ):
        read(tmp_path, declared_again(again))


def test_a_format_that_is_declared_again_as_it_was_is_no_loss(tmp_path: Path) -> None:
    assert read(tmp_path, declared_again(FORM)).notes == ()


OF_DEVICE = "uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;"


def of_devices(devices: list[int]) -> bytes:
    """Return a log of a topic whose messages name these devices, at 200 Hz."""
    rows = [(0, "QI3f", 1_000_000 + 5_000 * k, 5_000 * k, one, *RADS[k % N]) for k, one in enumerate(devices)]
    return ulog({"sensor_gyro": OF_DEVICE}, [("sensor_gyro", 0)], rows)


@pytest.mark.parametrize("other", [{200: 123}, {200: 0, 201: 7}, {0: 9}])
def test_a_few_messages_of_another_device_are_left_out(other: dict[int, int], tmp_path: Path) -> None:
    found = read(tmp_path, of_devices([other.get(k, 122) for k in range(N)]))
    left = [k for k in range(N) if k not in other]
    assert found.whole().gyro == pytest.approx(np.rad2deg(RADS[left]), rel=1e-6)
    assert found.rate_hz == pytest.approx(200.0)
    numbers = found.whole().seq
    assert numbers is not None
    assert (numbers - numbers[0]).tolist() == [k - left[0] for k in left]
    said = f"in {len(other)} of {N} messages of sensor_gyro, and 122 in all others; the former are left out"
    assert said in told(found)["recording_gap"]


def test_zeros_over_one_message_cost_only_that_message(tmp_path: Path) -> None:
    data = of_devices([122] * N)
    size = 3 + 2 + 8 + 8 + 4 + 12
    found = read(tmp_path, put(data, len(data) - 200 * size + 3, bytes(size - 3)))
    assert found.samples == N - 1
    assert f"device_id is 0 in 1 of {N} messages of sensor_gyro, and 122" in told(found)["recording_gap"]


def test_many_messages_of_another_device_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"of several sensors one after the other \(device_id 122, 123\)"):
        read(tmp_path, of_devices([122] * (N - 20) + [123] * 20))

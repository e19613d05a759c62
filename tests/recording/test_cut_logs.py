"""Logs of ArduPilot and TDMS files of LabVIEW that are cut off or damaged say what is left out."""

import gc
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.files import Note
from fltea.recording.readers.tdms_parts import checked
from fltea.records.errors import UsageError
from nptdms import ChannelObject, TdmsWriter

from tests.rig.corpus_files import GYRO_DPS, HERE, N
from tests.rig.log_files import dataflash
from tests.rig.table_support import stored_here

pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
"""Ignores warnings about files left open. Normally they are closed when the reader process ends."""

LOG = (HERE / "ardupilot.bin").read_bytes()
MESSAGE_BYTES = 54
TDMS = (HERE / "labview.tdms").read_bytes()


@pytest.fixture(autouse=True, scope="module")
def closed_files() -> Iterator[None]:
    """Close at once the files that readers left open, and not in the middle of another test."""
    yield
    gc.collect()


def notes_of(path: Path, data: bytes, left: list[int]) -> tuple[Note, ...]:
    """Read a log, check that it holds the samples `left`, and return the notes about it."""
    path.write_bytes(data)
    found = stored_here(path)
    assert found.whole().gyro == pytest.approx(GYRO_DPS[left], abs=1e-5)
    return found.notes


@pytest.mark.parametrize("lacking", [1, 20, MESSAGE_BYTES - 1])
def test_the_last_bytes_of_a_cut_log_of_ardupilot_are_counted(lacking: int, tmp_path: Path) -> None:
    (note,) = notes_of(tmp_path / "log.bin", LOG[:-lacking], [*range(N - 1)])
    assert note.kind == "cut_recording"
    assert f"log.bin: its last {MESSAGE_BYTES - lacking} bytes are no whole message" in note.text


@pytest.mark.parametrize("lost", [0, 30, N - 1])
def test_bytes_of_a_log_of_ardupilot_that_are_no_message_are_counted(lost: int, tmp_path: Path) -> None:
    """Damaged bytes are counted, because times do not show every loss: if the first samples are lost, there
    is no gap between times.

    Bytes may be missing at the end of the message before the damage as well, so this one is left out, too.
    """
    at = len(LOG) - (N - lost) * MESSAGE_BYTES
    data = LOG[:at] + LOG[at + 5 : at + MESSAGE_BYTES].replace(b"\xa3", b"\0") + LOG[at + MESSAGE_BYTES :]
    (note,) = notes_of(tmp_path / "log.bin", data, [k for k in range(N) if k not in (lost, lost - 1)])
    is_last = lost == N - 1
    assert note.kind == ("cut_recording" if is_last else "recording_gap")
    assert f"{MESSAGE_BYTES * (1 if lost == 0 else 2) - 5} bytes " in note.text


def in_place(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


RATES = np.random.default_rng(2).normal(scale=0.01, size=(60, 3)).astype(np.float32)
LONG = "GYR", "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"
FORMS = {name: (fields, columns) for name, fields, columns in [LONG, ("ATT", "Qccc", "TimeUS,R,P,Y")]}
GYR = [("GYR", 10_000 * k, 0, 10_000 * k, *RATES[k]) for k in range(len(RATES))]
TURNS = dataflash(
    FORMS, (one for k, row in enumerate(GYR) for one in (row, *[("ATT", row[1], 1, 2, 3)] * (k % 9 == 0)))
)
MIDDLE = TURNS.index(b"\xa3\x95\x81", TURNS.index(struct.pack("<Q", 10_000 * 29), 300))
"""Offset of the message of sample 30, which no other kind of message precedes or follows."""
GYR_BYTES, ATT_BYTES, FMT_BYTES = 3 + 29, 3 + 14, 89


@pytest.mark.parametrize(
    "new", [b"\xa3\x95\x55", b"\xa3\x95\x80", b"\xa3\x95\x82", b"\0", b"\xa3\0", b"\xa3\x95\x55" + bytes(29)]
)
def test_damage_in_a_log_of_ardupilot_costs_one_message(new: bytes, tmp_path: Path) -> None:
    """The library ends at a kind that it does not know, and otherwise reads other bytes as a message."""
    path = tmp_path / "log.bin"
    path.write_bytes(in_place(TURNS, MIDDLE, new))
    found = stored_here(path)
    assert found.whole().gyro == pytest.approx(np.rad2deg(np.delete(RATES, 30, axis=0)), rel=1e-6)
    (note,) = found.notes
    assert note.kind == "recording_gap"
    assert f"log.bin: is damaged: {GYR_BYTES} bytes in one place, at byte {MIDDLE}, belong to no" in note.text


def test_a_short_message_is_not_read_as_a_longer_one(tmp_path: Path) -> None:
    """With the number of GYR, ATT would be a sample whose rates are bytes of the next message."""
    at = TURNS.index(b"\xa3\x95\x82", MIDDLE)
    path = tmp_path / "log.bin"
    path.write_bytes(in_place(TURNS, at + 2, b"\x81"))
    found = stored_here(path)
    assert found.whole().gyro == pytest.approx(np.rad2deg(RATES), rel=1e-6)
    assert f"is damaged: {ATT_BYTES} bytes in one place, at byte {at}" in found.notes[0].text


def test_several_holes_in_a_log_of_ardupilot_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "log.bin"
    data = in_place(TURNS, MIDDLE + GYR_BYTES, b"\xa3\x95\x55")
    path.write_bytes(data[: MIDDLE - GYR_BYTES] + data[MIDDLE - 7 :])
    found = stored_here(path)
    assert found.whole().gyro == pytest.approx(np.rad2deg(np.delete(RATES, [28, 29, 31], axis=0)), rel=1e-6)
    text = f"is damaged: {7 + 2 * GYR_BYTES} bytes in 2 places, the first at byte {MIDDLE - 2 * GYR_BYTES}"
    assert text in found.notes[0].text


@pytest.mark.parametrize("change", ["removed", "inserted"])
def test_a_message_with_shifted_bytes_is_no_sample(change: str, tmp_path: Path) -> None:
    """It would have the right length, but numbers made of other bytes."""
    path, at = tmp_path / "log.bin", MIDDLE + 10
    path.write_bytes(
        TURNS[:at] + TURNS[at + 5 :] if change == "removed" else TURNS[:at] + b"12345" + TURNS[at:]
    )
    found = stored_here(path)
    assert found.whole().gyro == pytest.approx(np.rad2deg(np.delete(RATES, 30, axis=0)), rel=1e-6)


def test_a_log_of_ardupilot_whose_formats_are_damaged_says_so(tmp_path: Path) -> None:
    """Advice to log the gyroscope would be wrong: its messages are there."""
    path = tmp_path / "log.bin"
    path.write_bytes(in_place(TURNS, FMT_BYTES + 2, b"\x55"))
    with pytest.raises(UsageError, match=r"it has ATT, FMT\. The log: is damaged: \d+ bytes in") as caught:
        stored_here(path)
    assert "LOG_BITMASK" not in str(caught.value)


@pytest.mark.parametrize("padding", [b"\xff" * 249, bytes(527), b""])
def test_padding_at_the_end_of_a_log_of_ardupilot_is_no_loss(padding: bytes, tmp_path: Path) -> None:
    assert notes_of(tmp_path / "log.bin", LOG + padding, [*range(N)]) == ()


def test_a_tdms_file_that_was_never_finished_is_noted(tmp_path: Path) -> None:
    """All bits of the length of a part are set until LabVIEW has finished the part."""
    data = bytearray(TDMS)
    struct.pack_into("<Q", data, 12, (1 << 64) - 1)
    (note,) = notes_of(tmp_path / "rest.tdms", bytes(data), [*range(N)])
    assert (note.kind, "ends within its last part" in note.text) == ("cut_recording", True)


@pytest.mark.parametrize("end", [len(TDMS) - 955, len(TDMS) - 960, len(TDMS) - 1200])
def test_a_tdms_file_that_is_cut_off_is_noted(end: int, tmp_path: Path) -> None:
    """The library gives the channels that are left, so that an axis or two may be missing."""
    (tmp_path / "rest.tdms").write_bytes(TDMS[:end])
    found = stored_here(tmp_path / "rest.tdms")
    assert found.whole().gyro.shape[1] < 3
    assert [note.kind for note in found.notes] == ["cut_recording"]


def test_a_tdms_file_that_is_whole_has_no_note(tmp_path: Path) -> None:
    assert notes_of(tmp_path / "rest.tdms", TDMS + TDMS, [*range(N), *range(N)])[0].kind == "reading"
    assert np.size(notes_of(tmp_path / "one.tdms", TDMS, [*range(N)])) == 0


PARTS, ROWS = 5, 40
VALUES = np.random.default_rng(1).normal(size=(PARTS, ROWS, 3))
PART_BYTES = ROWS * 3 * 8


def in_parts(path: Path, stated: object = 0.01) -> list[int]:
    """Write a LabVIEW file (TDMS) in parts. Return where each part begins, and where the file ends."""
    with TdmsWriter(path) as out:
        for part in VALUES:
            out.write_segment(
                [
                    ChannelObject(
                        "imu", f"gyro_{axis}", part[:, k], {"wf_increment": stated, "unit_string": "deg/s"}
                    )
                    for k, axis in enumerate("xyz")
                ]
            )
    data = path.read_bytes()
    begins = [k for k in range(len(data)) if data.startswith(b"TDSm", k)]
    assert len(begins) == PARTS
    return [*begins, len(data)]


@pytest.mark.parametrize(
    "lacking", [1, 8, ROWS * 8 - 3, ROWS * 8, ROWS * 8 + 3, PART_BYTES - 9, PART_BYTES + 9]
)
def test_the_rows_of_the_last_part_of_tdms_that_are_whole_are_read(lacking: int, tmp_path: Path) -> None:
    """In a part, all values of x come before those of y, so that a cut leaves channels of unequal lengths."""
    path = tmp_path / "rest.tdms"
    in_parts(path)
    path.write_bytes(path.read_bytes()[:-lacking])
    found = stored_here(path)
    rows = max(ROWS - -(-lacking // 8), 0) + (PARTS - 1) * ROWS
    assert found.whole().gyro == pytest.approx(VALUES.reshape(-1, 3)[:rows])
    (note,) = [note for note in found.notes if note.kind == "cut_recording"]
    assert f"bytes missing: {lacking}" in note.text
    if lacking < PART_BYTES:
        assert f"{(PARTS * ROWS - rows) if lacking < 2 * ROWS * 8 else 1} of gyro_x" in note.text


def damaged(data: bytes, at: list[int], how: str) -> bytes:
    """Return the data with damage in the part before the last but one."""
    begin, end = at[2], at[3]
    match how:
        case "tag":
            return data[:begin] + b"XXXX" + data[begin + 4 :]
        case "length":
            return data[: begin + 12] + struct.pack("<Q", end - begin) + data[begin + 20 :]
        case "length beyond the file":
            return data[: begin + 12] + struct.pack("<Q", 1 << 40) + data[begin + 20 :]
        case "description":
            return data[: begin + 28] + b"\x7f" * 40 + data[begin + 68 :]
        case "hole":
            return data[: end - 500] + data[end - 400 :]
    return data[: begin + 10] + data[end - 30 :]


@pytest.mark.parametrize(
    "how", ["tag", "length", "length beyond the file", "description", "hole", "most is gone"]
)
def test_a_damaged_part_of_tdms_costs_only_this_part(how: str, tmp_path: Path) -> None:
    path = tmp_path / "rest.tdms"
    at = in_parts(path)
    data = damaged(path.read_bytes(), at, how)
    path.write_bytes(data)
    found = stored_here(path)
    assert found.whole().gyro == pytest.approx(
        np.concatenate([VALUES[k] for k in (0, 1, 3, 4)]).reshape(-1, 3)
    )
    (note,) = [note for note in found.notes if note.kind == "recording_gap"]
    lost = at[3] - at[2] - (at[-1] - len(data))
    assert f"rest.tdms: is damaged: {lost} bytes in one place, at byte {at[2]}" in note.text


@pytest.mark.parametrize("part", [0, 2])
def test_a_description_with_other_bytes_is_not_read_as_other_channels(part: int, tmp_path: Path) -> None:
    """The library would read a channel of another name, and take its values away from the gyroscope."""
    path = tmp_path / "rest.tdms"
    at = in_parts(path)
    data = path.read_bytes()
    path.write_bytes(data[: at[part] + 36] + b"\x7f" * 5 + data[at[part] + 41 :])
    found = stored_here(path)
    assert len(found.whole().gyro) == ROWS * (PARTS - 1)
    assert [note.kind for note in found.notes] == ["recording_gap", "reading"]


def test_a_file_of_tdms_of_which_no_part_is_whole_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rest.tdms").write_bytes(TDMS[:36] + b"\x7f" * 5 + TDMS[41:])
    with pytest.raises(UsageError, match="is damaged: none of its parts is whole"):
        stored_here(tmp_path / "rest.tdms")


def test_what_the_examples_of_tdms_describe_is_understood() -> None:
    """Otherwise a part that is whole would be left out where another one is damaged."""
    for path in HERE.glob("*.tdms"):
        assert not checked(path).lost, path

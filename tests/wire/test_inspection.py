"""Tests that `fltea inspect` prints a line for every frame of a stream of bytes: frames of each kind, good or
bad.
"""

from collections import Counter
from pathlib import Path

import pytest
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.inspection import HEX_BYTES_SHOWN, describe, inspect, summary
from fltea.wire.messages import REASONS, Frame

from tests.rig.host_support import fltea, fltea_here
from tests.rig.protocol_support import records
from tools.own_estimator import f32

ACCEL = "accel_x -120  accel_y 85  accel_z 16390"
REFUSED_STREAM = "a device of another version"


def stream(record: list[tuple[str, str]]) -> bytes:
    return bytes.fromhex("".join(value for key, value in record if key in ("bytes", "wire")))


def lines_of(data: bytes) -> tuple[list[str], FrameReader]:
    reader = FrameReader()
    return list(inspect([data], reader)), reader


STREAMS = {dict(record)["name"]: record for record in records("streams.txt")}
BAD = {dict(record)["name"]: record for record in records("bad.txt") if "bad" in dict(record)}


@pytest.mark.parametrize("name", STREAMS)
def test_every_thing_in_a_stream_has_its_line(name: str) -> None:
    record = STREAMS[name]
    lines, reader = lines_of(stream(record))
    expected = [(key, value) for key, value in record if key in ("frame", "bad", "refused")]
    assert len(lines) == len(expected)
    for line, (key, value) in zip(lines, expected, strict=True):
        if key == "frame":
            kind, sequence, device_us = map(int, value.split())
            assert line.removeprefix("? ").split()[0] == wire.MESSAGES[kind].__name__.upper()
            assert f" seq {sequence:5}  t {device_us / 1e6:11.6f} s  " in line
        elif key == "bad":
            assert line.startswith(f"bad      {value} ({REASONS[value]}): ")
        else:
            assert "REFUSED" in line
    text = summary(reader)
    counts = {reason: int(n) for reason, n in (value.split() for key, value in record if key == "count")}
    assert text.startswith(f"{len(stream(record))} bytes, {counts.pop('frames', 0)} good frames")
    for reason, n in counts.items():
        assert f"{n} {reason}" in text


@pytest.mark.parametrize("name", BAD)
def test_bad_block_is_shown_in_hex_with_its_reason(name: str) -> None:
    record = dict(BAD[name])
    lines, reader = lines_of(stream(BAD[name]))
    assert len(lines) == 1
    head, _, tail = lines[0].partition("): ")
    assert head == f"bad      {record['bad']} ({REASONS[record['bad']]}"
    shown = bytes.fromhex(tail.removesuffix(" …"))
    assert len(shown) <= HEX_BYTES_SHOWN
    assert shown in stream(BAD[name])
    assert tail.endswith(" …") == (len(shown) == HEX_BYTES_SHOWN and len(stream(BAD[name])) > 2 + len(shown))
    assert reader.counts == {record["bad"]: 1}


def line(message: wire.Message) -> str:
    return describe(Frame(message.TYPE, 65535, 2**32 - 1, message))


def test_hello() -> None:
    scales = (100_000, 2000, 164, 2, 16384, 184)
    hello = wire.Hello(1, 0, wire.SCHEMA_HASH, 0x0A, bytes(range(16)), "fltea 0.1", 0x71, 2, *scales, 1)
    assert line(hello) == (
        f"HELLO    seq 65535  t 4294.967295 s  protocol_major 1  protocol_minor 0  "
        f"schema_hash 0x{wire.SCHEMA_HASH:08X}  boot_id 0x0000000A  "
        "device_id 000102030405060708090a0b0c0d0e0f  firmware_version 'fltea 0.1'  who_am_i 0x71  "
        "sensor_starts 2  sample_rate 100000  gyro_range 2000  gyro_lsb 164  accel_range 2  accel_lsb 16384  "
        "gyro_dlpf 184  sampling_mode 1 (data_ready)"
    )


def test_text_of_a_device_cannot_steer_the_terminal() -> None:
    hello = wire.Hello(1, 0, wire.SCHEMA_HASH, 1, bytes(16), "\x1b[2J\r\n", 0x71, 1, 1, 1, 1, 1, 1, 1, 0)
    text = line(hello)
    assert "\x1b" not in text
    assert "\n" not in text


SMALL = f32(0.01)


@pytest.mark.parametrize(
    ("message", "inside", "end"),
    [
        *(
            (
                wire.Sample(12, -7, 3, -120, 85, 16390, -1042, flags),
                f"  gyro_x 12  gyro_y -7  gyro_z 3  {ACCEL}",
                text,
            )
            for flags, text in (
                (0, "  temperature -1042  flags 0"),
                (1, "flags 1 (late)"),
                (12, "flags 12 (saturated|repeated)"),
                (0x40, "flags 64"),
                (0x41, "flags 65 (late)"),
            )
        ),
        (
            wire.Status(1, 2, 3, 4, 5, 2, 6, 7),
            "  dropped_frames 5  ",
            "2 (watchdog)  cpu_share 6  longest_step 7",
        ),
        (wire.Status(1, 2, 3, 4, 5, 255, 6, 7), "255 (unknown)", "  longest_step 7"),
        (wire.Status(1, 2, 3, 4, 5, 77, 6, 7), "  reset_cause 77  ", "  longest_step 7"),
        (
            wire.Estimate(1, 9, 7, 8, *[0.1] * 6, *[0] * 9, *[0.1] * 4),
            "  axis 1 (gyro_y)  flags 9 (valid|skipped)  sample 7  age 8  alpha 0.1  ",
            "",
        ),
        (
            wire.Estimator(1, 2, *[3] * 13, *[SMALL] * 18),
            "  variant 1 (joint)  guard 2 (consistent)  startup 3  ",
            "  gate 0.01",
        ),
        (
            wire.Fit(1, 2, 3, *[4] * 4, *[SMALL] * 8),
            "  axis 1 (gyro_y)  verdict 2 (fractional)  flags 3 (alpha_defined|searched)  number 4  ",
            "",
        ),
        (wire.Fault(3, 0x1A0001), "", "code 3 (readback_mismatch)  detail 0x001A0001"),
        (wire.Fault(99, 0x1A0001), "", "code 99  detail 0x001A0001"),
    ],
)
def test_fields_have_the_words_of_their_message(message: wire.Message, inside: str, end: str) -> None:
    shown = line(message)
    assert shown.startswith(f"{type(message).__name__.upper():8} seq 65535")
    assert inside in shown
    assert shown.endswith(end)


def test_refused_device_is_named_with_both_versions() -> None:
    lines, reader = lines_of(stream(STREAMS[REFUSED_STREAM]))
    assert "REFUSED" in lines[0]
    assert "2.0" in lines[0]
    assert "0x00000001" in lines[0]
    assert f"{wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}" in lines[0]
    assert f"0x{wire.SCHEMA_HASH:08X}" in lines[0]
    assert reader.counts == Counter(frames=1)
    assert lines[1].startswith("? "), "the layout of what follows is not known"


# --- the command ---


def capture(tmp_path: Path, name: str) -> Path:
    path = tmp_path / "capture.bin"
    path.write_bytes(stream(STREAMS[name]))
    return path


def test_command_prints_lines_and_their_sum(tmp_path: Path) -> None:
    name = "unknown types and wrong lengths"
    result = fltea("inspect", capture(tmp_path, name))
    lines, reader = lines_of(stream(STREAMS[name]))
    assert result.stdout.splitlines() == [*lines, summary(reader)]
    assert (result.returncode, result.stderr) == (0, "")


def test_command_stops_after_the_limit(tmp_path: Path) -> None:
    result = fltea_here("inspect", capture(tmp_path, "rubbish between frames"), "--limit", "2")
    assert len(result.stdout.splitlines()) == 3
    assert result.returncode == 0


def test_command_fails_without_one_good_frame(tmp_path: Path) -> None:
    result = fltea_here("inspect", capture(tmp_path, "nothing but idle 0x00"))
    assert result.returncode == 1
    assert "not one valid frame" in result.stderr


def test_command_names_what_it_cannot_read(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "none.bin", "no such file or port"), (tmp_path, "is a directory")):
        result = fltea_here("inspect", path)
        assert (result.returncode, result.stdout) == (2, "")
        assert result.stderr.startswith(f"fltea: error: {path}: ")
        assert reason in result.stderr

"""Tests the events that come from a device with a kernel driver (IIO).

A folder of files and a FIFO take the place of /sys and of the node in /dev.
"""

import errno
import json
import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.records.errors import UsageError
from fltea.records.events import Event, LinkDown, RawBlock, Tick, Trouble
from fltea.records.records import Hello
from fltea.sources.iio import buffer, source
from fltea.sources.iio.source import IioSource
from fltea.stream.decode import Decoder

from tests.rig.fake_iio import FakeIio, imu, scan
from tests.rig.host_support import fltea

MS = 10**6
BEGIN_NS = 1_700_000_000 * 10**9


class Player:
    """Drives a source, and writes to its FIFO, in one thread."""

    def __init__(self, device: FakeIio, query: str = "") -> None:
        self.source = IioSource(device.url.removeprefix("iio:") + query)
        self.events = self.source.events()
        self.device = device
        self._writer = -1

    def open(self) -> None:
        """Let the source open the device. Then open the FIFO for writing, since the test takes the place of
        the kernel.
        """
        assert isinstance(next(self.events), Tick)
        self._writer = os.open(self.device.node, os.O_WRONLY)

    def play(self, data: bytes, kind: type[Event] = RawBlock) -> list[Any]:
        """Write data to the FIFO, and return the source's events up to the first event of a kind."""
        os.write(self._writer, data)
        return self.until(kind)

    def until(self, kind: type[Event]) -> list[Any]:
        """Return the source's events up to the first one of this kind, without `Tick` ("nothing came")."""
        found = []
        for event in self.events:
            found += [] if isinstance(event, Tick) else [event]
            if isinstance(event, kind):
                return found
        raise AssertionError(f"no {kind.__name__} came")

    def lose(self) -> None:
        os.close(self._writer)

    def close(self) -> None:
        self.source.close()
        assert not [event for event in self.events if isinstance(event, Trouble)]


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "TICK_S", 0.01)
    monkeypatch.setattr(source, "BACKOFF_S", (0.0,))


def scans(first: int, last: int, step_ns: int = 5 * MS) -> bytes:
    return b"".join(scan(k, BEGIN_NS + k * step_ns) for k in range(first, last))


def first_trouble(url: str) -> Trouble:
    one = IioSource(url.removeprefix("iio:"))
    trouble = next(event for event in one.events() if isinstance(event, Trouble))
    one.close()
    return trouble


def test_samples_with_scale_mount_matrix_rate_and_gaps(tmp_path: Path) -> None:
    device = imu(tmp_path)
    before = device.settings()
    player = Player(device, "?rate_hz=200")
    player.open()
    assert device.get("trigger/current_trigger") == "bmi160-dev0"
    assert (device.get("buffer/enable"), device.get("buffer/length")) == ("1", "400")
    assert device.get("current_timestamp_clock") == "monotonic"
    assert device.get("scan_elements/in_temp_en") == "0"
    found = player.play(scans(0, 500))
    hello, block = found
    assert [type(event) for event in found] == [Hello, RawBlock]
    assert hello.rate_hz == pytest.approx(200.0)
    assert (hello.sampling_mode, hello.sensor) == ("iio", "bmi160")
    # the device states a scale of 0.001064724 rad/s
    assert hello.gyro_lsb_per_dps == pytest.approx(16.3921, rel=1e-4)
    assert hello.accel_lsb_per_g == pytest.approx(16393.5, rel=1e-4)
    assert block.sequence.tolist() == list(range(500))
    assert block.gyro[1].tolist() == [49.0, -1.0, 3.0]  # by the mount matrix, the axes become y, -x and z
    assert block.accel[1].tolist() == [100.0, -200.0, 16001.0]
    place = Decoder(lambda: 0, max_gap=10)
    place.on_hello(hello)
    list(place.feed(block))
    data = scans(500, 510) + scans(513, 520)  # three scans are lost
    pieces = [*player.play(data[:37]), *player.play(data[37:])]
    for piece in pieces:
        list(place.feed(piece))
    assert np.concatenate([piece.sequence for piece in pieces]).tolist() == [
        *range(500, 510),
        *range(513, 520),
    ]
    assert (place.counts.lost, player.source.link_stats().frames) == (3, 517)
    player.close()
    assert device.settings() == before


@pytest.mark.parametrize(
    ("query", "gyro", "accel"),
    [
        ("", [49.0, -1.0, 3.0], [-200.0, -100.0, 16001.0]),
        ("?mount=off", [1.0, 49.0, 3.0], [100.0, -200.0, 16001.0]),
    ],
)
@pytest.mark.parametrize("name", ["mount_matrix", "in_mount_matrix"])
def test_a_mount_matrix_that_all_sensors_share(
    tmp_path: Path, name: str, query: str, gyro: list[float], accel: list[float]
) -> None:
    """The mount matrix stands in different files. The drivers of the ICM-42600, of the LSM6DSx and of ST have
    one file for all channels (`mount_matrix`).

    Other drivers have one file for each direction of channels, input or output (`in_mount_matrix`).
    """
    device = imu(tmp_path)
    device.put(name, device.get("in_anglvel_mount_matrix"))
    (device.folder / "in_anglvel_mount_matrix").unlink()
    player = Player(device, query)
    player.open()
    _, block = player.play(scans(0, 500))
    assert (block.gyro[1].tolist(), block.accel[1].tolist()) == (gyro, accel)
    player.close()


def test_a_trigger_that_the_driver_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The driver inv_mpu6050 takes samples only at its own trigger, and refuses all others."""
    device, write = imu(tmp_path), Path.write_text

    def refuse(path: Path, text: str, encoding: str) -> int:
        if path.name == "current_trigger":
            raise OSError(errno.EINVAL, "Invalid argument")
        return write(path, text, encoding=encoding)

    monkeypatch.setattr(Path, "write_text", refuse)
    trouble = first_trouble(device.url)
    assert (trouble.kind, "only the chip's own trigger" in trouble.message) == ("no_trigger", True)


def test_a_lost_device_is_told_and_opened_again(tmp_path: Path) -> None:
    player = Player(imu(tmp_path))
    player.open()
    player.play(scans(0, 500))
    player.lose()
    down, trouble = player.until(Trouble)
    assert (type(down), trouble.kind) == (LinkDown, "unplugged")
    player.open()
    assert [type(event) for event in player.play(scans(900, 1400))] == [Hello, RawBlock]
    assert player.source.link_stats().reconnects == 1
    player.close()


def test_samples_that_wait_for_their_rate_are_not_lost_with_the_device(tmp_path: Path) -> None:
    """Samples of one second wait, since their times do not yet suffice to tell the rate. Then the device is
    lost. The samples are still delivered.
    """
    player = Player(imu(tmp_path))
    player.open()
    player.play(scans(0, 200), kind=Tick)
    player.lose()
    hello, block, down, _ = player.until(Trouble)
    assert [type(event) for event in (hello, block, down)] == [Hello, RawBlock, LinkDown]
    assert hello.rate_hz == pytest.approx(200.0)
    assert block.sequence.tolist() == list(range(200))
    assert player.source.link_stats().frames == 200
    player.open()
    assert [type(event) for event in player.play(scans(900, 1400))] == [Hello, RawBlock]
    player.close()


def test_samples_that_wait_for_their_rate_are_handed_on_at_the_end(tmp_path: Path) -> None:
    """The user ends the program within two seconds."""
    player = Player(imu(tmp_path))
    player.open()
    player.play(scans(0, 200), kind=Tick)
    player.source.close()
    hello, block = (event for event in player.events if not isinstance(event, Tick))
    assert [type(event) for event in (hello, block)] == [Hello, RawBlock]
    assert block.sequence.tolist() == list(range(200))
    assert player.source.link_stats().frames == 200


def test_samples_whose_rate_stays_unknown_are_counted(tmp_path: Path) -> None:
    player = Player(imu(tmp_path))
    player.open()
    player.play(scans(0, 1), kind=Tick)
    player.lose()
    assert [event.kind for event in player.until(LinkDown)[:-1]] == ["no_rate"]
    assert player.source.link_stats().bad_frames == {"no_rate": 1}
    assert next(player.events).kind == "unplugged"
    player.close()


def test_without_time_stamps_the_order_numbers(tmp_path: Path) -> None:
    device = FakeIio(tmp_path, "adxrs")
    device.channel("anglvel_z", 0, "be:s14/16>>2")
    for name, text in {"in_anglvel_scale": "0.1", "buffer/enable": "1", "buffer/length": "512"}.items():
        device.put(name, text)
    assert "does not say its rate" in first_trouble(device.url).message
    device.put("sampling_frequency", "100")
    player = Player(device)
    player.open()
    *_, block = player.play(bytes([0xFF, 0xFC, 0x00, 0x08]))
    assert (block.gyro.tolist(), block.sequence.tolist(), block.accel) == ([[-1.0], [2.0]], [0, 1], None)
    player.close()


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        ({"trigger/current_trigger": "gone"}, "no_trigger", "there is no trigger 'gone'"),
        ({"in_anglvel_scale": "0"}, "open_failed", "is not positive and finite"),
        ({"in_anglvel_scale": "x"}, "open_failed", "does not say the scale of its gyroscope"),
        ({"in_anglvel_mount_matrix": "1,2"}, "open_failed", "is no 3 x 3 matrix"),
        ({"mount_matrix": "1, 0, 0; 0, 1, 0; 0, 0, -1"}, "open_failed", "accelerometer: mount matrix"),
        ({"scan_elements/in_accel_x_type": "le:s16/17>>0"}, "open_failed", "accel_x"),
    ],
)
def test_what_a_device_lacks(tmp_path: Path, change: dict[str, str], kind: str, words: str) -> None:
    device = imu(tmp_path)
    for name, text in change.items():
        device.put(name, text)
    before = device.settings()
    trouble = first_trouble(device.url + ("?trigger=gone" if kind == "no_trigger" else ""))
    assert (trouble.kind, words in trouble.message) == (kind, True), trouble.message
    assert device.settings() == before


def test_no_trigger_at_all_says_how_to_make_one(tmp_path: Path) -> None:
    device = imu(tmp_path)
    (tmp_path / "sys/bus/iio/devices/trigger0/name").write_text("other\n")
    trouble = first_trouble(device.url)
    assert trouble.kind == "no_trigger"
    assert "Triggers that exist: other" in trouble.message
    assert "iio-trig-hrtimer" in trouble.message


def test_names(tmp_path: Path) -> None:
    imu(tmp_path)
    FakeIio(tmp_path, "bmi160", 1)
    tree = f"{tmp_path}/sys/bus/iio/devices"
    assert "there is no IIO device" in first_trouble(f"iio:{tree}/iio:device7").message
    accelerometer = FakeIio(tmp_path, "lis3", 2)
    accelerometer.channel("accel_x", 0)
    assert "an accelerometer and no gyroscope" in first_trouble(accelerometer.url).message
    bare = FakeIio(tmp_path, "adis", 3)
    bare.put("in_anglvel_x_raw", "1")
    assert "a gyroscope, but no buffer" in first_trouble(bare.url).message
    assert [one.id for one in source.find(tmp_path, "bmi160")] == ["iio:device0", "iio:device1"]
    assert [one.id for one in source.find(tmp_path, "device2")] == ["iio:device2"]
    assert [one.id for one in source.find(tmp_path, "/dev/iio:device3")] == ["iio:device3"]


@pytest.mark.parametrize(
    ("number", "to_open", "to_start"),
    [
        (errno.EBUSY, "port_busy", "port_busy"),
        (errno.EACCES, "no_permission", "no_permission"),
        (errno.ENODEV, "no_port", "unplugged"),
        (errno.EIO, "open_failed", "open_failed"),
        (errno.EINVAL, "open_failed", "open_failed"),
    ],
)
def test_a_node_that_does_not_open_and_a_buffer_that_does_not_start_leave_all_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, to_open: str, to_start: str
) -> None:
    device = imu(tmp_path)
    before = device.settings()

    def refuse(path: Path, flags: int) -> int:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(buffer.os, "open", refuse)
        assert first_trouble(device.url).kind == to_open
    assert device.settings() == before
    refuse_to_write(monkeypatch, "enable", "1\n", number)
    assert first_trouble(device.url).kind == to_start
    assert device.settings() == before


def refuse_to_write(monkeypatch: pytest.MonkeyPatch, name: str, content: str, number: int) -> None:
    """Make every later attempt to write `content` to a file called `name` fail with the error `number`."""
    write = Path.write_text

    def refuse(path: Path, text: str, encoding: str | None = None) -> int:
        if path.name == name and text == content:
            raise OSError(number, os.strerror(number))
        return write(path, text, encoding=encoding)

    monkeypatch.setattr(Path, "write_text", refuse)


def test_a_rate_that_the_driver_cannot_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = imu(tmp_path)
    refuse_to_write(monkeypatch, "sampling_frequency", "123\n", errno.EINVAL)
    trouble = first_trouble(device.url + "?rate_hz=123")
    assert "cannot sample at 123 Hz, but at: 25 50 100 200 400" in trouble.message


def test_another_rate_than_the_driver_says_is_told(tmp_path: Path) -> None:
    player = Player(imu(tmp_path))
    player.open()
    (trouble,) = [e for e in player.play(scans(0, 500, step_ns=10 * MS)) if isinstance(e, Trouble)]
    assert trouble.kind == "rate_differs"
    assert "the driver says 200 Hz, but samples come at 100 Hz" in trouble.message
    player.close()


def test_silence_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "PATIENCE_NS", 0)
    player = Player(imu(tmp_path))
    player.open()
    *_, trouble = player.until(Trouble)
    assert "its trigger 'bmi160-dev0' does not fire" in trouble.message
    player.source.close()


@pytest.mark.parametrize("rest", ["", "?rate_hz=200", "x?rate_hz=0", "x?rate_hz=a", "x?rate=3"])
def test_urls_that_are_none(rest: str) -> None:
    with pytest.raises(UsageError, match="iio:"):
        IioSource(rest)


@pytest.mark.slow
def test_the_real_command(tmp_path: Path) -> None:
    """With `--once`, the command ends when the device is lost.

    By then, all earlier samples have been published.
    """
    device = imu(tmp_path)

    def play() -> None:
        with device.node.open("wb", buffering=0) as node:
            node.write(scans(0, 1000))

    thread = threading.Thread(target=play, daemon=True)
    thread.start()
    done = fltea("run", "-s", device.url, "--once", "--samples", "--format", "ndjson")
    thread.join()
    assert done.returncode == 1
    records = [json.loads(line) for line in done.stdout.splitlines()]
    samples = [record for record in records if record["class"] == "sample"]
    assert [record["seq"] for record in samples] == list(range(1000))
    assert samples[1]["gyro_dps"] == pytest.approx([49 / 16.3921, -1 / 16.3921, 3 / 16.3921], rel=1e-4)
    assert samples[1]["accel_ms2"] == pytest.approx(
        [100 * 0.000598205, -200 * 0.000598205, 16001 * 0.000598205]
    )

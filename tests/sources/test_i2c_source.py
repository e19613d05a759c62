"""Tests `fltea run --source i2c:…` with the chip model in simulated time: samples, faults and messages."""

import errno
import threading
from itertools import count, pairwise

import pytest
from fltea.records.errors import UsageError
from fltea.records.events import LinkDown, Trouble
from fltea.records.records import Error, Sample
from fltea.sources.i2c import bus as i2c_bus
from fltea.sources.i2c import source as i2c
from fltea.sources.i2c.chips import CHIPS
from fltea.sources.i2c.source import I2cSource, SystemClock
from fltea.sources.i2c.url import parse_url
from fltea.stream.decode import Decoded, Decoder
from fltea.wire import layout as wire
from fltea.wire.layout import SampleFlags
from fltea.wire.permission import Group, User

from tests.rig.fake_smbus import MS, UNIX_OFFSET_NS, FakeHost, Pi, S, taken_ns
from tests.rig.tiers import long
from tools.due_emulator.icm20948 import Icm20948
from tools.due_emulator.mpu9250 import Mpu9250

SETTLED_S = 12.0
"""Time [s] after which the program knows the sensor's clock well enough to count samples exactly."""


@pytest.mark.parametrize(
    ("rest", "path", "address"),
    [
        ("///dev/i2c-1?addr=0x68", "/dev/i2c-1", 0x68),
        ("///dev/i2c-1?addr=0x69&chip=icm20948", "/dev/i2c-1", 0x69),
        ("/dev/i2c-1", "/dev/i2c-1", 0x68),
        ("///dev/i2c-20?addr=105", "/dev/i2c-20", 0x69),
        ("///dev/i2c/by-name/imu?addr=0x69", "/dev/i2c/by-name/imu", 0x69),
    ],
)
def test_the_url(rest: str, path: str, address: int) -> None:
    assert parse_url(rest) == (path, address, "icm20948" if "icm" in rest else "")


@pytest.mark.parametrize(
    ("rest", "reason"),
    [
        ("", "not the path of a bus"),
        ("1", "not the path of a bus"),
        ("//dev/i2c-1", "not the path of a bus"),
        ("///dev/i2c-1?adr=0x68", "no key 'adr'"),
        ("///dev/i2c-1?addr=0x70", "not '0x70'"),
        ("///dev/i2c-1?addr=", "not ''"),
        ("///dev/i2c-1?chip=bmi088", f"{' or '.join(CHIPS)}, not 'bmi088'"),
        ("///dev/i2c-1?addr=0x68&rate_hz=200", "no key 'rate_hz'"),
    ],
)
def test_a_bad_url_is_explained(rest: str, reason: str) -> None:
    with pytest.raises(UsageError, match=reason) as refused:
        I2cSource(rest)
    assert "i2c:///dev/i2c-1?addr=0x68" in str(refused.value) or "chip" in rest


def test_a_quiet_run() -> None:
    pi = Pi(clock_ppm=-4000).run_until(15)
    pi.check(-4000)
    assert pi.missing == []
    assert pi.told == []
    assert pi.epochs == ["start"]
    assert len(pi.raw) == pytest.approx(14.85 * 99.6, abs=4)
    assert pi.source.unix_offset_ns == UNIX_OFFSET_NS
    assert {raw.temperature for raw in pi.raw} == {1335}
    assert {raw.flags for raw in pi.raw} == {0}
    stats = pi.pipeline.stats()
    assert stats.clock_ppm == pytest.approx(-4000, abs=100)
    assert stats.link.frames == len(pi.raw)
    assert stats.link.bytes == 14 * len(pi.raw)
    assert pi.status == i2c.DeviceStatus(0, 0, 0, 0, 0, "software")
    assert len([e for e in pi.events if isinstance(e, i2c.DeviceStatus)]) == pytest.approx(15, abs=1)


def test_the_date_changes_only_with_an_event(monkeypatch: pytest.MonkeyPatch) -> None:
    """The offset to Unix time changes only with an event of the source. Between two events it stays the same.

    The recorder and the pipeline each read this offset, and a replay of the recording has to give the live
    result.
    """
    pi = Pi()
    monkeypatch.setattr(pi.host, "unix_offset_ns", count(UNIX_OFFSET_NS).__next__)
    events, seen = pi.source.events(), set()
    for _ in range(50):
        next(events)
        offset_ns = pi.source.unix_offset_ns
        assert pi.source.unix_offset_ns == offset_ns
        seen.add(offset_ns)
    assert len(seen) == 50


def test_what_hello_says() -> None:
    pi, other = (Pi(url=url, address=address).run_until(1) for url, address in
                 [("///dev/i2c-1", 0x68), ("///dev/i2c-1?addr=0x69", 0x69)])  # fmt: skip
    hello = pi.hello
    assert hello.source == "i2c:/dev/i2c-1?addr=0x68"
    assert (hello.rate_hz, hello.sampling_mode, hello.sensor_starts) == (100.0, "fifo", 1)
    assert (hello.who_am_i, hello.sensor, hello.gyro_dlpf_hz) == (0x71, "MPU-9250", 184.0)
    assert (hello.gyro_range_dps, hello.gyro_lsb_per_dps) == (2000.0, 16.4)
    assert (hello.accel_range_g, hello.accel_lsb_per_g) == (2.0, 16384.0)
    assert len(bytes.fromhex(hello.device_id)) == 16
    assert hello.device_id == Pi().run_until(1).hello.device_id
    assert hello.device_id != other.hello.device_id
    assert hello.boot_id != other.hello.boot_id
    # a recording stores the firmware version as a text of at most 24 bytes
    assert len(hello.firmware_version.encode("ascii")) <= 24
    assert wire.SamplingMode[hello.sampling_mode.upper()]
    assert wire.ResetCause[pi.status.reset_cause.upper()]


def test_samples_come_soon() -> None:
    pi = Pi().run_until(5)
    late_ms = [(pi.host.now_ns - taken_ns(raw.gyro, raw.accel)) / MS for raw in pi.raw[-3:]]
    assert max(late_ms) < 45
    # `host_ns` is computed from the sensor's clock. It is never before the time of the sample's measurement,
    # and at most little more than a period later.
    waits_ms = [(raw.host_ns - taken_ns(raw.gyro, raw.accel)) / MS for raw in pi.raw]
    assert 0 <= min(waits_ms) < 1
    assert max(waits_ms) < 13


@pytest.mark.slow
@pytest.mark.parametrize(("ppm", "until_s"), [long(9_000.0, 1_400), (-7_300.0, 300)])
def test_a_long_time(ppm: float, until_s: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """To save time, the FIFO is read less often than usual. The longer run has more than 2^17 samples."""
    monkeypatch.setattr(i2c, "POLL_S", (0.15, 0.2))
    pi = Pi(clock_ppm=ppm)
    decoder = Decoder(lambda: 0, 100)
    worst_ns = 0
    for event in pi.source.events():
        for found in decoder.feed(event):
            if not isinstance(found, Decoded):
                continue
            assert found.missing == 0
            numbers, times_ns = found.block.seq.tolist(), found.block.host_ns.tolist()
            for k, one, host_ns in zip(numbers, found.raw.samples(), times_ns, strict=True):
                if k > 6000:
                    worst_ns = max(worst_ns, abs(host_ns - taken_ns(one.gyro, one.accel)))
        if pi.host.now_ns > until_s * S:
            break
    counts, clock = decoder.counts, decoder.native
    assert (counts.lost, counts.duplicates) == (0, 0)
    assert counts.delivered == pytest.approx((until_s - 0.15) * 100 * (1 + ppm * 1e-6), abs=30)
    assert clock.clock_ppm == pytest.approx(ppm, abs=20)
    assert clock.rate_hz == pytest.approx(100 * (1 + ppm * 1e-6), rel=2e-5)
    assert worst_ns < 4 * MS


def test_sequence_and_device_time_wrap() -> None:
    pi = Pi()
    # The next sample gets this number. Its time is 4294.9 s, shortly before the time wraps at 2^32 us
    # (4294.967 s). Modulo 2^16, the number is 36,274.
    pi.source._reader._clock.next = 429_490
    pi.run_until(1)
    assert max(raw.device_us for raw in pi.raw) == 429_496 * 10_000
    assert pi.raw[-1].device_us < S // 1000
    assert pi.of(Sample)[-1].device_us == pi.of(Sample)[-1].seq * 10_000 + (429_490 - 36_274) * 10_000
    pi.check()


@pytest.mark.parametrize("what", ["unplugged", "browned_out", "exchanged", "another kind browned_out"])
def test_a_sensor_that_lost_its_supply_is_set_up_again(what: str) -> None:
    pi = Pi(model=Icm20948 if "another kind" in what else Mpu9250)
    match what.removeprefix("another kind "):
        case "unplugged":
            pi.at(SETTLED_S, pi.chip.power_off).at(SETTLED_S + 1.5, pi.chip.power_on)
        case "browned_out":
            pi.at(SETTLED_S, pi.chip.brown_out)
        case "exchanged":
            pi.at(SETTLED_S, pi.chip.power_off).at(SETTLED_S + 0.05, lambda: pi.chip.power_on(0x75))
    pi.run_until(SETTLED_S + 4).check()
    assert pi.epochs == ["start", "sensor_restart"]
    assert pi.hello.sensor_starts == 2
    assert pi.status.sensor_reinits == 1
    assert ("clone" in pi.hello.sensor) == (what == "exchanged")
    away_s = 1.5 if what == "unplugged" else 0.2
    assert sum(pi.missing) == pytest.approx(100 * (away_s + 0.2), abs=25)
    assert "device_fault" in pi.told or what == "exchanged"
    last_before = [sample for sample in pi.of(Sample) if sample.epoch == 1][-1]
    assert taken_ns(pi.raw[last_before.seq].gyro, pi.raw[last_before.seq].accel) < SETTLED_S * S


def test_a_sensor_that_falls_asleep_is_set_up_again() -> None:
    pi = Pi()
    pi.at(3, lambda: pi.chip.write_register(0x6B, 0x41))
    pi.run_until(5).check()
    assert pi.epochs == ["start", "sensor_restart"]
    assert "gives no new samples" in pi.texts


def test_values_that_stand_still_are_not_believed() -> None:
    from tools.due_emulator.noise import Constant

    pi = Pi(Constant()).run_until(3)
    assert "sensor_frozen" in pi.texts
    assert max(len([s for s in pi.of(Sample) if s.epoch == epoch]) for epoch in range(1, 5)) < 10
    assert pi.raw[1].flags == SampleFlags.REPEATED


def test_the_end_of_the_range_is_flagged() -> None:
    from tools.due_emulator.noise import Stepped

    class Beyond(Stepped):
        def next_rate(self, k: int) -> tuple[float, float, float]:
            return (2100.0, 0.0, 0.0) if k % 2 else (0.0, 0.0, 0.0)

    pi = Pi(Beyond(100.0, 1)).run_until(1)
    assert {raw.flags & SampleFlags.SATURATED for raw in pi.raw if raw.gyro[0] == 32767} == {
        SampleFlags.SATURATED
    }
    assert {raw.flags for raw in pi.raw if raw.gyro[0] == 0} == {0}


def test_a_clone_is_told_once_and_used() -> None:
    pi = Pi(who_am_i=0x75)
    pi.at(2, pi.chip.brown_out)
    pi.run_until(5).check()
    assert pi.told.count("sensor_relative") == 1
    assert pi.hello.sensor == "MPU-9250 clone (0x75)"


def test_an_unknown_chip_is_named_and_waited_out() -> None:
    pi = Pi(who_am_i=0x12)
    pi.run_until(5)
    assert (pi.told, pi.raw) == (["device_fault"], [])
    assert "WHO_AM_I is 0x12" in pi.texts
    pi.chip.power_off()
    pi.chip.power_on(0x71)
    pi.run_until(8).check()
    assert pi.hello.sensor == "MPU-9250"


def test_no_sensor_is_explained_and_waited_for() -> None:
    pi = Pi()
    pi.chip.power_off()
    pi.at(130, pi.chip.power_on)
    pi.run_until(133).check()
    assert pi.told == ["device_fault"] * 3  # the fault is reported immediately, and again after each minute
    text = pi.of(Error)[0].message
    assert "no sensor answers at I²C address 0x68 on /dev/i2c-1" in text
    for word in ["pin 1 (3.3 V)", "pin 6", "pin 3", "pin 5", "AD0", "0x69", "'i2cdetect -y 1'"]:
        assert word in text
    assert all(e.fatal for e in pi.events if isinstance(e, Trouble))


def test_a_sensor_that_powers_up_with_the_machine_is_no_trouble() -> None:
    pi = Pi()
    pi.chip.power_off()
    pi.at(0.02, pi.chip.power_on)
    pi.run_until(2)
    assert pi.told == []
    assert pi.raw


class Buses:
    """Opens buses in place of the system. Each opening gives a bus, or raises the next given error."""

    def __init__(self, pi: Pi, *errors: OSError) -> None:
        self.left = list(errors)
        self.pi = pi
        pi.source._open_bus = self.open

    def open(self, path: str, address: int):
        if self.left:
            raise self.left.pop(0)
        return self.pi.bus.open(path, address)


@pytest.mark.parametrize(
    ("number", "kind", "words"),
    [
        (errno.ENOENT, "no_port", ["raspi-config nonint do_i2c 0", "dtparam=i2c_arm=on", "Buses that exist"]),
        (errno.EACCES, "no_permission", ["sudo usermod -aG i2c anna"]),
        (errno.EPERM, "no_permission", ["its group is 'root'", 'GROUP="i2c"']),
        (errno.EAGAIN, "port_busy", ["another fltea", "0x68", "fltea devices"]),
        (errno.ENOTTY, "open_failed", ["no I²C bus"]),
        (errno.EMFILE, "open_failed", ["cannot open /dev/i2c-1"]),
    ],
)
def test_a_bus_that_cannot_be_opened(
    number: int, kind: str, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fltea.sources.i2c.bus.glob.glob", lambda pattern: ["/dev/i2c-0"])
    group = Group(0, "root", False) if number == errno.EPERM else Group(998, "i2c", True)
    monkeypatch.setattr(i2c_bus, "group_of", lambda path: group)
    monkeypatch.setattr(i2c_bus, "this_user", lambda: User("anna", set(), set()))
    pi = Pi()
    Buses(pi, *[OSError(number, "as the kernel says it")] * 3)
    pi.run_until(4)
    assert pi.told == [kind]
    assert all(word in pi.texts for word in words), pi.texts
    assert pi.source.link_stats().reconnects == 0
    pi.check()


def test_a_bus_that_goes_away_and_comes_back() -> None:
    pi = Pi().run_until(SETTLED_S)
    pi.bus.inject = lambda messages: errno.ENODEV
    Buses(pi, *[FileNotFoundError(errno.ENOENT, "No such file or directory")] * 2)
    pi.host.at(round((SETTLED_S + 0.05) * S), lambda: setattr(pi.bus, "inject", lambda messages: None))
    pi.run_until(SETTLED_S + 5).check()
    assert pi.told == ["unplugged", "no_port"]
    assert any(isinstance(event, LinkDown) for event in pi.events)
    assert pi.epochs == ["start", "sensor_restart"]
    assert pi.status.bus_recoveries == pi.source.link_stats().reconnects == 1
    assert pi.pipeline.stats().sample_counts.before_hello == 0


def test_closing_releases_the_bus() -> None:
    pi = Pi().run_until(1)
    assert pi.bus.is_open
    pi.source.close()
    assert len(pi.run_until(2).events) > 0
    assert not pi.bus.is_open
    assert pi.host.now_ns < 1.1 * S


@pytest.mark.parametrize("number", [errno.EREMOTEIO, errno.ENODEV])
def test_close_from_another_thread_ends_any_wait(number: int) -> None:
    """`close` from another thread ends any wait. This test runs on the real clock, and closes the source
    during its longest waits.
    """

    class DeadBus:
        def i2c_rdwr(self, *messages: object) -> None:
            raise OSError(number, "gone")

        def close(self) -> None:
            pass

    source = I2cSource("/dev/i2c-1", open_bus=lambda path, address: DeadBus(), host=SystemClock())
    told = threading.Event()

    def run() -> None:
        for event in source.events():
            if isinstance(event, Trouble):
                told.set()

    thread = threading.Thread(target=run)
    thread.start()
    assert told.wait(30)
    source.close()
    source.close()
    thread.join(30)
    assert not thread.is_alive()


def test_statistics_go_out_while_there_is_no_bus() -> None:
    pi = Pi()
    Buses(pi, *[FileNotFoundError(errno.ENOENT, "No such file or directory")] * 100)
    pi.run_until(20)
    ticks = [event.host_ns for event in pi.events if isinstance(event, i2c.Tick)]
    assert max(b - a for a, b in pairwise(ticks)) < S


@pytest.mark.parametrize(
    ("path", "kind", "words"),
    [
        ("/dev/i2c-that-is-not-there", "no_port", "there is no I²C bus /dev/i2c-that-is-not-there"),
        ("/dev/null", "open_failed", "/dev/null is no I²C bus"),
    ],
)
def test_a_path_that_is_no_real_bus_is_told_by_its_errno(path: str, kind: str, words: str) -> None:
    source = I2cSource(path, host=FakeHost())
    trouble = next(event for event in source.events() if isinstance(event, Trouble))
    assert (trouble.kind, words in trouble.message) == (kind, True)
    source.close()


def test_two_readers_of_one_sensor_are_kept_apart(tmp_path) -> None:
    from fltea.sources.i2c.bus import take

    path = tmp_path / "bus"
    path.touch()
    with path.open("r+b") as first, path.open("r+b") as second, path.open("r+b") as third:
        take(first.fileno(), 0x68)
        take(second.fileno(), 0x69)
        with pytest.raises(OSError, match=r".") as refused:
            take(third.fileno(), 0x68)
        assert refused.value.errno in (errno.EAGAIN, errno.EACCES)
        first.close()
        take(third.fileno(), 0x68)

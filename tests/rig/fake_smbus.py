"""Simulate a Raspberry Pi with an emulated chip on its I²C bus, in virtual time.

The bus has the interface of `smbus2`, and takes real `smbus2.i2c_msg` objects. A transfer takes as long as at
400 kHz. If a message follows a read, the bus fails with EOPNOTSUPP, as the Linux driver of the Raspberry Pi 1
to 4 does (i2c-bcm2835).
"""

import ctypes
import errno
from collections.abc import Callable, Iterator

from fltea.records.events import Event, RawSample
from fltea.records.records import AnyRecord, Epoch, Error, Gap, Hello, Sample
from fltea.settings.config import load_config
from fltea.sources.i2c.source import I2cSource
from fltea.stream.pipeline import Pipeline
from smbus2 import i2c_msg

from tests.rig.blocks import in_samples, records_of, samples_of
from tools.due_emulator.chip import Chip
from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.noise import Motion, World

S = 1_000_000_000
MS = 1_000_000
UNIX_OFFSET_NS = 1_700_000_000 * S
READ = 1
"""Linux's flag I2C_M_RD."""
SYSTEM_CALL_NS = 50_000
LONGEST_MESSAGE = 255
"""Longest message that some I²C adapters accept [bytes]; the adapters of the Raspberry Pi accept longer
messages.
"""
TICK_NS = 100_000
WRAP = 16_384
NO_ESTIMATES = {"samples": True, "estimator.startup": 1_000_000, "live.on": False}
Injection = Callable[[tuple[i2c_msg, ...]], int | None]


class TellsTime:
    """Surroundings of the emulated sensor, whose values encode the time at which they are measured.

    The values also show whether all values of a sample were measured at one time.
    """

    def at(self, now_ns: int) -> Motion:
        n = now_ns // TICK_NS
        low, high = n % WRAP, n // WRAP % WRAP
        rate = (low / 16.4, high / 16.4, (low ^ high) / 16.4)
        return Motion(rate, (low / WRAP, high / WRAP, (low ^ high) / WRAP), 25.0)


def taken_ns(gyro: tuple[float, ...], accel: tuple[float, ...] | None) -> int:
    """Return the time at which a sample of `TellsTime` was measured [ns], in steps of 0.1 ms.

    A sample whose values were measured at different times raises an error.
    """
    low, high, check = (round(value) for value in gyro)
    assert low ^ high == check, f"a torn sample: {gyro}"
    assert accel == (low, high, check), f"a torn sample: {gyro}, {accel}"
    return (high * WRAP + low) * TICK_NS


class FakeHost:
    """The simulated machine: its clock advances with every use, and `stall` makes the program wait.

    `at(ns, do)`: call `do` once when that time is reached.
    """

    def __init__(self, start_ns: int = 0) -> None:
        self.now_ns = start_ns
        self._due: list[tuple[int, Callable[[], None]]] = []

    def host_ns(self) -> int:
        self.let_pass(1_000)
        return self.now_ns

    def unix_offset_ns(self) -> int:
        return UNIX_OFFSET_NS

    def sleep(self, seconds: float) -> None:
        self.let_pass(round(seconds * 1e9) + 60_000)  # a sleeping process always wakes somewhat late

    def at(self, at_ns: int, do: Callable[[], None]) -> None:
        self._due.append((at_ns, do))
        self._due.sort(key=lambda due: due[0])

    def stall(self, at_ns: int, for_ns: int) -> None:
        self.at(at_ns, lambda: self.let_pass(for_ns))

    def let_pass(self, ns: int) -> None:
        self.now_ns += ns
        while self._due and self._due[0][0] <= self.now_ns:
            self._due.pop(0)[1]()


class FakeBus:
    """An `smbus2.SMBus` with one chip.

    `inject`: called before each transaction; returns the errno with which the transaction fails, or None.
    """

    def __init__(self, host: FakeHost, chip: Chip, baud: int = 400_000) -> None:
        self.host = host
        self.chip = chip
        self.inject: Injection = lambda messages: None
        self.spoil: Callable[[int, bytes], bytes] = lambda register, data: data
        self.broken_at = 0.5
        self.is_open = False
        self.busy_ns = self.transactions = 0
        self._bit_ns = S // baud
        self._passed_ns = self._register = 0

    def open(self, path: str, address: int) -> "FakeBus":
        self.is_open = True
        return self

    def close(self) -> None:
        self.is_open = False

    def i2c_rdwr(self, *messages: i2c_msg) -> None:
        assert self.is_open
        if any(m.flags & READ for m in messages[:-1]):
            raise OSError(errno.EOPNOTSUPP, "only one read message supported, has to be last")
        if any(len(m) > LONGEST_MESSAGE for m in messages):
            raise OSError(errno.EOPNOTSUPP, "message too long")
        self.transactions += 1
        self._passed_ns = 0
        error = self.inject(messages)
        try:
            for message in messages:
                self._run(message, error)
        finally:
            self.chip.stop()
            self.busy_ns += self._passed_ns
            self.host.let_pass(self._passed_ns + SYSTEM_CALL_NS)

    def _run(self, message: i2c_msg, error: int | None) -> None:
        self._pass(1)
        reads = bool(message.flags & READ)
        if error in (errno.EREMOTEIO, errno.ENXIO) or not self.chip.start(message.addr, reads):
            raise OSError(error or errno.EREMOTEIO, "Remote I/O error")
        if not reads:
            data = bytes(message)
            self._register = data[0]
            for byte in data:
                self._pass(1)
                if not self.chip.write(byte):
                    raise OSError(errno.EREMOTEIO, "Remote I/O error")
            if error is not None and len(data) > 1:
                raise OSError(error, "Input/output error")
            return
        n = len(message)
        stop = n if error is None else int(n * self.broken_at)
        data = b""
        while len(data) < stop:
            part = min(14, stop - len(data))
            data += self._read(part, last=len(data) + part == n)
            self._pass(part)
        if error is not None:
            raise OSError(error, "Input/output error")
        data = self.spoil(self._register, data)
        ctypes.memmove(message.buf, data, n)

    def _read(self, n: int, *, last: bool) -> bytes:
        # The FIFO's bytes are taken directly. The chip's `read` would give the same bytes, but slowly.
        if self._register == self.chip.fifo_register:
            return bytes(self.chip.fifo.pop() for _ in range(n))
        return bytes(self.chip.read(ack=not last or i < n - 1) for i in range(n))

    def _pass(self, n: int) -> None:
        self._passed_ns += 9 * n * self._bit_ns
        self.chip.advance(self.host.now_ns + self._passed_ns)


class Pi:
    """`fltea run --source i2c:…` on the simulated machine, with all its events and records."""

    def __init__(
        self,
        world: World | None = None,
        *,
        url: str = "///dev/i2c-1?addr=0x68",
        start_ns: int = 0,
        overrides: dict[str, object] | None = None,
        model: Callable[..., Chip] = Mpu9250,
        **chip: object,
    ) -> None:
        self.host = FakeHost(start_ns)
        self.chip = model(world or TellsTime(), **chip)
        self.bus = FakeBus(self.host, self.chip)
        self.source = I2cSource(url, open_bus=self.bus.open, host=self.host)
        self.pipeline = Pipeline(self.source, load_config(None, overrides or NO_ESTIMATES))
        self.events: list[Event] = []
        self.records: list[AnyRecord] = []
        self._heard = 0
        self._running: Iterator[Event] = self.source.events()

    def at(self, at_s: float, do: Callable[[], None]) -> "Pi":
        """Call `do` at the time `at_s` of the chip's clock [s]."""

        def do_now() -> None:
            self.chip.advance(self.host.now_ns)
            do()

        self.host.at(round(at_s * S), do_now)
        return self

    def run_until(self, at_s: float) -> "Pi":
        """Run until the time `at_s` [s], then continue to the last sample of the burst that is being read."""
        for event in self._running:
            self.events += in_samples([event])
            self.records += records_of(self.pipeline.feed(event))
            self._heard += len(samples_of([event]))
            if self.host.now_ns >= at_s * S and self._heard == self.source.link_stats().frames:
                break
            assert self.host.now_ns < (at_s + 100) * S, "samples that were counted as delivered never came"
        return self

    def of(self, kind: type) -> list:
        return [record for record in self.records if isinstance(record, kind)]

    @property
    def raw(self) -> list[RawSample]:
        return [event for event in self.events if isinstance(event, RawSample)]

    @property
    def epochs(self) -> list[str]:
        return [epoch.reason for epoch in self.of(Epoch)]

    @property
    def missing(self) -> list[int]:
        """Return the length of each gap [samples]."""
        return [gap.missing for gap in self.of(Gap)]

    @property
    def told(self) -> list[str]:
        return [error.kind for error in self.of(Error)]

    @property
    def texts(self) -> str:
        return "\n".join(error.message for error in self.of(Error))

    @property
    def hello(self) -> Hello:
        return self.of(Hello)[-1]

    @property
    def status(self):
        """Return the present status, which may be newer than the last status sent."""
        return self.source._status()

    def check(self, ppm: float = 0.0) -> list[int]:
        """Check the number and time of every sample by the time of measurement that its values encode.

        Return the sample times of the last epoch [ns]. Within an epoch (a run without a restart), numbers and
        times have to agree to the sample. No sample may arrive before it is measured. Every sample that is
        not delivered has to be counted.
        """
        period_ns = S / self.hello.rate_hz / (1 + ppm * 1e-6)
        epoch, first, arrived_ns = -1, (0, 0), 0
        times: list[int] = []
        samples = self.of(Sample)
        assert len(samples) == len(self.raw)
        for sample, raw in zip(samples, self.raw, strict=True):
            at_ns = taken_ns(raw.gyro, raw.accel)
            if sample.epoch != epoch:
                epoch, first, times = sample.epoch, (sample.seq, at_ns), []
            steps = (at_ns - first[1]) / period_ns
            assert abs(steps - (sample.seq - first[0])) < 0.05, f"number {sample.seq} is wrong by {steps}"
            assert raw.host_ns >= at_ns, f"sample {sample.seq} arrived before it was taken"
            assert raw.host_ns >= arrived_ns, f"sample {sample.seq} arrived before the one before"
            arrived_ns = raw.host_ns
            times.append(at_ns)
        counts = self.pipeline.stats().sample_counts
        assert counts.duplicates == counts.before_hello == 0
        assert counts.delivered == len(samples)
        assert counts.delivered + counts.lost == samples[-1].seq - samples[0].seq + 1
        assert counts.lost == self.status.overruns
        return times

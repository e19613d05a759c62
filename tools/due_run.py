"""Run the emulated Due with the host's modules, and compare what happened with what the host reports.

The bytes pass through the modules of `fltea run` like bytes from a serial port: framing, messages, the serial
source, the sequence tracker and the pipeline. The sensor's bus and the board's resets are recorded too, so
that the host's counts can be checked against what really happened.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from fltea.records.block import Block
from fltea.records.events import Chunk, Opened
from fltea.records.records import AnyRecord, Epoch, Error, Gap, Hello, Sample, Stats
from fltea.settings.config import load_config
from fltea.stream.pipeline import Pipeline
from fltea.wire import layout as wire
from fltea.wire.messages import Frame

from tools.due_emulator.board import Board
from tools.due_emulator.faults import parse_fault, schedule_faults
from tools.due_emulator.host_view import HostView
from tools.due_emulator.instants import PERIOD_PS, Burst
from tools.due_emulator.machine import PS_PER_S, EmulationFault
from tools.due_emulator.noise import World, fractional_world
from tools.fed_source import FedSource

M = TypeVar("M")

DATA_BYTES = 14
QUIET_PS = PERIOD_PS * 8 // 10
"""Time after a sampling instant [ps] by which all bytes that it caused have reached the host."""
NEAR_PS = PS_PER_S // 1000
NO_ESTIMATES = {"estimator.startup": 1_000_000, "live.on": False}


class Arrival(NamedTuple):
    """A valid frame with the virtual time at which its last byte reached the host."""

    frame: Frame
    at_ps: int

    @property
    def at_s(self) -> float:
        """Virtual time of the arrival [s]."""
        return self.at_ps / PS_PER_S


class DueRun(HostView):
    """An emulated board that is connected to the host's modules. `run_until` may be called repeatedly.

    `faults`: texts of faults, as on the command line of tools.due_emulator. `baud`: the host's baud rate.
    `settings`: the host's settings by dotted path; by default, the host computes no estimates.
    """

    def __init__(
        self,
        image: bytes,
        *,
        seed: int = 1,
        noise: str = "",
        faults: Sequence[str] = (),
        world: World | None = None,
        baud: float = wire.BAUD,
        strict_baud: bool = True,
        settings: Mapping[str, Any] = NO_ESTIMATES,
    ) -> None:
        board = Board(image, seed=seed, world=world or fractional_world(noise))
        board.bridge.deliver = self.take
        board.bridge.host_baud = baud
        board.bridge.strict_baud = strict_baud
        super().__init__(board)
        self.wire = bytearray()
        self.arrivals: list[Arrival] = []
        self.records: list[AnyRecord] = []
        self.error: str | None = None
        self._source = FedSource("the emulated Due")
        self._pipeline = Pipeline(self._source, load_config(None, settings))
        self._feed(Opened(0))
        schedule_faults(self.board, [parse_fault(text) for text in faults])

    def run_until(self, at_s: float) -> "DueRun":
        """Run until `at_s`, and then on to a time at which no bytes of a sample are on the way to the host.

        If the run ended early, `error` says why.
        """
        try:
            self.board.run_until(at_s)
            if (first_ps := self.boots[-1].first_ps) is not None:
                phase_ps = (self.now_ps - first_ps) % PERIOD_PS
                self.board.run_until(at_s + (QUIET_PS - phase_ps) % PERIOD_PS / PS_PER_S)
        except EmulationFault as fault:
            self.error = fault.reason
        self.stop()
        return self

    # Methods that return what the host received and reported

    def messages(self, kind: type[M]) -> list[M]:
        """Return the valid messages of one kind that arrived."""
        found = (arrival.frame.message for arrival in self.arrivals)
        return [message for message in found if isinstance(message, kind)]

    def of(self, kind: type) -> list[Arrival]:
        """Return the valid frames with messages of one kind."""
        return [arrival for arrival in self.arrivals if isinstance(arrival.frame.message, kind)]

    @property
    def samples(self) -> list[Sample]:
        """Samples that the pipeline delivered."""
        return [record for record in self.records if isinstance(record, Sample)]

    @property
    def epochs(self) -> list[str]:
        """The reason why each epoch began."""
        return [record.reason for record in self.records if isinstance(record, Epoch)]

    @property
    def gaps(self) -> list[int]:
        """Length of each gap, as a number of samples."""
        return [record.missing for record in self.records if isinstance(record, Gap)]

    @property
    def troubles(self) -> list[str]:
        """Kinds of the errors that the host reported."""
        return [record.kind for record in self.records if isinstance(record, Error)]

    @property
    def hellos(self) -> list[Hello]:
        """The HELLOs that the host reported.

        The host reports a HELLO only if it differs from the HELLO before it.
        """
        return [record for record in self.records if isinstance(record, Hello)]

    @property
    def status(self) -> wire.Status:
        """The last STATUS message."""
        return self.told.statuses[-1]

    @property
    def faults(self) -> list[tuple[str, int]]:
        """The FAULT messages: for each, the name of its fault code, and its detail."""
        return self.told.faults

    @property
    def stats(self) -> Stats:
        """The host's own counts of bytes, frames and samples."""
        return self._pipeline.stats()

    # Methods that compare board and host

    def unheard(self) -> list[int]:
        """Return how many sampling instants followed the last sample that the host received, in each boot.

        Boots that did not read the sensor are left out.
        """
        return [boot.due - (boot.heard[1] + 1 if boot.heard else 0) for boot in self.boots if boot.bursts]

    def check(self) -> str | None:
        """Return a text about the first contradiction between board and host; None if there is none.

        The sample of each sampling instant must be delivered or counted as lost, or it is one of the last
        samples before a reset, which the board could not send any more (`unheard`). All values must be those
        that the sensor gave.
        """
        samples = self.stats.sample_counts
        unheard = self.unheard()
        if self.error:
            return f"ended early: {self.error}"
        if samples.duplicates or samples.before_hello:
            return f"{samples.duplicates} duplicates, {samples.before_hello} samples without HELLO"
        if not unheard or unheard[-1]:
            return f"unheard at the end of each boot: {unheard}; there should be none at the end of the run"
        due = sum(boot.due for boot in self.boots)
        if samples.delivered + samples.lost + sum(unheard) != due:
            parts = f"{samples.delivered} delivered + {samples.lost} lost + {unheard} unheard"
            return f"{parts} are not the {due} that were due"
        return self.check_values()

    def check_values(self) -> str | None:
        """Return a text about the first sample that differs from what the sensor gave at the sample's time.

        None if no sample differs.
        """
        zero_ps, boot_id = 0, None
        bursts = [burst for boot in self.boots for burst in boot.bursts if len(burst.data) >= DATA_BYTES]
        i = 0
        for frame, at_ps in self.arrivals:
            match frame.message:
                case wire.Hello() as hello if hello.boot_id != boot_id:
                    boot_id, zero_ps = hello.boot_id, 0
                case wire.Sample() as sample:
                    if not zero_ps:
                        last = [burst.at_ps for burst in bursts if burst.at_ps < at_ps][-1:] or [at_ps]
                        zero_ps = last[0] - frame.device_us * 1_000_000
                    time_ps = zero_ps + frame.device_us * 1_000_000
                    while i < len(bursts) and bursts[i].at_ps < time_ps - NEAR_PS // 2:
                        i += 1
                    if i == len(bursts) or bursts[i].at_ps > time_ps + NEAR_PS:
                        return f"SAMPLE {frame.sequence}: the sensor was not read at {frame.device_us} us"
                    if bytes(bursts[i].data) != chip_bytes(sample):
                        return f"SAMPLE {frame.sequence} is {sample}, the sensor gave {bursts[i].data.hex()}"
        return None

    # Functions that the emulated board calls

    def on_data(self, data: bytes) -> None:
        """Store the bytes, and pass them to the modules of `fltea run`."""
        super().on_data(data)
        self.wire += data
        self._feed(Chunk(data, self.now_ps // 1000))

    def on_frame(self, frame: Frame) -> None:
        super().on_frame(frame)
        self.arrivals.append(Arrival(frame, self.now_ps))

    def on_burst(self, burst: Burst) -> None:
        """Store a read of the sensor. The stored object collects the bytes that the sensor then sends."""
        super().on_burst(burst)
        self.boots[-1].bursts.append(burst)

    def _feed(self, item: Opened | Chunk) -> None:
        for event in self._source.wire.feed(item, item.host_ns):
            for found in self._pipeline.feed(event):
                self.records += found.records() if isinstance(found, Block) else [found]


def chip_bytes(sample: wire.Sample) -> bytes:
    """Return a sample's bytes as the sensor's registers 59 to 72 contain them."""
    s = sample
    counts = (s.accel_x, s.accel_y, s.accel_z, s.temperature, s.gyro_x, s.gyro_y, s.gyro_z)
    return b"".join(count.to_bytes(2, "big", signed=True) for count in counts)

"""Simulate some seconds of a board with incidents: the bytes that it sends, and their arrival times."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from fltea.records.events import Event, LinkDown, Opened, Reads
from fltea.wire import layout as wire
from hypothesis import strategies as st

from tests.rig.estimating_board import noise
from tools.fed_source import FedSource
from tools.made_up_board import STATUS, MadeUpBoard, frames

PERIOD_NS = 10**7
SECOND_NS = 10**9
OFFSET_NS = 1_720_000_000_000_000_000

HAPPENINGS = (
    "hello",  # the board sends HELLO again
    "status",
    "fault",
    "bad",  # one bit of a sample is wrong
    "rubbish",  # bytes that form no frame
    "twice",  # a sample is sent twice
    "gap",
    "long gap",
    "pause",  # nothing arrives for six seconds
    "jump",  # the device's time jumps, as after a reset whose HELLO was lost
    "restart",
    "sensor",  # the board sets its sensor up again
    "other version",
    "clock set",  # the host's date is set to another time
    "opened",  # the port was lost for a moment
    "constant",  # from here on the sensor repeats the same values
    "knock",  # the board is moved
)


class Moment(NamedTuple):
    """Bytes that arrived together.

    `data`: None means that the port was opened again.
    """

    data: bytes | None
    host_ns: int
    offset_ns: int


class Story(NamedTuple):
    """Some simulated seconds of a board, with incidents.

    `begin_ns`: host time at the beginning [ns]. `happenings`: pairs of a sample's number and the incident at
    this sample. `bursts`: how many samples' bytes arrive together; after the last number, the first one is
    used again.
    """

    begin_ns: int
    samples: int
    happenings: tuple[tuple[int, str], ...]
    bursts: tuple[int, ...]

    def moments(self) -> list[Moment]:
        """Return the bytes that arrive, with their arrival times. The bytes of several samples may arrive
        together (`bursts`).

        The end of a frame may arrive later than its beginning.
        """
        board, found, waiting, held = _Board(), [], b"", 0
        told = dict(self.happenings)
        host_ns, offset_ns, k = self.begin_ns, OFFSET_NS, 0
        for k in range(self.samples):
            what = told.get(k, "")
            host_ns += PERIOD_NS
            if what in ("opened", "clock set", "pause"):
                if waiting:
                    found.append(Moment(waiting, host_ns, offset_ns))
                    waiting, held = b"", 0
                host_ns += 6 * SECOND_NS * (what == "pause") + 1
                offset_ns += 3600 * SECOND_NS * (what == "clock set")
                if what == "opened":
                    found.append(Moment(None, host_ns, offset_ns))
            waiting += board.says(k, what, host_ns)
            burst = self.bursts[k % len(self.bursts)]
            held += 1
            if held >= burst:
                torn = len(waiting) - k * 7 % 30 if burst % 2 else len(waiting)
                if torn > 0:
                    found.append(Moment(waiting[:torn], host_ns, offset_ns))
                    waiting, held = waiting[torn:], 0
        return [*found, Moment(waiting, host_ns + 1, offset_ns)] if waiting else found


class _Board:
    """Makes the bytes of successive sampling periods."""

    def __init__(self) -> None:
        self._board = MadeUpBoard()
        self._board.restart(first=65_400, device_us=5_000_000)
        self._rows = noise(4096)
        self._before_ns = 0
        self._constant = self._knocked = False

    def says(self, k: int, what: str, host_ns: int) -> bytes:
        board = self._board
        if self._before_ns:
            board.instant += round((host_ns - self._before_ns) / PERIOD_NS) - 1
        self._before_ns = host_ns
        said = board.booted() if k == 0 else b""
        match what:
            case "hello" | "opened":
                said += self._states()
            case "status":
                said += board.says(STATUS._replace(i2c_errors=1, dropped_frames=k % 256)).frame
            case "fault":
                said += board.says(wire.Fault(wire.FaultCode.SENSOR_LOST, 0x10)).frame
            case "rubbish":
                said += bytes(k * j % 256 for j in range(k % 90))
            case "gap":
                board.instant += 3
            case "long gap":
                board.instant += 90
            case "jump":
                board.jump(7_000_000)
            case "restart":
                board.restart(boot_id=board.hello.boot_id + 1)
                said += self._states()
            case "sensor":
                board.hello = board.hello._replace(sensor_starts=board.hello.sensor_starts + 1)
                said += self._states()
            case "other version":
                said += board.says(board.hello._replace(protocol_major=wire.PROTOCOL_MAJOR + 1)).frame
            case "constant":
                self._constant = True
            case "knock":
                self._knocked = True
        gyro = (3, -40, 0) if self._constant else self._rows[k]
        if self._knocked:
            gyro = tuple(50 * counts for counts in gyro)
        *others, sample = board.tick(gyro, (k % 7, -3, 16_384))
        frame = sample.frame
        if what == "bad":
            frame = bytes([frame[0], frame[1], frame[2] ^ 1, *frame[3:]])
        return said + frames(others) + frame * (2 if what == "twice" else 1)

    def _states(self) -> bytes:
        return frames(self._board.states())


def stories() -> st.SearchStrategy[Story]:
    """Draw stories: what a simulated board sends in two to five seconds, with incidents. In some, nothing
    arrives for six more seconds.
    """
    happening = st.tuples(st.integers(1, 499), st.sampled_from(HAPPENINGS))
    return st.builds(
        Story,
        st.integers(0, 3 * SECOND_NS),
        st.integers(200, 500),
        st.lists(happening, max_size=8).map(tuple),
        st.lists(st.integers(1, 40), min_size=1, max_size=5).map(tuple),
    )


class StorySource(FedSource):
    """A source that decodes the bytes of a simulated board. The bytes that arrived together are a `Moment`.

    `together`: how many moments each read joins. After the last number, the first one is used again.
    """

    live = False

    def __init__(self, together: Sequence[int] = (1,)) -> None:
        super().__init__("board", prompt=False)
        self._together = together

    def read(self, moments: Sequence[Moment]) -> Iterator[Event]:
        """Read the bytes of several moments at a time, as `together` says, and yield the events. Where the
        port is lost, first yield the events that are due by then, and then open the port again.
        """
        begin, turn = 0, 0
        while begin < len(moments):
            data, host_ns, offset_ns = moments[begin]
            if data is None:
                yield from self.wire.pass_time(host_ns)
                yield LinkDown(host_ns)
                yield from self.wire.feed(Opened(host_ns, offset_ns), host_ns)
                begin += 1
                continue
            most = begin + self._together[turn % len(self._together)]
            end = next((k for k in range(begin, len(moments)) if moments[k].data is None), len(moments))
            end, turn = min(most, end), turn + 1
            datas, *times = zip(*moments[begin:end], strict=True)
            ends = np.cumsum([len(data) for data in datas])
            yield from self.wire.feed(Reads(b"".join(datas), ends, *map(np.array, times)), host_ns)
            begin = end


def torn(moments: Sequence[Moment], cuts: Sequence[float]) -> Iterator[Moment]:
    """Split each `Moment`, whose bytes arrived together, into several ones with the same arrival time.

    `cuts`: where to split, as fractions of the bytes.
    """
    for data, *at in moments:
        if data is None:
            yield Moment(None, *at)
            continue
        places = sorted({0, len(data), *(int(cut * len(data)) for cut in cuts)})
        for begin, end in pairwise(places):
            yield Moment(data[begin:end], *at)

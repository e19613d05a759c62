"""Listen to a device for some seconds: open its port, decode what the device sends, and summarise that."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fltea.records import clock
from fltea.records.events import LinkDown, Opened, RawBlock, Reads, TransportEvent, Trouble
from fltea.records.records import Hello
from fltea.records.stats import DeviceStatus, LinkStats
from fltea.sources.clock_fit import fit_clock
from fltea.sources.serial import SerialSource
from fltea.sources.wire_events import SILENCE_S
from fltea.stream.decode import Decoded, Decoder
from fltea.wire import layout as wire

HEAR_S = 4.0
PATIENCE_S = SILENCE_S + 1.5
"""Time after which listening ends if no HELLO came [s]. It is long enough to distinguish silence from
unreadable bytes.
"""

BLOCK_S = 0.25
"""Duration of each block of samples [s]. To compare clocks, only the sample with the shortest delay in each
block is used.
"""

BLOCKS_NEEDED = 6


class Drift(NamedTuple):
    """How much faster the device's clock is than the host's, and this figure's standard error, in 1e-6."""

    ppm: float
    std_ppm: float


@dataclass
class Heard:
    """Summary of what a device sent while `hear` listened.

    `opened`: whether the port was opened. `troubles`: everything that went wrong, in order of time; a trouble
    that makes the device useless is `fatal`. `delivered`, `lost`: numbers of samples that arrived, and that
    were lost. `seconds`: time from the first to the last sample, by the device's clock. `drift`: how much
    faster the device's clock is than the host's; None if there were too few samples.
    """

    opened: bool = False
    hello: Hello | None = None
    status: DeviceStatus | None = None
    troubles: list[Trouble] = field(default_factory=list)
    link: LinkStats = field(default_factory=LinkStats)
    delivered: int = 0
    lost: int = 0
    seconds: float = 0.0
    drift: Drift | None = None

    @property
    def failure(self) -> Trouble | None:
        """The trouble that makes the device useless, if there is one."""
        return next((trouble for trouble in self.troubles if trouble.fatal), None)

    @property
    def rate_hz(self) -> float | None:
        """Sampling rate by the device's clock, lost samples included [Hz]; None if fewer than two arrived."""
        return (self.delivered + self.lost - 1) / self.seconds if self.seconds else None


def hear(url: str, baud: int = wire.BAUD, hear_s: float = HEAR_S) -> Heard:
    """Open a serial URL, listen, and summarise what the device sent. Opening the port resets a Due.

    Listening ends `hear_s` after the HELLO, at the first fatal trouble, or after `PATIENCE_S` without a
    HELLO.

    Raises:
        UsageError: the kind of URL is unknown, or the speed is 1200 baud.
    """
    heard, source = Heard(), SerialSource(url, baud)
    # `max_gap` is so large that no gap begins a new epoch (numbering of samples)
    decoder = Decoder(lambda: 0, max_gap=wire.BAUD)
    arrivals: list[tuple[int, int]] = []
    begin_ns = clock.host_ns()
    hello_ns: int | None = None

    def note(item: TransportEvent | Reads) -> None:
        heard.opened |= isinstance(item, Opened)

    source.tap = note
    try:
        for event in source.events():
            now_ns = clock.host_ns()
            match event:
                case Hello():
                    decoder.on_hello(event)
                    heard.hello, hello_ns = event, hello_ns or now_ns
                case LinkDown():
                    decoder.on_other(event)
                case RawBlock():
                    for found in decoder.feed(event):
                        if isinstance(found, Decoded):
                            host_ns = found.raw.host_ns.tolist()
                            arrivals += zip(found.block.device_us.tolist(), host_ns, strict=True)
                case DeviceStatus():
                    heard.status = event
                case Trouble():
                    heard.troubles.append(event)
            since_ns, limit_s = (begin_ns, PATIENCE_S) if hello_ns is None else (hello_ns, hear_s)
            if heard.failure or now_ns - since_ns >= limit_s * 1e9:
                break
    finally:
        source.close()
    heard.link = source.link_stats()
    counts = decoder.counts
    heard.delivered, heard.lost = counts.delivered, counts.lost
    if len(arrivals) > 1:
        heard.seconds = (arrivals[-1][0] - arrivals[0][0]) * 1e-6
        heard.drift = drift(arrivals)
    return heard


def drift(arrivals: list[tuple[int, int]]) -> Drift | None:
    """Return how much faster the device's clock is than the host's; None if samples span too little time.

    `arrivals`: `device_us` and `host_ns` of each sample, within one epoch.
    """
    device_us, host_ns = np.array(arrivals, dtype=np.int64).T
    device_s = (device_us - device_us[0]) * 1e-6
    delay_s = (host_ns - host_ns[0]) * 1e-9 - device_s
    block = (device_s / BLOCK_S).astype(int)
    earliest = [int(np.flatnonzero(block == b)[np.argmin(delay_s[block == b])]) for b in np.unique(block)]
    if len(earliest) < BLOCKS_NEEDED:
        return None
    fit = fit_clock(device_s[earliest].tolist(), delay_s[earliest].tolist())
    return Drift((1.0 / (1.0 + fit.slope) - 1.0) * 1e6, fit.slope_std * 1e6)

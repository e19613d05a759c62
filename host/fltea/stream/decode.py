"""The first half of a sample's walk: source → continuity → timebase → units.

`fltea.stream.pipeline` goes on from here to the estimator; recordings are exported and summed up without one.
"""

from collections.abc import Callable
from typing import NamedTuple

from fltea.records.events import Break, Event, LinkDown, RawSample
from fltea.records.records import EpochReason, Hello, Sample
from fltea.stream.place import Continuity
from fltea.stream.time import Timebase
from fltea.wire.sample_scaling import to_units


class Decoded(NamedTuple):
    """One sample in physical units and in counts. missing: samples lost just before it."""

    sample: Sample
    raw: RawSample
    hello: Hello
    missing: int
    new_epoch: EpochReason | None


class Decoder:
    """Turns the events of a source into samples.

    unix_offset_ns: the source's. max_gap: as `link.max_gap` of the settings.
    """

    def __init__(self, unix_offset_ns: Callable[[], int], max_gap: int, device: str | None = None) -> None:
        self.continuity = Continuity(max_gap)
        self.timebase: Timebase | None = None
        self.epoch = 0
        self._unix_offset_ns = unix_offset_ns
        self._device = device

    def feed(self, event: Event) -> Decoded | Hello | None:
        """Take one event; a sample that can be used, or a HELLO that tells something new."""
        match event:
            case Hello() if self.continuity.on_hello(event):
                return event
            case LinkDown():
                self.continuity.on_link_down()
            case Break():
                self.continuity.on_break(event.reason)
            case RawSample():
                return self._on_sample(event)
        return None

    def _on_sample(self, raw: RawSample) -> Decoded | None:
        placed, hello = self.continuity.on_sample(raw), self.continuity.hello
        if placed is None or hello is None:
            return None
        if placed.new_epoch is not None or self.timebase is None:
            self.epoch += 1
            self.timebase = Timebase(self._unix_offset_ns())
        host_ns = self.timebase.add(placed.seq, placed.device_us, raw.host_ns)
        sample = to_units(raw, hello, self.epoch, placed.seq, placed.device_us, host_ns, self._device)
        return Decoded(sample, raw, hello, placed.missing, placed.new_epoch)

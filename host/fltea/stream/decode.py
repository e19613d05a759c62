"""The first half of a sample's walk: source → place → time → units.

`fltea.stream.pipeline` goes on from here to the estimators; recordings are exported without any.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from fltea.records.block import Block
from fltea.records.events import Break, Event, LinkDown, RawBlock
from fltea.records.records import EpochReason, Hello
from fltea.settings.duration import Duration
from fltea.settings.outputs import OutputConfig
from fltea.stream.place import Piece, Place
from fltea.stream.time import Timebase
from fltea.wire.sample_scaling import accel_ms2, gyro_dps, temperatures_c


class Decoded(NamedTuple):
    """Samples in physical units and in counts, without a gap. missing: samples lost just before them."""

    block: Block
    raw: RawBlock
    hello: Hello
    missing: int
    new_epoch: EpochReason | None


class Decoder:
    """Turns the events of a source into samples.

    unix_offset_ns: the source's. max_gap: as `link.max_gap` of the settings. device, output: as
    `Block` has them.
    """

    def __init__(
        self,
        unix_offset_ns: Callable[[], int],
        max_gap: Duration,
        device: str | None = None,
        output: OutputConfig | None = None,
    ) -> None:
        self.place = Place(max_gap)
        self.timebase: Timebase | None = None
        self.epoch = 0
        self._unix_offset_ns = unix_offset_ns
        self._device, self._output = device, output or OutputConfig()

    def feed(self, event: Event) -> Iterator[Decoded | Hello]:
        """Take one event; samples that can be used, and a HELLO that states something new."""
        match event:
            case RawBlock():
                for piece in self.place.on_block(event):
                    yield self._decoded(piece)
            case Hello() if self.place.on_hello(event):
                yield event
            case LinkDown():
                self.place.on_link_down()
            case Break():
                self.place.on_break(event.reason)

    def _decoded(self, piece: Piece) -> Decoded:
        raw, seq, device_us, missing, new_epoch = piece
        hello = self.place.hello
        assert hello is not None
        if new_epoch is not None or self.timebase is None:
            self.epoch += 1
            self.timebase = Timebase(self._unix_offset_ns())
        block = Block(
            self._device,
            self.epoch,
            seq,
            device_us,
            self.timebase.add(seq, device_us, raw.host_ns),
            gyro_dps(raw, hello),
            accel_ms2(raw, hello),
            temperatures_c(raw, hello),
            raw.flags,
            every=self._output.every,
            corrected=self._output.corrected,
        )
        return Decoded(block, raw, hello, missing, new_epoch)

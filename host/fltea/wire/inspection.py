"""Shows the frames in a stream of bytes as text.

Each frame, damaged or not, gets one line; a summary gives the counts.
"""

from collections.abc import Iterable, Iterator
from enum import IntFlag

from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.messages import REASONS, BadFrame, Frame, Refused

HEX_BYTES_SHOWN = 24


FLAGS: dict[type[wire.Message], type[IntFlag]] = {wire.Estimate: wire.EstimateFlags, wire.Fit: wire.FitFlags}
"""For two types of messages, the meanings of the bits in their field `flags`. In any other message with such
a field, the bits have the same meanings as in SAMPLE.
"""


def inspect(chunks: Iterable[bytes], reader: FrameReader) -> Iterator[str]:
    """Yield one line of text for every frame in the bytes `chunks`. `reader` decodes and counts the frames.

    After a HELLO of another protocol version, the fields of frames may have other meanings. The lines of good
    frames therefore begin with `?`.
    """
    doubtful = False
    for chunk in chunks:
        for item in reader.feed_all(chunk):
            if isinstance(item, Refused) or (
                isinstance(item, Frame) and isinstance(item.message, wire.Hello)
            ):
                doubtful = isinstance(item, Refused)
            yield ("? " if doubtful and isinstance(item, Frame) else "") + describe(item)


def describe(item: Frame | Refused | BadFrame) -> str:
    """Return one line of text for a frame: type, sequence number, device time [s], and the fields as sent."""
    match item:
        case Refused():
            return f"HELLO    REFUSED: {item.message}"
        case BadFrame(reason, data):
            more = " …" if len(data) > HEX_BYTES_SHOWN else ""
            return f"bad      {reason} ({REASONS[reason]}): {data[:HEX_BYTES_SHOWN].hex(' ')}{more}"
        case Frame():
            name = type(item.message).__name__.upper()
            fields = zip(item.message._fields, item.message, strict=True)
            flags = FLAGS.get(type(item.message), wire.SampleFlags)
            text = "  ".join(f"{field} {_value(field, value, flags)}" for field, value in fields)
            return f"{name:8} seq {item.sequence:5}  t {item.device_us / 1e6:11.6f} s  {text}"


def summary(reader: FrameReader) -> str:
    """Return a text with the counts of bytes, good frames and bad frames in the stream."""
    parts = [f"{reader.bytes_in} bytes", f"{reader.counts['frames']} good frames"]
    parts += [f"{n} {reason}" for reason, n in sorted(reader.counts.items()) if reason != "frames"]
    return ", ".join(parts)


def _value(field: str, value: object, flags: type[IntFlag]) -> str:
    if isinstance(value, float):
        return f"{value:.7g}"  # seven digits, as many as a 32-bit float holds
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, str):
        return repr(value)
    if field in ("schema_hash", "boot_id", "detail"):
        return f"0x{value:08X}"
    if field == "who_am_i":
        return f"0x{value:02X}" if value else "0x00 (no sensor)"
    enum = {
        "sampling_mode": wire.SamplingMode,
        "reset_cause": wire.ResetCause,
        "code": wire.FaultCode,
        "axis": wire.Axis,
        "variant": wire.EstimatorVariant,
        "guard": wire.EstimatorGuard,
        "verdict": wire.FitVerdict,
    }.get(field)
    if enum is not None and value in enum._value2member_map_:
        return f"{value} ({enum._value2member_map_[value].name.lower()})"
    if field == "flags" and value:
        names = [flag.name for flag in flags if flag & int(str(value))]
        return f"{value} ({'|'.join(str(name).lower() for name in names)})" if names else str(value)
    return str(value)

"""Writes good.txt, bad.txt and streams.txt of protocol/vectors (formats: protocol/README.md, "Vectors").

The vectors test fltea's own code, so neither code of fltea nor the code generator makes them. COBS comes from
a library of PyPI, and CRC-32 from zlib. The layouts come from schema.txt, a text that is typed by hand. Its
hash is the schema hash. A mistake in `protocol/messages.toml`, in the generator or in schema.txt therefore
leads to another hash or to other bytes.
"""

import math
import struct
import zlib
from pathlib import Path

from cobs import cobs

SOURCE = "tools/make_vectors.py"
HELLO, SAMPLE, STATUS, FAULT, ESTIMATE, ESTIMATOR, FIT, SPECTRUM, UNKNOWN = 1, 2, 3, 4, 5, 6, 7, 8, 200
TYPED = Path(__file__).resolve().parents[1] / "protocol/vectors/schema.txt"
SCHEMA = TYPED.read_text(encoding="utf-8").partition("\n")[2]
"""Text of schema.txt without its first line, a comment."""
HASH = zlib.crc32(SCHEMA.encode())
CODES = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "f32": "f", "bytes16": "16s", "text24": "24s"}
"""For each type of a field: its format character in Python's module struct."""


def layouts() -> dict[int, list[tuple[str, str]]]:
    """Return, for each type byte, the names and types of the fields, in their order on the wire."""
    found: dict[int, list[tuple[str, str]]] = {}
    fields: list[tuple[str, str]] = []
    for line in SCHEMA.splitlines():
        word, first, *rest = line.split()
        if word == "message":
            fields = found[int(first)] = []
        elif word == "field":
            fields.append((first, rest[0]))
    return found


LAYOUTS = layouts()

DEVICE = bytes(range(0xA0, 0xB0))
TYPICAL_HELLO = (1, 5, HASH, 0x12345678, DEVICE, "fltea 0.1.0", 0x71, 3, 100_000, 2000, 164, 2, 16384, 184, 0)
TYPICAL_SAMPLE = (12, -7, 3, -120, 85, 16390, -1042, 0)
TYPICAL_STATUS = (2, 1, 0, 3, 5, 4, 1734, 8120)
TYPICAL_FIT = (1, 2, 1, 31, 12000, 11904, 12, 5210.5, 0.4375, 0.031, -1.25, 0.0003, 0.0231, 91.5, 12.25)
TYPICAL_SPECTRUM = (
    *(1, 31, 5, 122),
    *(0.125, 1.0, 0.0021, 0.25, 1.875, 0.0013, 0.5, 3.75, 0.00075, 1.0, 7.5, 0.0005, 2.0, 15.25, 0.00046),
)
TYPICAL_ESTIMATE = (
    *(1, 33, 3999, 3000, 0.4375, 0.031, -1.25, 0.18, -0.0123, 0.0042),
    *(0, 3, 0, 17, 1, 0, 29, 2, 0, -0.4713, 0.0021, 0.0113, 0.0019),
)
SETTINGS = (0.0, 0.01, 0.15, 0.5, 0.06, 0.0, 0.0, -0.1, 0.06, 0.0, 0.0, 3.0)
FILLING = (1, 2, 1000, 200, 1, 1000, 1, 300, 0, 0, 0, 0, *(0,) * 3, *(0.0,) * 6, *SETTINGS)
BIAS_R = (-0.4713, 0.0625, 1.09, 0.0031, 0.0029, 0.0)
ESTIMATING = (1, 2, 1000, 200, 1, 0, 2, 300, 3, 4, 5120, 1230, 5, 1, 0, *BIAS_R, *SETTINGS)
U16, U32 = 0xFFFF, 0xFFFFFFFF
# The largest f32, the smallest normal f32 and the smallest subnormal f32.
LARGEST, NORMAL, SMALLEST = 3.40282347e38, 1.17549435e-38, 1.4e-45

GOOD = [
    ("hello of a healthy device", (HELLO, 0, 1000), TYPICAL_HELLO),
    ("hello, smallest values", (HELLO, 0, 0), (1, 0, HASH, 0, bytes(16), "", *(0,) * 9)),
    (
        "hello, largest values, a text that fills its field, another minor version",
        (HELLO, U16, U32),
        (1, 255, HASH, U32, b"\xff" * 16, "abcdefghijklmnopqrstuvwx", 255, U16, U32, *(U16,) * 5, 255),
    ),
    ("sample at rest", (SAMPLE, 1, 1_010_000), TYPICAL_SAMPLE),
    ("sample, all zero", (SAMPLE, 0, 0), (0,) * 8),
    ("sample, most negative", (SAMPLE, U16, U32), (*(-32768,) * 7, 0)),
    ("sample, most positive, every flag bit", (SAMPLE, U16, U32), (*(32767,) * 7, 255)),
    ("sample, all minus one: no zero byte in the payload", (SAMPLE, 0x0101, 0x01010101), (*(-1,) * 7, 255)),
    ("status after some trouble", (STATUS, 7, 7_000_000), TYPICAL_STATUS),
    ("status, all zero", (STATUS, 0, 0), (0,) * 8),
    (
        "status, all ones: a reset cause that no version names",
        (STATUS, U16, U32),
        (*(U32,) * 5, 254, U16, U32),
    ),
    ("fault, a register that did not keep its setting", (FAULT, 0, 250_000), (3, 0x1B1800)),
    ("fault, no edge on the data-ready pin", (FAULT, 1, 12_345_678), (6, 1_000_123)),
    ("fault, a sensor that stands still", (FAULT, 2, 13_000_000), (7, 10)),
    ("fault, code of no known kind", (FAULT, U16, U32), (99, U32)),
    ("estimate of a healthy axis", (ESTIMATE, 8998, 41_000_450), TYPICAL_ESTIMATE),
    (
        "estimate, an axis that never changed: all zero but for its flag",
        (ESTIMATE, 0, 0),
        (0, 2, 0, 0, *(0.0,) * 6, *(0,) * 9, *(0.0,) * 4),
    ),
    (
        "estimate, largest counts, f32 at the ends of its range, an axis that no version names",
        (ESTIMATE, U16, U32),
        (
            *(255, 255, U16, U32, LARGEST, SMALLEST, -LARGEST, NORMAL, -0.0, -SMALLEST, *(U32,) * 9),
            *(-LARGEST, LARGEST, -0.0, SMALLEST),
        ),
    ),
    (
        "estimate with numbers that no device sends",
        (ESTIMATE, 1, 2),
        (2, 1, 3, 4, math.nan, math.inf, -math.inf, 1.0, -1.0, 0.1, *range(9), math.inf, math.nan, 0.5, -1.0),
    ),
    ("estimator, its start-up window filling", (ESTIMATOR, 0, 1000), FILLING),
    ("estimator, after the window", (ESTIMATOR, 40, 41_000_000), ESTIMATING),
    (
        "estimator, largest counts, f32 at the ends of its range and beside 1, an unknown variant and guard",
        (ESTIMATOR, U16, U32),
        (
            *(255, 255, *(U16,) * 7, *(U32,) * 3, *(U16,) * 3),
            *(LARGEST, SMALLEST, NORMAL, -LARGEST, -SMALLEST, -NORMAL, 0.0, -0.0, -1.25),
            *(1.00000012, 0.99999994, 16777216.0, -16777215.0, 0.333333343, 1e-38, -1e-44, 123456792.0, 0.1),
        ),
    ),
    ("fit of fractional noise", (FIT, 93, 125_000_300), TYPICAL_FIT),
    ("fit of an axis without a spectrum", (FIT, 7, 10), (2, 0, 0, 3, 2000, 0, 0, *(0.0,) * 8)),
    ("fit of white noise, whose order is not defined", (FIT, 0, 0), (0, 1, 0, 1, *(0,) * 3, *(0.0,) * 8)),
    (
        "fit, largest counts, f32 at the ends of its range, an axis and a verdict that no version names",
        (FIT, U16, U32),
        (
            *(255, 255, 255, U16, U32, U32, U16),
            *(LARGEST, SMALLEST, NORMAL, -LARGEST, -SMALLEST, -NORMAL, 0.333333343, -0.0),
        ),
    ),
    (
        "fit with numbers that no device sends",
        (FIT, 1, 2),
        (2, 3, 1, 4, 5, 6, 7, math.nan, math.inf, *(0.5,) * 6),
    ),
    ("some bins of a spectrum", (SPECTRUM, 1202, 125_000_900), TYPICAL_SPECTRUM),
    (
        "the last bins of a spectrum, of which there are two",
        (SPECTRUM, 9, 1),
        (0, 1, 60, 62, *(0.5,) * 6, *(0.0,) * 9),
    ),
    ("spectrum, largest values", (SPECTRUM, U16, U32), (255, U16, 255, 255, *(LARGEST,) * 15)),
]
"""The cases of good.txt. Each consists of a name, the three values of the header (type, sequence number,
time), and the fields of the message.
"""

RAW = [
    ("unknown type, no payload", UNKNOWN, 3, 77, b""),
    ("unknown type 0, one byte", 0, 0, 0, b"\x00"),
    ("unknown type 255, 240 bytes without a zero", 255, U16, U32, bytes(range(1, 241))),
    ("unknown type, 240 zero bytes", UNKNOWN, 0, 0, bytes(240)),
]


def payload(kind: int, fields: tuple[int | float | str | bytes, ...]) -> bytes:
    """Return the fields of a message as bytes. struct pads text with NUL."""
    codes = "".join(CODES[type] for _, type in LAYOUTS[kind])
    return struct.pack(f"<{codes}", *(f.encode("ascii") if isinstance(f, str) else f for f in fields))


def close(body: bytes) -> bytes:
    """Encode with COBS and append the closing 0x00."""
    return bytes(cobs.encode(body)) + b"\x00"


def body(kind: int, sequence: int, device_us: int, data: bytes) -> bytes:
    """Return header, payload and CRC of a frame, not yet encoded by COBS."""
    head = struct.pack("<BHI", kind, sequence, device_us) + data
    return head + struct.pack("<I", zlib.crc32(head))


def frame(kind: int, sequence: int, device_us: int, data: bytes) -> bytes:
    """Return the encoded bytes of one frame."""
    return close(body(kind, sequence, device_us, data))


def sample(sequence: int, device_us: int) -> bytes:
    """Return the encoded bytes of a typical SAMPLE."""
    return frame(SAMPLE, sequence, device_us, payload(SAMPLE, TYPICAL_SAMPLE))


def good() -> str:
    """Return the text of good.txt."""
    text = "# Whole frames: what goes in, and the bytes on the wire. Written by tools/make_vectors.py.\n"
    for name, (kind, sequence, device_us), fields in GOOD:
        data = payload(kind, fields)
        text += f"\nname {name}\ntype {kind}\nsequence {sequence}\ndevice_us {device_us}\n"
        for (key, _), value in zip(LAYOUTS[kind], fields, strict=True):
            shown = value.hex() if isinstance(value, bytes) else value
            text += f"field {key} {shown}".rstrip() + "\n"
        text += f"payload {data.hex()}\nwire {frame(kind, sequence, device_us, data).hex()}\n"
    for name, kind, sequence, device_us, data in RAW:
        text += f"\nname {name}\ntype {kind}\nsequence {sequence}\ndevice_us {device_us}\n"
        text += f"payload {data.hex()}".rstrip() + "\n"
        text += f"wire {frame(kind, sequence, device_us, data).hex()}\n"
    return text


FINE = sample(1, 1_010_000)
WHOLE = body(SAMPLE, 1, 1_010_000, payload(SAMPLE, TYPICAL_SAMPLE))
FLIPPED = bytes([WHOLE[0], WHOLE[1], WHOLE[2], WHOLE[3], WHOLE[4] ^ 1, *WHOLE[5:]])
SWAPPED = WHOLE[:-4] + WHOLE[-4:][::-1]
OTHER_HELLO = (2, 1, HASH, *TYPICAL_HELLO[3:])
FOREIGN_HELLO = (1, 1, 0xDEADBEEF, *TYPICAL_HELLO[3:])

# For each reason to refuse bytes: its cases in bad.txt. A 0x00 is put before each case. Without it, a
# receiver would give another reason: "partial", a frame whose beginning it missed.
BAD = {
    "cobs": [
        ("block that promises more bytes than come", b"\x05\x01\x02\x00"),
        ("a code alone", b"\xff\x00"),
    ],
    "oversize": [
        ("254 bytes without a zero", b"\x01" * 254 + b"\x00"),
        ("one byte more than the longest block", b"\x01" * 253 + b"\x00"),
        ("a well formed frame with 241 bytes of payload", frame(2, 0, 0, bytes(241))),
    ],
    "short": [
        ("empty body", b"\x01\x00"),
        ("one byte", close(b"\x02")),
        ("ten bytes, one too few, their CRC right", close(body(SAMPLE, 1, 2, b"")[1:])),
    ],
    "crc": [
        ("one bit of the time flipped", close(FLIPPED)),
        ("CRC in big-endian", close(SWAPPED)),
        ("eleven zero bytes", close(bytes(11))),
        ("a missing 0x00 between two frames", FINE[:-1] + FINE),
    ],
    "length": [
        ("sample without its flags", frame(SAMPLE, 1, 2, bytes(14))),
        ("sample without payload", frame(SAMPLE, 1, 2, b"")),
        ("status as it was before it had the share of the processor", frame(STATUS, 1, 2, bytes(21))),
        (
            "estimate without its last byte",
            frame(ESTIMATE, 1, 2, payload(ESTIMATE, TYPICAL_ESTIMATE)[:-1]),
        ),
        ("fit without its last byte", frame(FIT, 1, 2, payload(FIT, TYPICAL_FIT)[:-1])),
        ("hello too short to state a version", frame(HELLO, 1, 2, b"\x01\x00\x01\x02\x03")),
        (
            "hello of this version, cut after the version",
            frame(HELLO, 1, 2, struct.pack("<BBI", 1, 0, HASH)),
        ),
    ],
    "unknown_type": [("type that no version knows", frame(UNKNOWN, 1, 2, b"abc"))],
}
BAD_FIRST = [
    (
        "the same as the first block: it is intact, so not partial",
        "unknown_type",
        frame(UNKNOWN, 1, 2, b"abc"),
    ),
    ("the end of a frame, as the first block", "partial", FINE[9:]),
    ("rubbish longer than any frame, as the first block", "partial", b"\x7e" * 400 + b"\x00"),
]
REFUSED = [
    ("hello of the next major version", "2 1 " + f"{HASH:08x}", payload(HELLO, OTHER_HELLO)),
    ("hello of another schema", "1 1 deadbeef", payload(HELLO, FOREIGN_HELLO)),
    (
        "hello of a later version that is only six bytes long",
        "7 3 00000001",
        struct.pack("<BBI", 7, 3, 1),
    ),
    ("hello of a later version that is 240 bytes long", "2 1 00000000", struct.pack("<BBI234x", 2, 1, 0)),
]


def bad() -> str:
    """Return the text of bad.txt: byte streams that a receiver has to reject, each with the reason."""
    text = "# Bytes from the start of a stream, and the one thing found. Written by tools/make_vectors.py.\n"
    after = [(name, reason, b"\x00" + data) for reason, some in BAD.items() for name, data in some]
    for name, reason, data in after + BAD_FIRST:
        text += f"\nname {name}\nbad {reason}\nwire {data.hex()}\n"
    for name, version, data in REFUSED:
        text += f"\nname {name}\nrefused {version}\nwire {frame(HELLO, 0, 1, data).hex()}\n"
    return text


HELLO_FRAME = frame(HELLO, 0, 900, payload(HELLO, TYPICAL_HELLO))
STATUS_FRAME = frame(STATUS, 0, 1_000_500, payload(STATUS, TYPICAL_STATUS))
FAULT_FRAME = frame(FAULT, 0, 1_000_600, payload(FAULT, (1, 0x68)))
ESTIMATE_FRAME = frame(ESTIMATE, 0, 20_350, payload(ESTIMATE, TYPICAL_ESTIMATE))
ESTIMATOR_FRAME = frame(ESTIMATOR, 0, 950, payload(ESTIMATOR, FILLING))
# The payload of an ESTIMATE with NaN of several bit patterns (both signs, quiet and signalling), and both
# infinities.
ODD = (
    payload(ESTIMATE, TYPICAL_ESTIMATE)[:8]
    + struct.pack("<6I", 0x7FC00000, 0xFFC12345, 0x7F800001, 0xFFFFFFFF, 0x7F800000, 0xFF800000)
    + payload(ESTIMATE, TYPICAL_ESTIMATE)[32:]
)
STRANGE = frame(UNKNOWN, 5, 6, b"\x00\x01")
SHORT = frame(SAMPLE, 1, 2, bytes(14))
LATER = frame(HELLO, 4, 5, payload(HELLO, (1, 200, 0xDEADBEEF, *TYPICAL_HELLO[3:])) + b"\x07")
LONG = frame(SAMPLE, 1, 2, payload(SAMPLE, TYPICAL_SAMPLE) + b"\x01\x02\x03")
FUTURE = frame(HELLO, 4, 5, struct.pack("<BBI10x", 2, 0, 1))
ONE, TWO, THREE = sample(1, 10_000), sample(2, 20_000), sample(3, 30_000)
# The frame `TWO`, cut off in mid-block. A COBS code says how many bytes its block has. The last code here,
# 04, stands for itself and three more bytes, but only two are left. A decoder takes the first byte of the
# next frame for the third, and the byte after it for a code. The result is valid COBS; only the CRC finds the
# fault.
CUT = TWO[:12]
# A frame of 26 bytes without a zero: COBS only puts the code 0x1B before it. HALVED has a 0x00 in its middle.
SOLID = frame(SAMPLE, 0x0101, 0x7F7F7F7F, b"\x7f" * 15)
assert SOLID[0] == 27
HALVED = SOLID[:10] + b"\x00" + SOLID[11:]
FOUND = {
    "hello": "frame 1 0 900",
    "status": "frame 3 0 1000500",
    "fault": "frame 4 0 1000600",
    "estimate": "frame 5 0 20350",
    "estimator": "frame 6 0 950",
    "one": "frame 2 1 10000",
    "two": "frame 2 2 20000",
    "three": "frame 2 3 30000",
}
"""For the name of each frame in STREAMS: the line of streams.txt that a decoder's output has for this frame.
"""
STREAMS: list[tuple[str, list[bytes], str]] = [
    (
        "a boot: 0x00, then every kind of message",
        [b"\x00", HELLO_FRAME, ESTIMATOR_FRAME, ONE, TWO, ESTIMATE_FRAME, STATUS_FRAME, FAULT_FRAME, THREE],
        "hello, estimator, one, two, estimate, status, fault, three",
    ),
    ("no 0x00 before the first frame", [ONE, TWO], "one, two"),
    ("attached within a frame", [ONE[5:], TWO, THREE], "bad partial, two, three"),
    ("attached at the closing 0x00", [ONE[-1:], TWO], "two"),
    (
        "rubbish of a boot loader, then the device's 0x00",
        [b"boot\r\n\x00", HELLO_FRAME],
        "bad partial, hello",
    ),
    ("damage after the first 0x00 is not partial", [b"\x00", b"\x05\x01\x00", ONE], "bad cobs, one"),
    ("nothing but idle 0x00", [bytes(300)], ""),
    ("0x00 twice and more between frames", [ONE, b"\x00\x00", TWO, b"\x00", THREE], "one, two, three"),
    ("rubbish between frames", [ONE, b"\xfegarbage\x00", TWO], "one, bad cobs, two"),
    ("a missing 0x00 costs the two frames beside it", [ONE, TWO[:-1], TWO, THREE], "one, bad crc, three"),
    ("a frame cut short and not closed", [ONE, CUT, THREE, ONE], "one, bad crc, one"),
    ("a byte turned into 0x00 makes two bad blocks", [ONE, HALVED, TWO], "one, bad cobs, bad cobs, two"),
    ("300 bytes without a 0x00", [ONE, b"\x55" * 300 + b"\x00", TWO], "one, bad oversize, two"),
    ("5000 bytes without a 0x00 count once", [ONE, b"\x55" * 5000 + b"\x00", TWO], "one, bad oversize, two"),
    ("252 bytes are not too long, only wrong", [ONE, b"\xff" * 252 + b"\x00", TWO], "one, bad cobs, two"),
    ("253 bytes are too long", [ONE, b"\xff" * 253 + b"\x00", TWO], "one, bad oversize, two"),
    (
        "253 bytes without a 0x00 are too long for a frame: reported before a 0x00",
        [ONE, b"\x55" * 253],
        "one, bad oversize",
    ),
    ("252 bytes without a 0x00 may still be a frame: not reported yet", [ONE, b"\x55" * 252], "one"),
    ("a first block that is too long", [b"\x55" * 1000 + b"\x00", ONE], "bad partial, one"),
    (
        "unknown types and wrong lengths",
        [ONE, STRANGE, SHORT, TWO],
        "one, bad unknown_type, bad length, two",
    ),
    (
        "NaN and infinities are no damage",
        [ONE, frame(ESTIMATE, 7, 20_350, ODD), TWO],
        "one, frame 5 7 20350, two",
    ),
    (
        "a device of a later minor version: fields and messages that it adds are left out",
        [LATER, LONG, STRANGE, TWO],
        "frame 1 4 5, frame 2 1 2, bad unknown_type, two",
    ),
    ("a device of another version", [b"\x00", FUTURE, ONE], "refused 2 0 00000001, one"),
    (
        "sequence and time wrap",
        [sample(65535, 4_294_960_000), sample(0, 2_704), sample(1, 12_704)],
        "frame 2 65535 4294960000, frame 2 0 2704, frame 2 1 12704",
    ),
    ("the last frame has not ended", [ONE, TWO[:-1]], "one"),
    ("no bytes", [], ""),
]


def streams() -> str:
    """Return the text of streams.txt."""
    text = "# Streams from the start, and all that is found, in order. Written by tools/make_vectors.py.\n"
    for name, parts, words in STREAMS:
        found = [FOUND.get(word, word) for word in words.split(", ") if word]
        text += f"\nname {name}\n" + "".join(f"bytes {part.hex()}\n" for part in parts)
        text += "".join(f"{item}\n" for item in found)
        counts = {"frames": sum(item.startswith("frame ") for item in found)}
        for item in found:
            if item.startswith("bad "):
                counts[item[4:]] = counts.get(item[4:], 0) + 1
        text += "".join(f"count {key} {number}\n" for key, number in counts.items() if number)
    return text


def outputs(root: Path) -> dict[str, str]:
    """Return the paths and texts of the three files."""
    texts = {"good": good(), "bad": bad(), "streams": streams()}
    return {f"protocol/vectors/{name}.txt": text for name, text in texts.items()}

"""Messages that boards publish: one second of frames per message."""

from fltea.wire import layout as wire
from fltea.wire.messages import encode

from tools.board_voice import HELLO


def second_of(k: int, second: int) -> bytes:
    """Return HELLO and a hundred samples of device `k`."""
    hello = HELLO._replace(boot_id=k + 1, device_id=bytes([k]) * 16)
    frames = [encode(hello, second, second * 10**6)]
    for at in range(100 * second, 100 * second + 100):
        noise = ((at * 7919 + k * 31) % 11 - 5, (at * 104729) % 7 - 3, (at * 15485863) % 5 - 2)
        frames.append(encode(wire.Sample(*noise, 0, 0, 16384, 1335, 0), at % 65536, at * 10_000))
    return b"".join(frames)

"""Native parts of fltea.

The device's encoder (firmware/core), for tests; the decoder of the wire; the estimator engine.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

SCHEMA_HASH: int

def crc32(data: bytes) -> int: ...
def cobs_encode(data: bytes) -> bytes: ...

# ValueError if the payload is too long.
def encode_frame(type: int, sequence: int, device_us: int, payload: bytes) -> bytes: ...

# ValueError if a value does not fit its field.
def encode_message(type: int, sequence: int, device_us: int, fields: tuple[Any, ...]) -> bytes: ...

# See fltea.block_reader.
class Decoder:
    def __init__(self) -> None: ...

    # What ends in these bytes. First n samples as columns: sequence, device_us, gyro (n, 3), accel (n, 3),
    # temperature, flags, end; None instead of empty ones. Then all else in order: samples before it, end,
    # reason (None for an intact frame), type, sequence, device_us (all 0 if there is a reason), payload or
    # block. TypeError if data is not bytes-like, BufferError if its bytes do not follow each other.
    def feed(
        self, data: bytes | bytearray | memoryview
    ) -> tuple[
        tuple[
            NDArray[np.uint16],
            NDArray[np.uint32],
            NDArray[np.int16],
            NDArray[np.int16],
            NDArray[np.int16],
            NDArray[np.uint8],
            NDArray[np.int64],
        ]
        | None,
        list[tuple[int, int, str | None, int, int, int, bytes]],
    ]: ...

    # As after a port was closed and opened again.
    def reset(self) -> None: ...
    @property
    def pending(self) -> int: ...

# Measurements and inputs beyond ± this are refused.
LARGEST_INPUT: float

# Usable on this processor, best first.
def instruction_sets() -> list[str]: ...

# See fltea.estimator.engine, which checks what this class only guards against crashes. Arrays are in C order.
class Engine:
    # settings: (lanes, fields) float64, engine_settings.native_table(); window 0 is unlimited.
    def __init__(
        self,
        instruction_set: str,
        joint: bool,
        guard: int,
        compressed: bool,
        accuracy: int,
        window: int,
        settings: NDArray[np.float64],
    ) -> None: ...

    # y, u (samples, lanes) float64; missing (samples, lanes) uint8; fills out (8, samples, lanes) float64.
    # ValueError for wrong shapes and for numbers that are refused, before anything has changed.
    def run(
        self,
        y: NDArray[np.float64],
        u: NDArray[np.float64] | None,
        missing: NDArray[np.uint8] | None,
        out: NDArray[np.float64],
    ) -> None: ...

    # mask (lanes,) uint8
    def reset(self, mask: NDArray[np.uint8]) -> None: ...

    # Fills out (lanes, causes) int32.
    def counts(self, out: NDArray[np.int32]) -> None: ...
    def save(self) -> bytes: ...

    # ValueError if the bytes cannot come from an engine of this kind.
    def load(self, snapshot: bytes) -> None: ...
    @property
    def storage_bytes(self) -> int: ...

"""Native parts of fltea: the device's encoder (firmware/core), for tests."""

from typing import Any

SCHEMA_HASH: int

def crc32(data: bytes) -> int: ...
def cobs_encode(data: bytes) -> bytes: ...

# ValueError if the payload is too long.
def encode_frame(type: int, sequence: int, device_us: int, payload: bytes) -> bytes: ...

# ValueError if a value does not fit its field.
def encode_message(type: int, sequence: int, device_us: int, fields: tuple[Any, ...]) -> bytes: ...

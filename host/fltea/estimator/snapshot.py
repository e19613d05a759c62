"""Bytes of a saved engine: magic, version, header (JSON), settings, state, CRC-32 of all that.

magic  8 bytes  b"FLTEAENG"
u32    version of this layout and of the native state's
u32    length of the header, u32 of the settings, u32 of the state (all little endian)
header {"accuracy", "guard", "instruction_set", "lanes", "memory", "settings_hash", "variant", "window"}
settings (lanes, fields) float64; state: the native engine's own bytes
u32    CRC-32 of everything before
"""

import hashlib
import json
import struct
import zlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.estimator.engine_settings import (
    FIELDS,
    EngineSettings,
    JointTuning,
    OrderTuning,
    ParameterTuning,
    StateTuning,
)

Array = NDArray[np.float64]

MAGIC = b"FLTEAENG"
VERSION = 1
_HEAD = struct.Struct("<8sIIII")
_CRC = struct.Struct("<I")
_COMMON = ("window", "memory", "accuracy", "variant", "guard")


class Saved(NamedTuple):
    """A snapshot, taken apart."""

    lanes: int
    instruction_set: str
    settings: EngineSettings
    """equal to the saved ones; numbers as arrays with one entry a lane"""
    settings_hash: str
    state: bytes

    def check(self, settings: EngineSettings) -> None:
        """Raise ValueError unless `settings` are those of the snapshot."""
        if _hash(settings, settings.table(self.lanes)) != self.settings_hash:
            raise ValueError("the snapshot was saved with other settings")


def pack(lanes: int, settings: EngineSettings, instruction_set: str, table: Array, state: bytes) -> bytes:
    """Return the bytes of an engine whose native side gave `state`; `table` is settings.table(lanes)."""
    fields = {**_common(settings), "lanes": lanes, "instruction_set": instruction_set}
    header = json.dumps({**fields, "settings_hash": _hash(settings, table)}, sort_keys=True).encode()
    numbers = table.astype("<f8").tobytes()
    body = b"".join(
        (_HEAD.pack(MAGIC, VERSION, len(header), len(numbers), len(state)), header, numbers, state)
    )
    return body + _CRC.pack(zlib.crc32(body))


def unpack(data: bytes) -> Saved:
    """Return what `pack` put together; ValueError for anything else, with what is wrong."""
    if len(data) < _HEAD.size or not data.startswith(MAGIC):
        raise ValueError("these bytes are not a snapshot of an engine")
    _, version, header_size, table_size, state_size = _HEAD.unpack_from(data)
    if version != VERSION:
        raise ValueError(f"the snapshot has version {version}, this fltea reads version {VERSION}")
    end = _HEAD.size + header_size + table_size + state_size
    if len(data) != end + _CRC.size:
        raise ValueError(f"the snapshot should have {end + _CRC.size} bytes, it has {len(data)}")
    if _CRC.unpack_from(data, end)[0] != zlib.crc32(data[:end]):
        raise ValueError("the snapshot is damaged: its checksum is wrong")
    table_start = _HEAD.size + header_size
    try:
        header: dict[str, Any] = json.loads(data[_HEAD.size : table_start])
        table = np.frombuffer(data, "<f8", table_size // 8, table_start).astype(np.float64)
        table = table.reshape(header["lanes"], len(FIELDS))
        return Saved(
            lanes=header["lanes"],
            instruction_set=str(header["instruction_set"]),
            settings=_settings(header, table),
            settings_hash=header["settings_hash"],
            state=data[table_start + table_size : end],
        )
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        # Only bytes that somebody made on purpose come so far.
        raise ValueError(f"not a snapshot of this version of the engine: {error}") from error


def _common(settings: EngineSettings) -> dict[str, Any]:
    return {name: getattr(settings, name) for name in _COMMON}


def _hash(settings: EngineSettings, table: Array) -> str:
    """Equal for settings that make equal engines."""
    common = json.dumps(_common(settings), sort_keys=True).encode()
    return hashlib.sha256(common + table.astype("<f8").tobytes()).hexdigest()


def _settings(header: dict[str, Any], table: Array) -> EngineSettings:
    column = dict(zip(FIELDS, table.T.copy(), strict=True))
    blocks: dict[str, Any] = {
        "state": StateTuning(**{name: column[f"state.{name}"] for name in ("P0", "Q", "x0", "R")})
    }
    if header["variant"] == "joint":
        blocks["joint"] = JointTuning(
            P0=column["order.P0"],
            Q0=column["order.Q0"],
            alpha0=column["order.alpha0"],
            beta0=column["parameter.f0"],
            R=column["parameter.R"],
            delta=column["parameter.delta"],
        )
    else:
        names = ("P0", "Q0", "R", "delta")
        blocks["order"] = OrderTuning(
            alpha0=column["order.alpha0"], **{name: column[f"order.{name}"] for name in names}
        )
        blocks["parameter"] = ParameterTuning(
            f0=column["parameter.f0"], **{name: column[f"parameter.{name}"] for name in names}
        )
    return EngineSettings(
        h=column["h"], gate=column["gate"], **{name: header[name] for name in _COMMON}, **blocks
    )

"""A snapshot is what is saved of an engine, or of a bank with its baseline.

Bytes of a saved engine: magic, version, header (JSON), settings, state, CRC-32 of all that.

magic  8 bytes  b"FLTEAENG"
u32    version of this layout and of the native state's
u32    length of the header, u32 of the state (all little endian)
header {"instruction_set", "lanes", "settings_hash"}
state  the native engine's own bytes
u32    CRC-32 of everything before
"""

import hashlib
import json
import math
import struct
import zlib
from typing import Any, NamedTuple

import msgspec

from fltea import _native
from fltea.estimator.belief import Belief
from fltea.estimator.lane_settings import LaneSettings
from fltea.records.arrays import Array
from fltea.settings.estimator import LARGEST

MAGIC = b"FLTEAENG"
VERSION = 2
_HEAD = struct.Struct("<8sIII")
_CRC = struct.Struct("<I")


MOST_RESTARTS = 1 << 52


class Saved(NamedTuple):
    """Holds the parts of an engine's snapshot."""

    lanes: int
    instruction_set: str
    settings_hash: str
    state: bytes

    def check(self, settings: LaneSettings) -> None:
        """Raise ValueError unless `settings` are those of the snapshot."""
        if _hash(settings, settings.table(self.lanes)) != self.settings_hash:
            raise ValueError("the snapshot was saved with other settings")


def pack(lanes: int, settings: LaneSettings, instruction_set: str, table: Array, state: bytes) -> bytes:
    """Return the bytes of an engine whose native side gave `state`; `table` is settings.table(lanes)."""
    fields = {"lanes": lanes, "instruction_set": instruction_set, "settings_hash": _hash(settings, table)}
    header = json.dumps(fields, sort_keys=True).encode()
    body = b"".join((_HEAD.pack(MAGIC, VERSION, len(header), len(state)), header, state))
    return body + _CRC.pack(zlib.crc32(body))


def unpack(data: bytes) -> Saved:
    """Return what `pack` put together; ValueError for anything else, with what is wrong."""
    if len(data) < _HEAD.size or not data.startswith(MAGIC):
        raise ValueError("these bytes are not a snapshot of an engine")
    _, version, header_size, state_size = _HEAD.unpack_from(data)
    if version != VERSION:
        raise ValueError(f"the snapshot has version {version}, this fltea reads version {VERSION}")
    end = _HEAD.size + header_size + state_size
    if len(data) != end + _CRC.size:
        raise ValueError(f"the snapshot should have {end + _CRC.size} bytes, it has {len(data)}")
    if _CRC.unpack_from(data, end)[0] != zlib.crc32(data[:end]):
        raise ValueError("the snapshot is damaged: its checksum is wrong")
    state_start = _HEAD.size + header_size
    try:
        header: dict[str, Any] = json.loads(data[_HEAD.size : state_start])
        lanes = int(header["lanes"])
        if not 1 <= lanes <= state_size:
            raise ValueError(f"it cannot have {lanes} lanes")
        return Saved(
            lanes=lanes,
            instruction_set=str(header["instruction_set"]),
            settings_hash=header["settings_hash"],
            state=data[state_start:end],
        )
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        # Only bytes that somebody made on purpose come so far.
        raise ValueError(f"not a snapshot of this version of the engine: {error}") from error


def _hash(settings: LaneSettings, table: Array) -> str:
    """Return a text that is equal for settings that make equal engines."""
    kind = json.dumps(settings.kind, sort_keys=True).encode()
    return hashlib.sha256(kind + table.astype("<f8").tobytes()).hexdigest()


class OnlineState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Holds a saved baseline, and the filters that go on from it.

    R, Q: variances in use. tuned: axes whose variances are of a fit; beliefs: what came with them. engine:
    the filters with their memory. whiteness: what the innovations were like. supervisors: what the
    supervisors have seen.
    """

    axes: tuple[str, ...]
    bias_dps: tuple[float, ...]
    R: tuple[float, ...]
    restarts: dict[str, int]
    engine: bytes
    supervisors: bytes | None = None
    Q: tuple[float, ...] | None = None
    tuned: tuple[str, ...] = ()
    beliefs: dict[str, Belief] = {}
    whiteness: bytes | None = None

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise ValueError, with what is wrong, unless its plain numbers are sound and of these axes."""
        if self.axes != axes:
            raise ValueError(f"it is of the axes {', '.join(self.axes)}")
        for name, values in (("bias_dps", self.bias_dps), ("R", self.R), ("Q", self.Q)):
            if values is not None and len(values) != len(axes):
                raise ValueError(f"its {name} has {len(values)} numbers for {len(axes)} axes")
        for axis, bias, R in zip(axes, self.bias_dps, self.R, strict=True):
            if not abs(bias) <= _native.LARGEST_OFFSET:
                raise ValueError(f"its bias of {axis} cannot be ({bias:g})")
            if not (math.isfinite(R) and 1 / LARGEST <= R <= LARGEST):
                raise ValueError(f"its R of {axis} is no variance ({R:g})")
        for axis, Q in zip(axes, self.Q or (), strict=False):
            if not 0 <= Q <= LARGEST:
                raise ValueError(f"its Q of {axis} is no variance ({Q:g})")
        for axis in self.tuned:
            if axis not in axes:
                raise ValueError(f"it has a tuning of {axis!r}, which is none of its axes")
        for axis, belief in self.beliefs.items():
            if axis not in self.tuned or not belief.is_sound:
                raise ValueError(f"{axis} cannot go on with {belief}")
        for axis, count in self.restarts.items():
            if axis not in axes:
                raise ValueError(f"it has restarts of {axis!r}, which is none of its axes")
            if not 0 <= count <= MOST_RESTARTS:
                raise ValueError(f"it has {count} restarts of {axis}")

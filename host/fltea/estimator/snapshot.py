"""Define the saved state of a bank of filters: its baseline, and its engine with the engine's settings."""

import math
import zlib

import msgspec

from fltea import _native
from fltea.estimator.filter_model import FilterModel
from fltea.settings.estimator import LARGEST

MOST_RESTARTS = 1 << 52


# Why more than 12 attributes: each is one part of the state that is saved and restored as a whole.
class OnlineState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A saved baseline, and the filters that continue from it.

    `R`, `Q`: variances of the filters. `tuned`: axes whose R and Q came from a fit. `filter_models`: orders
    and parameters from that fit. `engine`: state of the native filters with their memory. `checksum`: CRC-32
    of `engine`. `instruction_set`: instruction set with which the filters ran. `settings`:
    `LaneSettings.digest` of the engine's settings. `whiteness`: sums over the innovations, for the test of
    whiteness. `supervisors`: state of the supervisors, which restart filters that diverge.
    """

    axes: tuple[str, ...]
    bias_dps: tuple[float, ...]
    R: tuple[float, ...]
    restarts: dict[str, int]
    engine: bytes
    checksum: int
    instruction_set: str
    settings: str
    supervisors: bytes | None = None
    Q: tuple[float, ...] | None = None
    tuned: tuple[str, ...] = ()
    filter_models: dict[str, FilterModel] = {}
    whiteness: bytes | None = None

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise ValueError, with the reason, unless the state is undamaged, valid and made for `axes`."""
        if self.axes != axes:
            raise ValueError(f"it was saved for the axes {', '.join(self.axes)}")
        if zlib.crc32(self.engine) != self.checksum:
            raise ValueError("it is damaged: its checksum is wrong")
        for name, values in (("bias_dps", self.bias_dps), ("R", self.R), ("Q", self.Q)):
            if values is not None and len(values) != len(axes):
                raise ValueError(f"its {name} has {len(values)} numbers for {len(axes)} axes")
        for axis, bias, R in zip(axes, self.bias_dps, self.R, strict=True):
            if not abs(bias) <= _native.LARGEST_OFFSET:
                raise ValueError(f"its bias of {axis} is impossible ({bias:g})")
            if not (math.isfinite(R) and 1 / LARGEST <= R <= LARGEST):
                raise ValueError(f"its R of {axis} is no variance ({R:g})")
        for axis, Q in zip(axes, self.Q or (), strict=False):
            if not 0 <= Q <= LARGEST:
                raise ValueError(f"its Q of {axis} is no variance ({Q:g})")
        for axis in self.tuned:
            if axis not in axes:
                raise ValueError(f"it has a tuning of {axis!r}, which is none of its axes")
        for axis, filter_model in self.filter_models.items():
            if axis not in self.tuned or not filter_model.is_sound:
                raise ValueError(f"the filters of {axis} cannot continue with {filter_model}")
        for axis, count in self.restarts.items():
            if axis not in axes:
                raise ValueError(f"it has restarts of {axis!r}, which is none of its axes")
            if not 0 <= count <= MOST_RESTARTS:
                raise ValueError(f"it has {count} restarts of {axis}")

"""What a bank needs to go on where another one stopped."""

import math

import msgspec

from fltea import _native
from fltea.estimator.engine_settings import LARGEST

MOST_RESTARTS = 1 << 52


class OnlineState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A baseline and what stands behind it, saved.

    R, Q: variances in use. tuned: axes whose variances are of a fit. engine: the filters with their memory.
    supervisors: what they have seen.
    """

    axes: tuple[str, ...]
    bias_dps: tuple[float, ...]
    R: tuple[float, ...]
    restarts: dict[str, int]
    engine: bytes
    supervisors: bytes | None = None
    Q: tuple[float, ...] | None = None
    tuned: tuple[str, ...] = ()

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise ValueError, with what is wrong, unless the plain part of it is sound and of these axes."""
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
        for axis, count in self.restarts.items():
            if axis not in axes:
                raise ValueError(f"it has restarts of {axis!r}, which is none of its axes")
            if not 0 <= count <= MOST_RESTARTS:
                raise ValueError(f"it has {count} restarts of {axis}")

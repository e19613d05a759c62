"""Converts the counts of IIO channels by scale, offset and mount matrix."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Conversion(NamedTuple):
    """Converts the counts of a sensor's axes, (n, axes), to the values that records hold.

    There are two cases:
        The values are still whole counts if all axes have one scale, all offsets are whole numbers, and the
            mount matrix only swaps axes or changes signs. `lsb` is the number of counts per unit.
        Otherwise the values are in the unit (deg/s or m/s²), and `lsb` is None.

    `offset`: numbers that are added to the counts first, (axes,). `matrix`: matrix that is applied then,
    (axes, axes): the mount matrix. It includes the scale if `lsb` is None.
    """

    lsb: float | None
    matrix: NDArray[np.float64]
    offset: NDArray[np.float64]

    def __call__(self, counts: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the converted values, (n, axes).

        The values are counts if `lsb` is a number. If `lsb` is None, they are in the unit.
        """
        values: NDArray[np.float64] = (counts + self.offset) @ self.matrix.T
        return values


def conversion(
    scales: Sequence[float], offsets: Sequence[float], mount: NDArray[np.float64] | None
) -> Conversion:
    """Return the conversion for axes with the given scales [units per count] and offsets [counts].

    `mount`: mount matrix, (3, 3): the rotation from the sensor's axes to the axes of the machine in which the
    sensor is mounted. It is ignored if there are fewer than three axes.

    Raises:
        ValueError: a scale is not positive and finite, or the mount matrix is not a rotation.
    """
    if not all(math.isfinite(scale) and scale > 0 for scale in scales):
        raise ValueError(f"scale {', '.join(f'{scale:g}' for scale in scales)} is not positive and finite")
    if not all(map(math.isfinite, offsets)):
        raise ValueError("an offset is not finite")
    turn = np.eye(len(scales))
    if mount is not None and len(scales) == 3:
        if not np.allclose(mount @ mount.T, np.eye(3), atol=0.05) or np.linalg.det(mount) < 0:
            raise ValueError(
                f"mount matrix {mount.tolist()} is no rotation; correct it in the device tree, or leave the "
                "axes as the chip has them: 'iio:NAME?mount=off'"
            )
        turn = mount
    swaps = bool((np.sort(np.abs(turn), axis=1) == [0.0] * (len(scales) - 1) + [1.0]).all())
    if swaps and len(set(scales)) == 1 and all(offset.is_integer() for offset in map(float, offsets)):
        return Conversion(1.0 / scales[0], turn, np.array(offsets, dtype=np.float64))
    return Conversion(None, turn * np.array(scales), np.array(offsets, dtype=np.float64))


def parse_mount(text: str) -> NDArray[np.float64] | None:
    """Return a mount matrix from a text such as `1, 0, 0; 0, 1, 0; 0, 0, 1`; None for an empty text.

    Raises:
        ValueError: the text is not such a matrix.
    """
    if text.strip() in ("", "(null)"):
        return None
    rows = [row.replace(",", " ").split() for row in text.strip().split(";")]
    if [len(row) for row in rows] != [3, 3, 3]:
        raise ValueError(f"mount matrix '{text.strip()}' is no 3 x 3 matrix")
    return np.array([[float(number) for number in row] for row in rows])

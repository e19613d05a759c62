"""Pieces of .npy files: some rows each, behind a header that says how many."""

import io
import math
import struct
from itertools import pairwise
from typing import Any

import numpy as np

from fltea.cluster.cut import Cut, Ranges
from fltea.recording.npz_arrays import read_header

HEAD_BYTES = 1 << 16


def cuts(source: Ranges, block_bytes: int) -> list[Cut]:
    """Return where it may be cut; nowhere if its columns lie one after the other, or it is damaged."""
    try:
        found = read_header(io.BytesIO(source.read(0, HEAD_BYTES)), source.file.url)
    except (ValueError, struct.error):
        return []
    shape, by_columns, dtype, begin = found
    if not shape or (by_columns and len(shape) > 1) or dtype.hasobject:
        return []
    row_bytes = math.prod(shape[1:]) * dtype.itemsize
    if row_bytes == 0 or begin + shape[0] * row_bytes != source.size:
        return []
    pieces = max(1, math.ceil(shape[0] * row_bytes / block_bytes))
    rows = [round(shape[0] * k / pieces) for k in range(pieces + 1)]
    return [
        Cut(begin + first * row_bytes, begin + last * row_bytes, _head((last - first, *shape[1:]), dtype))
        for first, last in pairwise(rows)
    ]


def _head(shape: tuple[int, ...], dtype: "np.dtype[Any]") -> bytes:
    out = io.BytesIO()
    descr = np.lib.format.dtype_to_descr(dtype)
    np.lib.format.write_array_header_2_0(out, {"descr": descr, "fortran_order": False, "shape": shape})
    return out.getvalue()

"""Run the filters' native memories of past samples from Python.

tests/native/probe.cpp is built once for each instruction set.
"""

import ctypes
import weakref
from functools import lru_cache

import numpy as np
from fltea.estimator.engine import instruction_sets
from fltea.records.arrays import Array
from numpy.typing import ArrayLike

from tests.rig.built import DOUBLES, probe

SETS = instruction_sets()
"""Instruction sets that this processor supports."""
DIRECT = -1
"""Value of `digits` that selects the exact memory instead of a compressed memory."""


@lru_cache
def library(instruction_set: str) -> ctypes.CDLL:
    """Load the probe of one instruction set; build it first if it is out of date."""
    size, pointer = ctypes.c_size_t, ctypes.c_void_p
    return probe(
        f"probe-{instruction_set}",
        ("probe_make", pointer, ctypes.c_char, ctypes.c_int, size),
        ("probe_free", None, pointer),
        ("probe_lanes", ctypes.c_int, pointer),
        ("probe_reset", None, pointer),
        ("probe_push", None, pointer, size, pointer, pointer),
        ("probe_evaluate", None, pointer, DOUBLES, DOUBLES, DOUBLES),
        ("probe_sums", None, pointer, DOUBLES, DOUBLES, DOUBLES),
        ("probe_stir", None, pointer, size, ctypes.c_uint64),
        ("probe_bytes", size, pointer),
        ("probe_seconds", ctypes.c_double, pointer, size),
        ("probe_nodes", None, pointer, DOUBLES),
        ("probe_math", None, ctypes.c_char, size, DOUBLES, DOUBLES, DOUBLES, DOUBLES),
    )


class Memory:
    """A filter's memory of past samples. `digits`: number of accurate digits, or DIRECT for the exact memory.

    The memory reaches back L samples, or to the beginning if L is 0. Results have the shape (lanes,), one
    value for each filter that runs in parallel.

    `kind`: number type; f: float, d: double, w: a SIMD pack that fills a register.
    """

    def __init__(
        self, digits: int, window: int = 0, kind: str = "d", instruction_set: str | None = None
    ) -> None:
        self._library = library(instruction_set or SETS[0])
        self._probe = self._library.probe_make(kind.encode(), digits, window)
        weakref.finalize(self, self._library.probe_free, self._probe)
        self.lanes: int = self._library.probe_lanes(self._probe)

    def _rows(self, values: ArrayLike, n: int) -> Array:
        """Return n numbers, repeated for all filters that run in parallel (lanes), as an array of shape (n,
        lanes).
        """
        return np.repeat(np.asarray(values, dtype=np.float64).reshape(n, 1), self.lanes, 1)

    def push(self, x: ArrayLike, P: ArrayLike) -> None:
        """Append samples, the oldest first. An array of shape (n,) gives all filters the same samples."""
        n = len(np.atleast_1d(x))
        x, P = self._rows(x, n), self._rows(P, n)
        self._library.probe_push(self._probe, n, x.ctypes.data, P.ctypes.data)

    def push_zeros(self, n: int) -> None:
        self._library.probe_push(self._probe, n, None, None)

    def stir(self, n: int, seed: int) -> None:
        """Append n random states to the memory, each with the variance of its error.

        The states have a variance of about 1. The error variances are between 0.5 and 1.5.
        """
        self._library.probe_stir(self._probe, n, seed)

    def sums(self, order: ArrayLike) -> tuple[Array, Array]:
        """Return two weighted sums over the memory: of the states, and of their error variances. `order`: the
        order from which the weights follow.
        """
        S, V = np.empty(self.lanes), np.empty(self.lanes)
        orders = np.full(self.lanes, order, dtype=np.float64)
        self._library.probe_sums(self._probe, orders, S, V)
        return S, V

    def evaluate(self, orders: ArrayLike) -> tuple[Array, Array]:
        """Return the weighted sums of the states for three orders, of shape (3, lanes). For the first
        order, also return the weighted sum of the error variances, of shape (lanes,). Each lane is one of
        the filters that run in parallel.
        """
        S, V = np.empty((3, self.lanes)), np.empty(self.lanes)
        self._library.probe_evaluate(self._probe, self._rows(orders, 3), S, V)
        return S, V

    def reset(self) -> None:
        self._library.probe_reset(self._probe)

    @property
    def modes(self) -> tuple[int, int]:
        """Return how many exponentials (modes) the memory uses for the sum of states, and how many for the
        sum of variances.

        The length of the memory and `digits` determine both numbers.
        """
        out = np.zeros(3)
        self._library.probe_nodes(self._probe, out)
        return int(out[0]), int(out[1])


def math(kind: str, x: Array, instruction_set: str | None = None) -> tuple[Array, Array, Array]:
    """Return e^x, e^-x and sin(pi x) as native code computes them (pack_math.hpp). `kind`: as in `Memory`."""
    native = library(instruction_set or SETS[0])
    padded = np.concatenate((x, np.zeros(-len(x) % 8)))
    up, down, sine = (np.empty_like(padded) for _ in range(3))
    native.probe_math(kind.encode(), len(padded), padded, up, down, sine)
    return up[: len(x)], down[: len(x)], sine[: len(x)]

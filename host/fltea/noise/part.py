"""What every part of a noise has, and what the native table says of it (pure).

The table is `kTable` in host/native/sentence_parts.hpp: the number of each part, its coordinates, and what
it is like. Whatever is done with parts by what they are like asks here for the traits of the table.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import msgspec

from fltea import _native
from fltea.records.arrays import Array, Complex

SIGNED = ("f", "s", "d")
"""Parameters that may be below 0."""


class Coordinate(NamedTuple):
    """A coordinate of a part in the native fits."""

    kind: str
    """What it is, as the enum `Value` of the table says."""
    low: float
    high: float
    """The bounds of an order or of a number."""


class Row(NamedTuple):
    """What the native table says of a part."""

    code: int
    """Its number there."""
    name: str
    coordinates: tuple[Coordinate, ...]
    traits: frozenset[str]
    """What it is like, as the enum `Trait` of the table says."""
    says: str
    """To which question of the verdict it is the answer, as the enum `Says` of the table says."""
    sought: int
    """How many parameters BIC counts beside the coordinates."""


def _row(code: int, name: str, coordinates: list[tuple[str, float, float]], *rest: object) -> Row:
    traits, says, sought = rest
    assert isinstance(traits, list)
    assert isinstance(says, str)
    assert isinstance(sought, int)
    return Row(code, name, tuple(Coordinate(*one) for one in coordinates), frozenset(traits), says, sought)


ROWS: tuple[Row, ...] = tuple(_row(code, *one) for code, one in enumerate(_native.noise_parts()))
"""All rows by the numbers of their parts; those with the trait "other" are parts by other coordinates."""
BY_NAME = {row.name: row for row in ROWS}


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="part"):
    """The base of all parts."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if not math.isfinite(value):
                raise ValueError(f"{name} must be a finite number, got {value}")
            if value < 0 and name not in SIGNED:
                raise ValueError(f"{name} must be 0 or more, got {value}")

    @classmethod
    def tag(cls) -> str:
        """Return the name of the part, in files and in the native table."""
        return str(cls.__struct_config__.tag)

    @classmethod
    def row(cls) -> Row:
        """Return what the native table says of the part."""
        return BY_NAME[cls.tag()]

    @classmethod
    def has(cls, trait: str) -> bool:
        """Return whether the part is like this, by a name of the enum `Trait` of the table."""
        return trait in cls.row().traits

    @property
    def code(self) -> int:
        """The number of the part in the native module."""
        return self.row().code

    def eta(self, h: float) -> list[float]:
        """Return the coordinates of the native fits.

        Raises:
            ValueError: an order that is not stationary.
        """
        raise NotImplementedError(f"the part {self.tag()} has no coordinates")

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        """Return the part that has these coordinates."""
        raise NotImplementedError(f"the part {cls.tag()} is of no coordinates")

    def words(self, rate_hz: float) -> str:
        """Return what the part is called in a sentence; nothing if that is said elsewhere in it.

        rate_hz: sample rate, beside which a corner may be far away.
        """
        raise NotImplementedError(f"the part {self.tag()} has no words")

    def response(self, lam: Array, h: float) -> Complex:
        """Return the response at λ of a slow part to the white noise of variance 1 that drives it."""
        raise NotImplementedError(f"the part {self.tag()} has no response")

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        """Return the poles of a part that is no filter, or the ones that stand for it.

        lam: at which λ it matters; room: the number of coordinates that there may be.
        """
        raise NotImplementedError(f"the part {self.tag()} has no poles")

    def filter_poles(self, h: float) -> tuple[list[complex], int]:
        """Return the poles of a filter, the upper ones of pairs, and the number of its taps beside them."""
        raise NotImplementedError(f"the filter {self.tag()} has no poles")

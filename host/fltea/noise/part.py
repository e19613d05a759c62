"""The base class of the parts of a noise, and the table of the parts' properties from native code.

The table is `kTable` in host/native/whittle_parts.hpp. It holds the code number, the free parameters and the
traits of each part. A trait is a property, such as "slow", by which other code decides how to treat a part.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, NamedTuple, Self

import msgspec

from fltea import _native
from fltea.records.arrays import Array, Complex
from fltea.records.fit import VerdictKind

SIGNED = ("f", "s", "d")
"""Names of those parameters of noise parts whose values may be below 0."""


class FreeParameter(NamedTuple):
    """A free (transformed) parameter of a part in the native fits."""

    kind: str
    """Kind of the parameter: a name of the enum `Value` of the native table."""
    low: float
    high: float
    """`low`, `high`: bounds of the parameter, if they do not follow from the data. The comments of the enum
    `Value` say which kinds use them, and how.
    """


class Row(NamedTuple):
    """A row of the native table, which describes one part."""

    code: int
    """The number of this kind of part in the native table."""
    name: str
    free_parameters: tuple[FreeParameter, ...]
    traits: frozenset[str]
    """Traits of the part: names of the enum `Trait` of the native table."""
    says: str
    """Question of the verdict that a part of this kind answers in a model without an order, such as `drift`:
    a name of the enum `Says` of the native table.
    """
    sought: int
    """Number of parameters that the information criterion BIC counts for the part in addition to its free
    ones.
    """


def _row(code: int, name: str, free_parameters: list[tuple[str, float, float]], *rest: object) -> Row:
    traits, says, sought = rest
    assert isinstance(traits, list)
    assert isinstance(says, str)
    assert isinstance(sought, int)
    return Row(
        code, name, tuple(FreeParameter(*one) for one in free_parameters), frozenset(traits), says, sought
    )


ROWS: tuple[Row, ...] = tuple(_row(code, *one) for code, one in enumerate(_native.noise_parts()))
"""All rows of the native table, in the order of the parts' numbers. A row with the trait "other" describes
the same noise as another row, by other parameters.
"""
BY_NAME = {row.name: row for row in ROWS}


class OwnAnswer(NamedTuple):
    """The verdict if a part answers a question of its own (`Says` of its row) and no other rule is needed.

    The verdict's sentence consists of the words for the parts of the model.
    """

    verdict: VerdictKind
    next_step: str
    """A sentence that says what to do."""


class Symbol(NamedTuple):
    """How a table shows a parameter of a part."""

    name: str
    unit: str
    """Unit of the parameter, in which `{unit}` stands for that of the samples; "" if it has none."""


VARIANCE = "({unit})²"


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="part"):
    """The base class of all parts.

    `answer`: the verdict if the part is in the model; None if `spectrum.answers` has a rule for its question.
    `symbols`: how tables show each field of the part.
    """

    answer: ClassVar[OwnAnswer | None] = None
    symbols: ClassVar[dict[str, Symbol]] = {}

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if not math.isfinite(value):
                raise ValueError(f"{name} must be a finite number, got {value}")
            if value < 0 and name not in SIGNED:
                raise ValueError(f"{name} must be 0 or more, got {value}")

    @classmethod
    def tag(cls) -> str:
        """Return the name that the part has in files and in the native table."""
        return str(cls.__struct_config__.tag)

    @classmethod
    def row(cls) -> Row:
        """Return the row of the part in the native table."""
        return BY_NAME[cls.tag()]

    @classmethod
    def has(cls, trait: str) -> bool:
        """Return whether the part has the trait `trait`, such as "slow". The module says what traits are."""
        return trait in cls.row().traits

    @property
    def code(self) -> int:
        """The number of the part in the native module."""
        return self.row().code

    def eta(self, h: float) -> list[float]:
        """Return the part's parameters, transformed to the free ones of the native fits.

        `h`: sampling period [s].

        Raises:
            ValueError: the part is an order that is not stationary.
        """
        raise NotImplementedError(f"the part {self.tag()} cannot be converted to free parameters")

    @classmethod
    def of_eta(cls, eta: Sequence[float], h: float) -> Self:
        """Return the part whose free parameters in the native fits are `eta`. `h`: sampling period [s]."""
        raise NotImplementedError(f"the part {cls.tag()} cannot be made from free parameters")

    def words(self, rate_hz: float) -> str:
        """Return words that describe the part in a sentence; "" if another sentence of the verdict names it.

        `rate_hz`: sample rate. If a corner frequency is above half of it, the words say so.
        """
        raise NotImplementedError(f"the part {self.tag()} has no words for a sentence")

    def response(self, lam: Array, h: float) -> Complex:
        """Return the frequency response at λ that makes this part from white noise of variance 1.

        Only parts with the trait "slow" have one.
        """
        raise NotImplementedError(f"the part {self.tag()} has no frequency response")

    def own_poles(self, lam: Array, h: float, room: int) -> list[complex]:
        """Return poles with which states can describe or approximate the part. The part must be no filter.

        `lam`: frequencies λ [rad per sample] at which the states have to fit. `room`: largest number of
        states.
        """
        raise NotImplementedError(f"the part {self.tag()} has no poles")

    def filter_poles(self, h: float) -> tuple[list[complex], int]:
        """Return a filter's poles, and its number of taps.

        A complex pair of poles is given by the one with imaginary part ≥ 0.
        Taps are the coefficients of a weighted sum of samples, which a filter may contain besides its poles.
        """
        raise NotImplementedError(f"the filter {self.tag()} has no poles")


def in_hz(value: float) -> str:
    """Return words for a frequency, with three digits at most."""
    return f"{value:.3g} Hz"

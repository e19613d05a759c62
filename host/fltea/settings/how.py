"""How to read a recording that does not say it itself."""

from typing import Literal

import msgspec

TimeUnit = Literal["s", "ms", "us", "ns"]


class How(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the user says of a recording; None: the file is to tell.

    columns, units, rate_hz, time_column, time_unit: of text and tables. topic: of bags.
    """

    columns: list[str] | None = None
    units: str | None = None
    rate_hz: float | None = None
    time_column: str | None = None
    time_unit: TimeUnit | None = None
    topic: str | None = None

    @property
    def of_text(self) -> bool:
        """Whether anything is said that only text and tables need."""
        return bool(self.columns or self.units or self.rate_hz or self.time_column or self.time_unit)


AS_IT_SAYS = How()

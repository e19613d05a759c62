"""What several tasks counted, added up (pure)."""

from collections.abc import Sequence
from typing import TypeVar

import msgspec

Counted = TypeVar("Counted", bound=msgspec.Struct)


def add_up(parts: Sequence[Sequence[Counted]], counts: Sequence[str]) -> tuple[Counted, ...]:
    """Add the fields `counts` of rows that are alike in all others.

    The sums come in the order in which the first of each appears.
    """
    sums: dict[tuple[object, ...], Counted] = {}
    for one in (one for part in parts for one in part):
        key = tuple(getattr(one, name) for name in one.__struct_fields__ if name not in counts)
        before = sums.get(key)
        if before is not None:
            added = {name: getattr(before, name) + getattr(one, name) for name in counts}
            one = msgspec.structs.replace(before, **added)
        sums[key] = one
    return tuple(sums.values())

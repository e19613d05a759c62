"""How many samples a recording holds, and what became of them."""

import msgspec


class Counts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the recording holds, and how much of it is used.

    samples: all that arrived. used: those of the rate and scale that most of them have; the first is number
    `used_from` of all. stretches: pieces between breaks, of all. bridged: lost samples between those used
    that others stand for. lost, gaps, duplicates, before_hello, rate_differs: as in `stats`. late,
    retried, saturated: samples used that the device flagged so.
    """

    samples: int
    used: int
    used_from: int
    stretches: int
    bridged: int
    lost: int
    gaps: int
    duplicates: int
    before_hello: int
    rate_differs: int
    late: int
    retried: int
    saturated: int

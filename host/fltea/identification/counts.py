"""Count the samples of a recording, and what became of them."""

import msgspec


# Over 12 attributes: each is one published count of samples.
class Counts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Number of samples in the recording, and how many of them are used.

    Attributes:
        samples: all samples that arrived.
        used: samples that have the rate and the scale of most samples.
        used_from: index of the first used sample among all samples.
        stretches: number of parts without a break, among all samples.
        bridged: lost samples, within the used ones, that drawn samples stand in for.
        lost, gaps, duplicates, before_hello, rate_differs: as in `stats`.
        late, retried, saturated: used samples that the device flagged so.
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

"""Numbers of the samples of a recording: how many arrived, were used, or were lost."""

import msgspec


# Why more than 12 attributes: each is one published count of samples.
class Counts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Number of samples in the recording, and how many of them are used.

    Attributes:
        samples: all samples that arrived.
        used: samples that are analysed: those with the most frequent rate and scale.
        used_from: index of the first used sample among all samples.
        stretches: number of stretches (parts without a gap) of all samples together.
        bridged: lost samples between used ones that were replaced by random samples.
        lost, gaps, duplicates, before_hello, rate_differs: as in the record `stats`.
        late, retried, saturated: used samples that the device marked as late, retried or saturated.
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

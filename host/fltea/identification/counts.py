"""Numbers of the samples of a recording: how many arrived, were used, or were lost."""

import msgspec


# Why more than 12 attributes: each is one published count of samples.
class Counts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Number of samples in the recording, and how many of them are used.

    Attributes:
        samples: all samples that arrived.
        used: samples that are analysed, since they have the rate and the scale that most samples have.
        used_from: index of the first used sample among all samples.
        stretches: number of parts without a break into which all samples fall.
        bridged: lost samples between used ones that were replaced by random samples.
        lost, gaps, duplicates, before_hello, rate_differs: as in `stats`.
        late, retried, saturated: used samples that the device marked with this word.
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

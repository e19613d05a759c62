"""Counts in how many noises each part of a noise model is found in place of other, true parts.

A new part may describe noises that are made of other parts, with fewer parameters than these. Then a search
finds it in their place, and the verdict names it. Some noises of any kind are taken for another one by
chance, so the tests count them.
"""

from collections import Counter
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from fltea.identification.sums import examined
from fltea.noise import parts as p
from fltea.spectrum.verdict import decide, winner

from tests.rig.identify_support import H
from tests.rig.random_noises import drawn
from tests.rig.tiers import long
from tools.validation.closed_form import samples
from tools.validation.coverage.populations import POPULATIONS

LONGEST = 20_000
"""Largest number of samples of a noise that is made of random parts (see MIXED)."""
MIXED = 6
"""Noises are drawn once from each population (a kind of noise with random parameters). Each time, this many
noises of random parts are drawn, too.
"""
IN_MODELS: dict[type[p.Part], float] = {
    p.Relaxation: 0.15,  # in half a minute, relaxations fit a noise with an order as well
    # this filter differs from two other filters, from quantisation and from a steep rise at the highest
    # frequencies only
    p.Sharpening: 0.15,
}
"""Limits that replace USUAL for some kinds of part, and the reasons."""
IN_VERDICTS: dict[type[p.Part], float] = {}
"""Limits that replace SAID, in the same way; no part needs one so far."""
USUAL, SAID = 0.05, 0.03
"""Limits for each kind of part. They are proportions of the simulated noises that have no such part. USUAL:
noises whose model has such a part, and lacks a true part. SAID: noises whose verdict names such a part.
"""


class Found(NamedTuple):
    """What was found in one noise."""

    name: str
    """Name of the population from which the noise was drawn, or "a mixture" if it is made of random parts."""
    truth: frozenset[type[p.Part]]
    model: frozenset[type[p.Part]]
    """The parts of the model that the verdict chooses."""
    says: frozenset[str]
    """Names of the questions that the verdict answers with yes, such as "drift". Empty if the verdict
    claims an order, or nothing but white noise.
    """

    @property
    def lost(self) -> frozenset[type[p.Part]]:
        """The parts of the noise that the model lacks. A `Floor` (white noise after all filters) does not
        count, since it is often too faint to be seen.
        """
        return self.truth - self.model - {p.Floor}


def found(name: str, parts: list[p.Part], n: int, rng: np.random.Generator) -> Found:
    e = examined(samples(parts, n, H, rng), H).evidence
    verdict = decide(e)
    silent = verdict.has_order or verdict.kind in ("white", "undecided", "not stationary")
    model = frozenset(winner(e, verdict).kinds)
    return Found(name, frozenset(map(type, parts)), model, frozenset() if silent else e.reading.says)


@cache
def all_found(seeds: int) -> tuple[Found, ...]:
    seen = []
    for seed in range(seeds):
        for name, population in POPULATIONS.items():
            rng = np.random.default_rng((61, seed))
            seen.append(found(name, list(population.draw(rng)), population.shortest, rng))
        for k in range(MIXED):
            rng = np.random.default_rng((62, seed, k))
            parts, n = drawn(rng)
            seen.append(found("a mixture", parts, min(n, LONGEST), rng))
    return tuple(seen)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [12, long(60)])
@pytest.mark.parametrize("kind", p.CODES[1:], ids=lambda kind: kind.tag())
def test_a_part_takes_little_from_the_others(kind: type[p.Part], seeds: int) -> None:
    """A model rarely has a part that the noise lacks. If this test fails for a part, there are two remedies
    (host/CHANGING.md):

        - The part gets the trait `kApart` in whittle_parts.hpp, and is added only in a separate search.
        - The verdict's sentence about the part is made true of the replaced parts, too, and IN_MODELS, or
          IN_VERDICTS, gets the part's limit and the reason.
    """
    others = [one for one in all_found(seeds) if kind not in one.truth]
    question = kind.row().says
    models = [kind in one.model and bool(one.lost) for one in others]
    verdicts = [
        kind in one.model and question in one.says and question not in {of.row().says for of in one.truth}
        for one in others
    ]
    hit = [one for one, *is_so in zip(others, models, verdicts, strict=True) if any(is_so)]
    told = "; ".join(
        f"{count} of {name} lose {', '.join(sorted(of.tag() for of in lost)) or 'nothing'}"
        for (name, lost), count in Counter((one.name, one.lost) for one in hit).most_common()
    )
    in_models, said = float(np.mean(models)), float(np.mean(verdicts))
    assert in_models <= IN_MODELS.get(kind, USUAL), f"{kind.tag()} in models: {told}"
    assert said <= IN_VERDICTS.get(kind, SAID), f"{kind.tag()} in verdicts: {told}"

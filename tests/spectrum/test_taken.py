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
"""Largest number of samples of a mixture of random parts."""
MIXED = 6
"""Number of mixtures of random parts for each noise of a population."""
IN_MODELS: dict[type[p.Part], float] = {
    p.Relaxation: 0.15,  # in a record of half a minute, an order cannot be told from relaxations
    # only the highest frequencies tell this filter from two other filters, from quantisation or a steep rise
    p.Sharpening: 0.15,
}
"""Limits for some parts, in place of the limit USUAL: largest proportion of the noises without the part whose
model has the part in place of a true one.
"""
USUAL, SAID = 0.05, 0.03
"""Noises without a certain part are simulated and judged. USUAL: largest proportion of these noises whose
model has that part in place of a true one. SAID: largest proportion whose verdict names that part.
"""


class Found(NamedTuple):
    """What was found in one noise."""

    name: str
    """Name of the noise's population."""
    truth: frozenset[type[p.Part]]
    model: frozenset[type[p.Part]]
    """The parts of the model that the verdict chooses."""
    says: frozenset[str]
    """The questions about the model without an order to which the verdict says yes."""

    @property
    def lost(self) -> frozenset[type[p.Part]]:
        """The parts of the noise that the model lacks. A floor does not count, since it is often too faint to
        be seen.
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
    """A model rarely has a part that the noise lacks. A part that replaces true parts more often than the
    limits allow needs the trait `kApart` in its row of `kTable` (whittle_parts.hpp). Or it needs a sentence
    in the verdict that is true of the replaced parts, too, and a row in `IN_MODELS` with the reason
    (host/CHANGING.md).
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
    assert said <= SAID, f"{kind.tag()} in verdicts: {told}"

"""A verdict asks questions about the best model without an order, such as whether the noise drifts. For each
kind of part, there is one question to which the answer is yes if the model has such a part, alone or with
other parts.
"""

from copy import copy

import numpy as np
import pytest
from fltea.identification.sums import examined
from fltea.noise import parts as p
from fltea.spectrum import median_words
from fltea.spectrum.answers import ANSWERS
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.median_filter import MedianFilter
from fltea.spectrum.reading import Reading, read

from tests.rig.identify_support import H, white
from tests.rig.model_support import EXAMPLES, bins

SAMPLES = 200_000
FAINT = p.Resonance(0.1, 5.0, 4.0)
"""A resonance that hardly raises the density of white noise of variance 1."""
SAID = [kind for kind in p.CODES if kind.row().says not in ("nothing", "order")]


def reading_of(*parts: p.Part) -> Reading:
    """Return what `read` finds if the best model consists of white noise and these parts."""
    noise = [p.White(1.0), *parts]
    f = copy(CandidateModels(bins(noise, SAMPLES, H, None), H, 0))
    codes, eta = [part.code for part in noise], [x for part in noise for x in part.eta(H)]
    f.plain = FittedModel(tuple(codes), tuple(eta), f.plain.nll)
    return read(f, float(f.data.lam[0]) / (2 * np.pi * H), apart=6.0)


def test_a_faint_resonance_is_told_where_it_is_all_that_is_there() -> None:
    assert reading_of(FAINT).says == {"resonance"}


@pytest.mark.parametrize(
    "kind", [kind for kind in SAID if kind is not p.Resonance], ids=lambda kind: kind.tag()
)
def test_beside_any_other_part_a_faint_resonance_may_only_correct_its_shape(kind: type[p.Part]) -> None:
    alone, beside = reading_of(EXAMPLES[kind.tag()]), reading_of(EXAMPLES[kind.tag()], FAINT)
    assert alone.says == {kind.row().says}
    assert beside.says == alone.says, "the condition of resonances in host/fltea/spectrum/reading.py"
    assert beside.resonance is None


@pytest.fixture(scope="module")
def plain() -> Evidence:
    return examined(white(3_000, 1, 9)[0], H).evidence


@pytest.mark.parametrize("question", ANSWERS)
def test_a_median_filter_explains_no_slow_noise(question: str, plain: Evidence) -> None:
    e = plain._replace(median=MedianFilter(5, 0.3))
    found = Reading(frozenset({question}), (), None, None, None, False)
    slow = {kind.row().says for kind in p.SLOW} - {"relaxations"}
    assert median_words.explains(e, found) == (question not in slow)

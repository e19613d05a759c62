"""The table of noise parts is complete. If a new part lacks something, the test names what and where.

The tests go through the table (`kTable` in host/native/whittle_parts.hpp). So a new part is tested without a
change here; it only needs an example in tests/rig/model_support.py.
"""

import re

import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.noise.part import BY_NAME, ROWS, Part
from fltea.noise.system import system
from fltea.spectrum import wording
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.reading import read
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.host_support import ROOT
from tests.rig.identify_support import H
from tests.rig.model_support import EXAMPLES, PARTS, bins

LAM = np.geomspace(1e-4, np.pi, 300)
SAMPLES = 200_000
EXACT_SHARE = 0.06
"""Largest permitted relative error at low frequencies, for the spectrum of a linear system that approximates
a noise part.
"""

kinds = pytest.mark.parametrize("kind", p.CODES, ids=lambda kind: kind.tag())


def defines(kind: type[Part], method: str) -> bool:
    """Return whether the class of a noise part defines the method `method` itself. The base class's method
    only raises an error.
    """
    return getattr(kind, method).__qualname__ != getattr(Part, method).__qualname__


@kinds
def test_a_part_has_an_example_and_any_values_in_the_rig(kind: type[Part]) -> None:
    assert kind.tag() in EXAMPLES, f"{kind.tag()} has no row in EXAMPLES of tests/rig/model_support.py"
    assert kind is p.White or kind.tag() in PARTS, f"{kind.tag()} is not in PARTS of model_support.py"


@kinds
def test_a_part_has_all_that_a_model_asks_of_it(kind: type[Part]) -> None:
    needed = ["eta", "words", "filter_poles" if kind.has("filter") else "own_poles"]
    if kind.has("slow"):
        needed.append("response")
    if kind is not p.Mean:
        needed.append("of_eta")
    missing = [name for name in needed if not defines(kind, name)]
    assert not missing, f"{kind.__module__}.{kind.__name__} lacks {', '.join(missing)}"
    row = kind.row()
    assert len(row.free_parameters) == len(kind.__struct_fields__) - (kind is p.Mean), row
    assert row.says != "nothing" or kind in (p.White, p.Floor), f"the row of {row.name} says nothing"


@kinds
def test_each_parameter_of_a_part_has_a_symbol_and_a_unit(kind: type[Part]) -> None:
    """`fltea identify --details` shows the parameters by these symbols."""
    missing = [name for name in kind.__struct_fields__ if name not in kind.symbols]
    assert not missing, f"`symbols` of {kind.__module__}.{kind.__name__} lacks {', '.join(missing)}"
    for name, (_, unit) in kind.symbols.items():
        assert name in kind.__struct_fields__, f"{kind.__name__} has no field {name}"
        in_name = {"_hz": "Hz", "_s": "s"}.get(name[name.rfind("_") :] if "_" in name else "")
        assert in_name in (None, unit), f"{kind.__name__}.{name} is in {in_name}, and its symbol in {unit}"


DIMENSIONS: dict[str, tuple[float, float, float]] = {
    "": (0, 0, 0),
    "s": (0, 1, 0),
    "Hz": (0, -1, 0),
    "s^-α": (0, 0, -1),
    "{unit}": (1, 0, 0),
    "{unit}·s": (1, 1, 0),
    "{unit}/√s": (1, -0.5, 0),
    "({unit})²": (2, 0, 0),
    "({unit})²·s^-2α": (2, 0, -2),
}
"""For each unit of a parameter: the exponents of the samples' unit, and of the second, and what is added to
the latter for each α.
"""


@kinds
def test_the_unit_of_a_parameter_is_that_of_its_effect(kind: type[Part]) -> None:
    """With another unit of the samples and of time, the spectrum is the same noise's in these units."""
    size, time = 3.0, 0.7
    example = EXAMPLES[kind.tag()]
    values = {}
    for name, (_, unit) in kind.symbols.items():
        of_size, of_time, of_alpha = DIMENSIONS[unit]
        power = of_time + of_alpha * getattr(example, "alpha", 0.0)
        factor = size**of_size * time**power
        values[name] = getattr(example, name) * (factor if unit else 1)
    before = p.spectrum([p.White(1.0), example], LAM, H)
    after = p.spectrum([p.White(size**2), kind(**values)], LAM, H * time)
    np.testing.assert_allclose(after, size**2 * before, rtol=1e-6, err_msg=f"`symbols` of {kind.__name__}")


@kinds
def test_the_traits_of_a_row_are_those_of_the_spectrum(kind: type[Part]) -> None:
    is_filter, is_behind = kind.has("filter"), kind.has("behind")
    example = EXAMPLES[kind.tag()]
    some: list[Part] = [p.White(1.0), example] if is_filter else [example]
    low, lower, quarter, half = np.searchsorted(LAM, [1e-3, 1e-2, np.pi / 4, np.pi])
    S = p.spectrum(some, LAM, H)
    # The shape of the spectrum after a high-pass of one pole, at frequencies below the corner of the
    # high-pass.
    behind = S * np.abs(1 - np.exp(-1j * LAM)) ** 2
    doubled = [p.spectrum([p.White(R), example], LAM, H) for R in (2.0, 1.0)]
    wanted = {
        "slow": not is_filter and S[low] > 2 * S[half] and S.argmax() < lower,
        "rising": S[half] > 1.2 * S[quarter],
        "fast only": not is_filter and S[0] < 1e-4 * S[half],
        "no high-pass": not is_filter and np.allclose(behind, behind[0]),
        "filter": np.allclose(doubled[0], 2 * doubled[1]),
    }
    for trait, is_so in wanted.items():
        assert kind.has(trait) == is_so, f"the row of {kind.tag()} in kTable: {trait}"
    stopped = p.spectrum([p.White(0.0), example, p.LowPass(0.01, 4.0)], LAM, H)
    if not is_filter and kind is not p.White:
        assert (stopped[half] > 0.5 * S[half]) == is_behind, f"the row of {kind.tag()} in kTable: behind"


@pytest.mark.parametrize("kind", p.SLOW, ids=lambda kind: kind.tag())
@given(st.data())
def test_the_response_of_a_slow_part_has_its_spectrum(kind: type[Part], data: st.DataObject) -> None:
    part = data.draw(PARTS[kind.tag()])
    found, wanted = np.abs(part.response(LAM, H)) ** 2, p.spectrum([part], LAM, H)
    np.testing.assert_allclose(found, wanted, rtol=2e-4, atol=1e-9 * wanted.max())


@kinds
def test_a_part_is_a_system(kind: type[Part]) -> None:
    parts = [p.White(1.0)] if kind is p.White else [p.White(1.0), EXAMPLES[kind.tag()]]
    s, wanted = system(parts, H, SAMPLES), p.spectrum(parts, LAM, H)
    off = np.abs(s.spectrum(LAM) - wanted) / np.maximum(wanted, 0.05)
    assert off[LAM < 1].max() < EXACT_SHARE, f"poles or response of {kind.tag()}"
    slow = kind.has("slow")
    assert bool((s.signal == 1).any()) == slow, f"the state of a tracker has {kind.tag()}, or it has not"


@kinds
def test_a_part_is_found_and_said(kind: type[Part]) -> None:
    """If the spectrum is exactly that of a part of noise, the model search finds the part, and the verdict
    describes it.

    The fitted parameters of the part have intervals.
    """
    if kind in (p.White, p.Floor):
        return  # these parts only occur together with other parts
    example = EXAMPLES[kind.tag()]
    f = CandidateModels(bins([p.White(1.0), example], SAMPLES, H, None), H, 0)
    best = f.ordered if kind.has("ordered") else f.plain
    assert best is not None
    assert kind in best.kinds, f"the search finds {wording.names(best.kinds)} in place of {kind.tag()}"
    if kind.has("ordered"):
        return
    seen = read(f, float(f.data.lam[0]) / (2 * np.pi * H), apart=6.0)
    assert kind.row().says in seen.says, f"{kind.tag()} is found, and nothing is said of it"


@kinds
def test_a_part_is_in_the_documentation(kind: type[Part]) -> None:
    text = (ROOT / "host/docs/theory/grammar.md").read_text(encoding="utf-8")
    assert re.search(rf"^\| {kind.tag()}\b", text, re.MULTILINE), f"no row for {kind.tag()} in grammar.md"


def test_other_free_parameters_are_of_a_part_and_of_no_file() -> None:
    others = {row.name for row in ROWS if "other" in row.traits}
    assert others == {"order by F", "order by f", "order by Q", "arfima by s2"}
    assert not others & {kind.tag() for kind in p.CODES}
    assert [row.code for row in ROWS] == list(range(len(BY_NAME)))


@pytest.mark.parametrize("kind", [kind for kind, part in EXAMPLES.items() if part.has("filter")])
def test_a_filter_names_each_pair_of_poles_once(kind: str) -> None:
    """The number of states is counted from these poles, so a pair that is named twice would take the room of
    other parts.
    """
    poles, _ = EXAMPLES[kind].filter_poles(H)
    assert all(complex(one).imag > -1e-12 for one in poles)

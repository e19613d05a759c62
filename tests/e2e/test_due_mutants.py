"""The list of bugs of `make mutants` fits the sources."""

import msgspec
import pytest
from due_support import ROOT

from tools.mutants.workshop import read_mutants

MUTANTS = read_mutants()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_each_bug_has_its_place_in_the_present_sources(mutant) -> None:
    text = (ROOT / "firmware" / mutant.file).read_text()
    assert mutant.applied_to(text) != text
    with pytest.raises(ValueError, match="stands 0 times"):
        msgspec.structs.replace(mutant, old="no such text").applied_to(text)


def test_the_list_is_long_enough_and_names_each_bug_once() -> None:
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS) >= 30

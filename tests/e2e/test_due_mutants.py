"""The list of bugs of `make mutants` fits the sources, and its trial on the emulator judges as it should."""

import msgspec
import pytest
from due_support import IMAGE, ROOT, image

from tools.mutants.mutation import read_mutants
from tools.mutants.trial import first_failure

MUTANTS = read_mutants()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_each_bug_has_its_place_in_the_present_sources(mutant) -> None:
    text = (ROOT / "firmware" / mutant.file).read_text()
    assert mutant.applied_to(text) != text
    with pytest.raises(ValueError, match="stands 0 times"):
        msgspec.structs.replace(mutant, old="no such text").applied_to(text)


def test_the_list_is_long_enough_and_names_each_bug_once() -> None:
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS) >= 30


@pytest.mark.slow
def test_the_committed_image_passes_the_trial() -> None:
    assert first_failure(image()) is None


def test_the_trial_notices_another_instruction() -> None:
    """The reset vector leads astray: nothing of what the trial states can be true."""
    broken = bytearray(image())
    broken[4:8] = (0).to_bytes(4, "little")
    failure = first_failure(bytes(broken))
    assert failure is not None
    assert failure.startswith("it runs")
    assert IMAGE.read_bytes() == image()

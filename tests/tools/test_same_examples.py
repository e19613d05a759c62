"""The examples that hypothesis tries do not depend on the tests that ran before."""

from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.internal.conjecture.providers import HypothesisProvider

A_CONSTANT_OF_THIS_PROJECT = 987_654_321

drawn: list[int] = []


@settings(max_examples=200)
@given(st.integers())
def test_no_constant_of_this_file_is_drawn(number: int) -> None:
    """Hypothesis by itself draws it in a twentieth of the examples that have a number from the sources."""
    assert number != A_CONSTANT_OF_THIS_PROJECT


def test_there_are_no_constants_of_the_project() -> None:
    """The conftest of these tests replaces a function of hypothesis that is not public."""
    constants = HypothesisProvider(None)._local_constants
    assert not len(constants)

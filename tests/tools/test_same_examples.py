"""The examples that hypothesis tries do not depend on the tests that ran before."""

from hypothesis.internal.conjecture.providers import HypothesisProvider


def test_no_constants_come_from_the_sources_of_the_project() -> None:
    """The library hypothesis can take constants from loaded source files as examples. tests/conftest.py turns
    this off by replacing a private function of hypothesis.
    """
    constants = HypothesisProvider(None)._local_constants
    assert not len(constants)

"""A tiny evaluation, made once."""

import pytest
from fltea.identification.workers import Here
from validation_support import TINY

from tools.validation.evaluate import figures
from tools.validation.evaluate.run import Result, plan_tasks, result_of
from tools.validation.runner import run


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return result_of(run(plan_tasks(TINY), Here(), tmp_path_factory.mktemp("tiny") / "evaluate.ndjson"))


@pytest.fixture(scope="session")
def drawn(tiny: Result) -> dict[str, bytes]:
    """Two of the maps and the settings: a map takes most of a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "MAPS", {name: figures.MAPS[name] for name in ("error", "coverage")})
        return figures.draw(tiny)

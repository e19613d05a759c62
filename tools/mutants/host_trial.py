"""A copy of the repository in which changes of the host are tried. Tests of the changed module run first."""

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tools.mutants.host_changes import HOST, Change
from tools.mutants.workshop import REPOSITORY, Invalid, run

PATIENCE_S = 1800.0
TEST_S = 120
"""Time limit of one test [s]; a test that hangs counts as failed."""
MOST_OUTSIDE = 10
"""Largest number of test files that run from other folders than the changed module's own folder of tests. A
limit is needed because tests of all folders import the basic modules.
"""

# The import finder of an editable install is removed. It has precedence over sys.path, so it would find the
# original package instead of the copy.
ONLY_THE_COPY = """import sys
sys.meta_path[:] = [finder for finder in sys.meta_path if "editable" not in type(finder).__module__]
"""


class HostCopy:
    """A copy of the work tree with the native module; the shared recordings are linked next to it."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "fltea"
        command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
        listed = subprocess.run(command, cwd=REPOSITORY, capture_output=True, check=True).stdout.decode()
        for name in filter(None, listed.split("\0")):
            if (REPOSITORY / name).is_file():
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(REPOSITORY / name, self.root / name)
        native = Path(sys.prefix).glob("lib/python*/site-packages/fltea/_native*.so")
        shutil.copy2(next(native), self.root / HOST)
        (self.root / ".venv").symlink_to(sys.prefix)
        (folder / "shared").symlink_to(REPOSITORY.parent / "shared")
        (folder / "path").mkdir()
        (folder / "path/sitecustomize.py").write_text(ONLY_THE_COPY, encoding="utf-8")
        self._environment = {
            "PYTHONPATH": f"{self.root / 'host'}:{folder / 'path'}",
            "OPENBLAS_NUM_THREADS": "1",
        }

    def noticed_by(self, change: Change) -> str | None:
        """Return a test that fails twice in a row with `change`, and then passes without it.

        None if there is no such test. A test that fails only once may fail by chance.

        Raises:
            Invalid: pytest itself fails.
        """
        source = self.root / change.file
        text = source.read_text(encoding="utf-8")
        kept = shutil.copy2(source, source.with_suffix(".kept"))
        tests = [*nearest_tests(self.root, change.file), "tests/e2e"]
        unsteady: list[str] = []
        while True:
            source.write_text(change.applied_to(text), encoding="utf-8")
            try:
                failed = self._first_failure(tests, unsteady)
                again = failed and self._first_failure([failed])
            finally:
                # copy2 restores the time of last change, too. By it, Python knows that the compiled file
                # still belongs to this source.
                shutil.copy2(kept, source)
            if failed is None or (again and self._first_failure([failed]) is None):
                return failed
            unsteady.append(failed)

    def _first_failure(self, tests: Sequence[str], without: Sequence[str] = ()) -> str | None:
        pytest = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider"]
        chosen = ["-m", "not slow", "-o", f"timeout={TEST_S}", *(f"--deselect={test}" for test in without)]
        code, output = run([*pytest, *chosen, *tests], self.root, self._environment, patience_s=PATIENCE_S)
        if code in (0, 5):
            return None
        if failed := re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", output, re.MULTILINE):
            return failed[1]
        if code in (3, 4):
            raise Invalid(output)
        return tests[0]


def nearest_tests(root: Path, file: str) -> list[str]:
    """Return the test files to run for `file`, the nearest first.

    The result has three groups. First come the test files in the folder of tests for the package of `file`
    that import `file`, directly or through a helper in tests/rig. Then come at most MOST_OUTSIDE test files
    of other folders that import `file` in one of these ways; if there are none, those that mention the
    package. Last come the remaining test files of the package's folder. In each group, test files with few
    imports come before those with many.
    """
    package, name, room = ".".join(Path(file).parts[1:-1]), Path(file).stem, Path(file).parts[2]
    imports = rf"\b{package}\.{name}\b|^ *from {package} import (\([^)]*|.*)\b{name}\b"
    if name == "__init__":
        imports = rf"\b{package} import\b"
    texts = {path: path.read_text(encoding="utf-8") for path in sorted((root / "tests").rglob("*.py"))}
    direct = {path for path, text in texts.items() if re.search(imports, text, re.MULTILINE)}
    if stand_ins := "|".join(path.stem for path in direct if path.parent.name == "rig"):
        of_stand_ins = rf"^from tests\.rig(\.({stand_ins})| import .*\b({stand_ins}))\b"
        direct |= {path for path, text in texts.items() if re.search(of_stand_ins, text, re.MULTILINE)}
    tests = [path for path in texts if path.name.startswith("test_") and path.parent.name != "e2e"]
    tests.sort(key=lambda path: len(re.findall(r"^ *(from|import) ", texts[path], re.MULTILINE)))
    inside = [path for path in tests if path.parent.name == room]
    outside = [path for path in tests if path not in inside]
    near = [path for path in outside if path in direct]
    near = near or [path for path in outside if f"fltea.{room}" in texts[path]]
    first = [path for path in inside if path in direct] + near[:MOST_OUTSIDE]
    return [str(path.relative_to(root)) for path in dict.fromkeys([*first, *inside])]

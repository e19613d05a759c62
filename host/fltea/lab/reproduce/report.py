"""Make the paper's tables and figures in the paper's order. Each scenario is run only once."""

import csv
from collections.abc import Callable, Mapping
from pathlib import Path

from fltea.estimator.engine import Estimates
from fltea.lab.reproduce import exchange, figures, gyroscope, paper, paper_tables, timing
from fltea.lab.reproduce.paper_tables import Row
from fltea.lab.reproduce.request import Request
from fltea.lab.reproduce.runs import Outcome, estimate, outcomes
from fltea.lab.reproduce.scenarios import Data, Scenario, example, unknown_input
from fltea.records.errors import UsageError
from fltea.records.whole_file import prepare_folder, text_of, whole_file
from fltea.settings.extras import need_matplotlib

Progress = Callable[[str, int], None]
"""A function that reports progress: called with a text on what is being done, and the number of progress
steps that were just finished.
"""

UNKNOWN = {"white": "white source noise", "fractional": "fractional source noise"}


class Report:
    """The tables and figures that a `Request` asks for; `run` makes them.

    Raises:
        UsageError: before anything is computed, if the recording is bad, the folder cannot be written to, or
            figures are asked for without matplotlib.
    """

    def __init__(self, request: Request, progress: Progress = lambda text, steps: None) -> None:
        self.request = request
        self.progress = progress
        if request.figures:
            need_matplotlib("figures need", "; without it, ask for tables alone: --table 2")
        if request.folder is not None:
            prepare_folder("--out", request.folder)
        self._scenarios = self._choose_scenarios()
        self._results: dict[str, Mapping[int, Outcome]] = {}
        self._seeds: dict[Path, list[list[object]]] = {}
        self.files: list[Path] = []

    @property
    def steps(self) -> int:
        """Number of progress steps: one for each run, each row of table 1 and each figure."""
        runs = sum((1 if s.single else self.request.seeds) * len(s.lengths) for s in self._scenarios.values())
        return runs + len(self._figures()) + (len(paper.TABLE_1) if "1" in self.request.tables else 0)

    def run(self) -> dict[str, list[Row]]:
        """Make every table and figure; return the rows by table."""
        rows = {table: self._table(table) for table in self.request.tables}
        if rows and self.request.folder is not None:
            self.files.append(self.request.folder / "tables.md")
            with whole_file(self.files[-1]) as file:
                file.write(self.document(rows).encode())
        for figure in self._figures():
            self._figure(figure)
        return rows

    def exchange(self) -> Row | None:
        """Return the evidence on an exchange of tables 3 and 4; None if neither table was asked for."""
        if not {"3", "4"} & set(self.request.tables):
            return None
        return exchange.evidence({example: self._outcomes(str(example)) for example in (2, 3)})

    def document(self, rows: Mapping[str, list[Row]]) -> str:
        """Return the rows from `run` as Markdown.

        The text says whether tables 3 and 4 are likely printed each in the place of the other.
        """
        found = self.exchange()
        return paper_tables.document(rows, [] if found is None else [exchange.text(found)])

    def _choose_scenarios(self) -> dict[str, Scenario]:
        """Return the scenarios that the tables and figures asked for need, by name, in the paper's order."""
        request = self.request
        named = [key for table in request.tables for key in _of_table(table)]
        named += [_of_figure(figure)[0] for figure in request.figures if figure != "6.2"]
        named += list(UNKNOWN) if "6.2" in request.figures else []
        scenarios = {str(n): example(n, request.sawtooth) for n in (1, 2, 3)}
        scenarios |= {kind: unknown_input(fractional=kind == "fractional") for kind in UNKNOWN}
        if any(name in paper.GYRO_R for name in named):
            recording = request.recording
            scenarios |= (
                gyroscope.white_noise() if recording is None else gyroscope.recorded(recording, request.how)
            )
        elif request.recording is not None:
            raise UsageError("--recording is for table 5 and figures 12 to 20; none of them is asked for.")
        for figure in request.figures:
            name = "white" if figure == "6.2" else _of_figure(figure)[0]
            if name not in scenarios and not request.everything:
                raise UsageError(f"--figure {figure}: {request.recording} has no {name} axis.")
        return {name: scenario for name, scenario in scenarios.items() if name in named}

    def _figures(self) -> list[str]:
        return [f for f in self.request.figures if f == "6.2" or _of_figure(f)[0] in self._scenarios]

    def _outcomes(self, name: str) -> Mapping[int, Outcome]:
        scenario = self._scenarios[name]
        if name not in self._results:
            self.progress(scenario.title, 0)
            self._results[name] = outcomes(
                scenario,
                range(self.request.seeds),
                self.request.options,
                lambda steps: self.progress(scenario.title, steps),
            )
        return self._results[name]

    def _table(self, table: str) -> list[Row]:
        request = self.request
        if table == "1":
            self.progress("Table 1", 0)
            times = timing.measure(
                request.sawtooth, request.options, lambda steps: self.progress("Table 1", steps)
            )
            return paper_tables.time_rows(dict(times))
        rows: list[Row] = []
        for name in _of_table(table):
            # without a scenario of this name, the recording lacks the axis
            if name not in self._scenarios:
                continue
            scenario, results = self._scenarios[name], self._outcomes(name)
            if table == "6.2":
                rows += paper_tables.unknown_rows(scenario, results, request.options)
            elif table == "5":
                rows += paper_tables.gyroscope_rows(name, scenario, results, request.options)
            else:
                rows += paper_tables.example_rows(int(table), int(name), scenario, results, request.options)
            if request.folder is not None:
                self._write_seeds(request.folder / f"{_file_name('table', table)}.csv", name, results)
        return rows

    def _write_seeds(self, path: Path, name: str, results: Mapping[int, Outcome]) -> None:
        """Write one row for each seed and length L to a CSV file.

        If the table has further scenarios, the file is then written again, with their rows, too.
        """
        rows = self._seeds.setdefault(path, [["run", "L", "seed", *Outcome._fields]])
        for length, outcome in results.items():
            for seed, numbers in enumerate(zip(*(a.tolist() for a in outcome), strict=True)):
                rows.append([name, length, seed, *numbers])
        with whole_file(path) as file, text_of(file) as text:
            csv.writer(text).writerows(rows)
        if path not in self.files:
            self.files.append(path)

    def _figure(self, figure: str) -> None:
        assert self.request.folder is not None
        path = self.request.folder / f"{_file_name('figure', figure)}.png"
        options = self.request.options
        engine = f"variant {options.variant}, guard {options.guard}"
        if figure == "6.2":
            cases, notes = {}, []
            for kind, title in UNKNOWN.items():
                scenario, data, estimates, why = self._one_run(kind)
                cases[title] = (scenario, data, estimates)
                notes.append(why)
            figures.draw_unknown(path, cases, f"{'; '.join(notes)}; {engine}")
        else:
            name, quantity = _of_figure(figure)
            scenario, data, estimates, why = self._one_run(name)
            caption = f"Figure {figure}. {scenario.title}: {quantity}"
            figures.draw(
                path, caption, quantity, scenario, data, estimates, f"{scenario.source}; {why}; {engine}"
            )
        self.files.append(path)
        self.progress(f"Figure {figure}", 1)

    def _one_run(self, name: str) -> tuple[Scenario, Data, dict[int, Estimates], str]:
        """Return the run to draw: scenario, data, estimates by length L, and in words which run it is."""
        scenario = self._scenarios[name]
        seed, why = figures.median_seed(scenario, self._outcomes(name))
        data = scenario.make([seed])
        estimates = {L: estimate(scenario, data, L, self.request.options) for L in scenario.lengths}
        return scenario, data, estimates, why if scenario.single else f"seed {seed} ({why})"


def _of_table(table: str) -> tuple[str, ...]:
    """Return the names of the scenarios whose results a table shows."""
    named = {"5": tuple(paper.GYRO_R), "6.2": tuple(UNKNOWN)}
    named |= {str(n): tuple(map(str, examples)) for n, examples in paper_tables.EXAMPLES.items()}
    return named.get(table, ())


def _of_figure(figure: str) -> tuple[str, str]:
    """Return the name of the scenario and the name of the quantity that a figure shows.

    Figures 2 to 10 show three quantities of each example, figures 12 to 20 three quantities of each axis.
    """
    number = int(figure)
    first, names = (2, ("1", "2", "3")) if number <= 10 else (12, tuple(paper.GYRO_R))
    return names[(number - first) // 3], figures.QUANTITIES[(number - first) % 3]


def _file_name(kind: str, number: str) -> str:
    return "section-6.2" if number == "6.2" else f"{kind}-{int(number):02d}"

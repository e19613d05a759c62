"""Tests the benchmark of the whole program: the rows of results, the alternating measurement of two versions
of the program, and the tables.
"""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tools.bench import __main__ as command
from tools.bench import bench_chain as bench
from tools.bench import chain_rows
from tools.bench.chain_rows import GOALS, ROWS, USUAL, Row, chosen
from tools.bench.programs import PRESENT, Program

OLD = Program("old", "python-of-old")


def names(*wanted: str, long: bool = False) -> list[str]:
    return [row.name for row in chosen(wanted, long=long)]


def test_rows_are_chosen_by_name_and_by_kind() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)
    assert names("300", "ndjson") == ["ndjson", "300"]
    assert set(names("hour")) == {row.name for row in ROWS if row.kind == "hour"}
    assert names() == ["none", "ndjson", "mcap", "1", "1-0ms", "10", "300", "1000"]
    assert set(names("all", long=True)) == {row.name for row in ROWS}


def test_long_rows_are_measured_only_on_request() -> None:
    long = {row.name for row in ROWS if row.long}
    assert {"300-record", "1-old", "day-npz"} <= long
    assert not long & {*names(), *names("all"), *names("live")}
    assert names("1-old") == ["1-old"]
    assert long <= set(names(long=True))


def test_an_unknown_row_is_answered_with_all_names() -> None:
    with pytest.raises(SystemExit, match=r"no row 300-devices\. The rows are none, ndjson, .*1000"):
        chosen(["300-devices"])


def test_goals_and_usual_rows_are_of_rows_that_exist_and_of_figures_that_are_shown() -> None:
    assert {*GOALS, *USUAL} <= {row.name for row in ROWS}
    for row in ROWS:
        assert set(row.goals) <= set(bench.COLUMNS[row.kind]), row.name


def rows_of(seen: list[tuple[str, str]]) -> list[Row]:
    def work(name: str, wall_s: float) -> Any:
        def measured(files: Any, program: Program) -> dict[str, Any]:
            seen.append((name, program.name))
            if (name, program.name) == ("none", "old"):
                raise RuntimeError("no such flag:\n --new")
            return {"wall_s": wall_s, "cpu_s": 1.0, "rss_mb": 70.0}

        return measured

    replaced = {"none": 1.0, "mcap": 2.0, "peer-npz": 3.0, "day-npz": 4.0}
    return [row._replace(work=work(row.name, replaced[row.name])) for row in ROWS if row.name in replaced]


def test_programs_are_measured_in_turns_and_one_that_fails_ends_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[tuple[str, str]] = []
    rows = rows_of(seen)
    monkeypatch.setattr(bench, "chosen", lambda names, long: rows)
    monkeypatch.setattr(bench, "at_commit", lambda commit: OLD)
    monkeypatch.setattr(bench, "engine_alone", lambda files: {"cpu_s": 0.2})
    found = bench.measure(against="old", rounds=None)
    turn = [
        ("none", "old"),
        ("none", "present"),
        ("mcap", "old"),
        ("mcap", "present"),
        ("peer-npz", "present"),
    ]
    assert seen == [*turn * 3, ("day-npz", "old"), ("day-npz", "present")]
    assert found["programs"] == ["old", "present"]
    assert found["runs"]["none"]["old"] == [{"failed": "no such flag: --new"}] * 3
    assert found["runs"]["mcap"]["present"][0]["times_engine"] == 5.0
    assert "| 3 of 3 runs failed: no such flag: --new |" in bench.text(found)
    json.dumps(found, allow_nan=False)


def device(**figures: float | None) -> dict[str, Any]:
    usual = dict.fromkeys(bench.OF_DEVICES, 1.0) | {"lost_or_errors": 0, "feeder_late_ms": 0.5}
    return usual | {"seconds": 10.0, "memory_mb": [1.0]} | figures


def test_a_row_shows_median_and_spread_of_both_programs_and_their_ratio() -> None:
    old = [device(cpu_percent=x, p99_ms=300.0) for x in (100.0, 120.0, 108.0)]
    new = [device(cpu_percent=x, p99_ms=45.0, lost_or_errors=y) for x, y in ((54.0, 0), (50.0, 7), (60.0, 0))]
    runs = {"300": {"old": old, PRESENT.name: new}}
    missed = bench.not_reached(runs)
    assert missed == ["300: core % 54.0, goal 45", "300: lost, errors 7, goal 0"]
    found = {
        "programs": ["old", "present"],
        "engine_cpu_s": 0.2,
        "load_average": [0.1, 9.0],
        "runs": runs,
        "not_reached": missed,
    }
    lines = bench.text(found).splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("| 300 |"))
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines[first : first + 3]]
    assert cells[0][:6] == [
        "300",
        "300 devices, white, 20 ms",
        "old",
        "108.0 (100.0, 120.0)",
        "1.00",
        "300.00",
    ]
    assert cells[1][:6] == ["", "", "present", "54.0 (50.0, 60.0)", "1.00", "45.00"]
    assert cells[2][:6] == ["", "", "ratio", "**0.50**", "**1.00**", "**0.15**"]
    assert cells[1][9] == "0 (0, 7)"
    assert cells[1][-1] == "core % ≤ 45, p99 ms ≤ 60, lost, errors ≤ 0"
    assert not cells[0][-1]


def test_devices_of_whom_nothing_came_have_no_latency_and_miss_its_goal() -> None:
    silent = device(p50_ms=None, p99_ms=None, max_ms=None, cpu_percent=1.0, lost_or_errors=9)
    runs = {"300": {"old": [silent], PRESENT.name: [silent]}}
    assert bench.not_reached(runs) == ["300: p99 ms –, goal 60", "300: lost, errors 9, goal 0"]
    found = {
        "programs": ["old", "present"],
        "engine_cpu_s": 0.2,
        "load_average": [0.1, 9.0],
        "runs": runs,
        "not_reached": [],
    }
    assert "| ratio | **1.00** | – | – | – |" in bench.text(found)


def test_memory_is_told_where_a_run_is_long() -> None:
    run = device(seconds=600.0) | {"memory_mb": [681.0, 733.0]}
    assert bench._memory({"300-record": {"old": [run]}, "300": {"old": [device()]}}) == [
        "Memory of 300-record, old, in MB, ten times in 600 s: 681.0, 733.0."
    ]


def test_the_command_line_says_rows_rounds_and_commit(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "measure", lambda **options: options)
    arguments = ["--chain", "--against", "HEAD~3", "--rows", "300,ndjson", "--rounds", "1", "--json"]
    monkeypatch.setattr(sys, "argv", ["bench", *arguments])
    monkeypatch.setattr(bench, "text", str)
    command.main()
    said = json.loads(capsys.readouterr().out)
    assert said == {"chain": {"long": False, "rows": "300,ndjson", "against": "HEAD~3", "rounds": 1}}


def test_each_form_of_a_recording_is_written_once(tmp_path: Path) -> None:
    files = bench.Files(tmp_path / "hour", 3)
    assert len(files.gyro) == 300
    written = files.npz.stat().st_mtime_ns
    assert files.npz.stat().st_mtime_ns == written
    assert chain_rows.SECONDS.keys() == bench.COLUMNS.keys()
    assert files.coloured.exists()
    assert files.csv.exists()
    assert list(files.mcap.glob("**/*.mcap"))

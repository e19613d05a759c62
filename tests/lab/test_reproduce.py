"""Tests of the paper's experiments: the data, the errors, runs that diverge, and the rows of the tables."""

import csv
import json
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fltea.estimator.engine import Estimates
from fltea.lab.reproduce import gyroscope, paper, paper_tables, timing
from fltea.lab.reproduce.figures import median_seed
from fltea.lab.reproduce.report import Report
from fltea.lab.reproduce.request import Request
from fltea.lab.reproduce.runs import Options, Outcome, estimate, far_off, not_finite, outcomes
from fltea.lab.reproduce.scenarios import SawTooth, Scenario, example, unknown_input
from fltea.lab.reproduce.simulate import fractional_states, noises
from fltea.noise.weights import weights
from fltea.records.errors import UsageError
from fltea.settings.how import AS_IT_SAYS, How

from tests.rig.engine_cases import driven

SEEDS = [0, 1, 7]


def quiet(steps: int) -> None:
    pass


def short(number: int, samples: int = 400, sawtooth: SawTooth | None = None) -> Scenario:
    return example(number, sawtooth or SawTooth(), samples)


def make_outcome(lost: list[bool], far: list[bool] | None = None, **values: list[float]) -> Outcome:
    names = [name for name in Outcome._fields if name not in {"not_finite", "far_off"}]
    arrays = {name: np.array(values.get(name, [1.0] * len(lost))) for name in names}
    return Outcome(not_finite=np.array(lost), far_off=np.array(far or [False] * len(lost)), **arrays)


# --- the data of the experiments ---


@pytest.mark.parametrize("number", [1, 2, 3])
def test_all_seeds_at_once_give_the_samples_of_the_plain_simulator(number: int) -> None:
    scenario = short(number)
    data = scenario.make(SEEDS)
    for column, seed in enumerate(SEEDS):
        x, y = driven(scenario.alpha, data.u[:, column], seed)
        assert data.x[:, column] == pytest.approx(x, rel=1e-11, abs=1e-13)
        assert data.y[:, column] == pytest.approx(y, rel=1e-11, abs=1e-13)


@pytest.mark.parametrize("runs", [1, 64, 65, 130])
def test_the_samples_of_a_seed_do_not_depend_on_how_many_there_are(runs: int) -> None:
    seeds = list(range(runs))
    scenario = short(3, 150)
    many = scenario.make(seeds)
    alone = scenario.make([runs - 1])
    assert np.array_equal(many.y[:, [-1]], alone.y)


def test_the_noises_have_the_papers_variances() -> None:
    scenario = short(3, 1000)
    data = scenario.make(range(8))
    count = data.y.size
    for values, variance in ((data.y - data.x, 1e-3), (data.u, 0.1)):
        assert values.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / count))
        assert values.mean() == pytest.approx(0, abs=5 * np.sqrt(variance / count))
    # The system's noise ω is computed from the data by solving the system's equation for ω. Its variance must
    # be 1e-5.
    omega = []
    for k in range(2, 300):
        c = weights(float(scenario.alpha[k - 1]), k - 1)
        gain = paper.H ** scenario.alpha[k - 1]
        difference = c @ data.x[k - 1 :: -1]  # this is c_0 x_k + c_1 x_{k-1} + ..., where x_k is in row k - 1
        omega.append(difference / gain - paper.PARAMETER * data.x[k - 2] - data.u[k - 1])
    drawn = np.array(omega)
    assert drawn.var() == pytest.approx(1e-5, rel=5 * np.sqrt(2 / drawn.size))


def test_orders_and_lengths_are_the_papers() -> None:
    assert np.all(example(1, SawTooth()).alpha == 0.6)
    varying = example(2, SawTooth()).alpha
    assert (varying[0], varying[-1]) == pytest.approx((0.2001, 0.6))
    assert [example(n, SawTooth()).lengths for n in (1, 2, 3)] == [
        (4000, 3000, 2500, 2000),
        (4000, 2000),
        (4000, 2000),
    ]


def test_the_saw_tooth_starts_low_and_rises() -> None:
    u = SawTooth(5.0, 0.7).samples(4000, 1e-3)
    assert u[0] == -5
    assert np.all(np.diff(u[:700]) > 0)
    assert np.flatnonzero(np.diff(u) < 0).tolist() == [699, 1399, 2099, 2799, 3499]
    assert SawTooth(2.0, 1.0, unipolar=True).samples(1001, 1e-3)[[0, 500, 1000]] == pytest.approx([0, 1, 0])
    assert str(SawTooth()) == "saw-tooth ±1, 1 Hz, starting at -1"
    assert str(SawTooth(5, 0.5, unipolar=True)) == "saw-tooth 0 to 5, 2 Hz, starting at 0"
    for amplitude, period in ((np.nan, 1.0), (1.0, 0.0), (1.0, np.inf)):
        with pytest.raises(UsageError, match="saw-tooth"):
            SawTooth(amplitude, period)


def test_an_unknown_fractional_source_raises_the_order_that_is_found() -> None:
    options = Options(memory="compressed")
    cases = {kind: replace(unknown_input(fractional=kind), lengths=(3000,)) for kind in (False, True)}
    found = {kind: outcomes(case, range(8), options, quiet)[3000] for kind, case in cases.items()}
    for outcome in found.values():
        assert not (outcome.not_finite | outcome.far_off).any()
    # The system has the order 0.4. Its source is white noise in one case, and noise of the order 0.3 in the
    # other, which makes the order 0.7 in all. The paper's algorithm finds about 0.54 and 0.66.
    assert np.median(found[True].settled_order) > np.median(found[False].settled_order) + 0.05


def test_the_fractional_source_is_of_its_order() -> None:
    scenario = unknown_input(fractional=True, samples=200)
    data = scenario.make([4])
    Q = 0.15 / 0.01 ** (2 * 0.7)
    omega, v = noises(4, 200, Q, 0.05)
    source = fractional_states(np.full(200, 0.3), -1.0, omega[:, np.newaxis], 0.01)
    x = fractional_states(np.full(200, 0.4), -1.0, source, 0.01)
    assert data.u is None
    assert data.y[:, 0] == pytest.approx(x[:, 0] + v)


# --- gyroscope ---


def test_without_a_recording_each_axis_is_white_noise_of_the_papers_variance() -> None:
    axes = gyroscope.white_noise()
    assert list(axes) == ["x", "y", "z"]
    samples = {axis: scenario.make([0, 1]).y for axis, scenario in axes.items()}
    for axis, y in samples.items():
        assert y.shape == (3000, 2)
        assert y.var() == pytest.approx(paper.GYRO_R[axis], rel=5 * np.sqrt(2 / y.size))
        assert axes[axis].R == paper.GYRO_R[axis] == axes[axis].filters.R
        assert "white noise" in axes[axis].source
    assert abs(np.corrcoef(samples["x"][:, 0], samples["y"][:, 0])[0, 1]) < 5 / np.sqrt(3000)


def test_a_recording_gives_its_first_samples_without_their_mean(tmp_path: Path) -> None:
    counts = np.random.default_rng(2).normal(50, 20, (3500, 2)).round()
    path = tmp_path / "rest.npz"
    np.savez(path, gyro_raw=counts.astype(np.int16), lsb_per_dps=16.4, fs_hz=200.0)
    axes = gyroscope.recorded(path)
    assert list(axes) == ["x", "y"]
    expected = counts[:3000, 1] / 16.4
    y = axes["y"].make(range(5)).y
    assert y.shape == (3000, 1)
    assert y[:, 0] == pytest.approx(expected - expected.mean())
    assert pytest.approx(expected.var()) == axes["y"].filters.R
    assert axes["y"].filters.h == 1 / 200
    assert "rest.npz" in axes["y"].source
    assert len(outcomes(axes["y"], range(5), Options(), quiet)[1500].order) == 1


RATES = np.random.default_rng(3).normal(1.0, 0.1, 3010)
HELLO = {"class": "hello", "source": "x", "host_ns": 0, "rate_hz": 50.0, "sampling_mode": "recording"}


def sample(k: int, rate: float) -> dict[str, object]:
    times = {"seq": k, "epoch": 0, "device_us": k * 20_000, "host_ns": k * 20_000_000}
    return {"class": "sample", **times, "gyro_dps": [rate]}


@pytest.mark.parametrize(
    ("name", "lines", "how", "unit_dps"),
    [
        (
            "a.csv",
            ["time_s,gyro_x_dps", *(f"{k / 50},{rate}" for k, rate in enumerate(RATES))],
            AS_IT_SAYS,
            1,
        ),
        (
            "b.csv",
            ["t,gx", *(f"{k},{rate}" for k, rate in enumerate(RATES))],
            How(columns=["gx"], units="mdps", rate_hz=50.0),
            1e-3,
        ),
        # the output of fltea itself
        (
            "c.ndjson",
            map(json.dumps, [HELLO, *(sample(k, rate) for k, rate in enumerate(RATES))]),
            AS_IT_SAYS,
            1,
        ),
    ],
)
def test_text_is_read_too(name: str, lines: Iterable[str], how: How, unit_dps: float, tmp_path: Path) -> None:
    (tmp_path / name).write_text("".join(f"{line}\n" for line in lines))
    scenario = gyroscope.recorded(tmp_path / name, how)["x"]
    expected = RATES[:3000] - RATES[:3000].mean()
    assert scenario.make([0]).y[:, 0] == pytest.approx(expected * unit_dps)
    assert scenario.filters.h == pytest.approx(0.02)


def test_recordings_that_will_not_do_are_refused(tmp_path: Path) -> None:
    too_short, still = tmp_path / "short.npz", tmp_path / "still.npz"
    np.savez(too_short, gyro_dps=np.zeros((100, 3)), fs_hz=100.0)
    np.savez(still, gyro_dps=np.ones((3000, 3)), fs_hz=100.0)
    (tmp_path / "notes.doc").touch()
    for path, reason in (
        (too_short, "100 samples"),
        (still, "never changes"),
        (tmp_path / "none.npz", "no such file"),
        (tmp_path / "notes.doc", "is empty"),
    ):
        with pytest.raises(UsageError, match=reason):
            gyroscope.recorded(path)


# --- runs of the algorithm ---


def test_errors_are_sums_of_squares_against_the_truth() -> None:
    scenario = replace(short(1), lengths=(400, 100))
    result = outcomes(scenario, SEEDS, Options(), quiet)
    data = scenario.make([7])
    for length in scenario.lengths:
        got = estimate(scenario, data, length, Options())
        assert result[length].state[2] == pytest.approx(np.sum((got.x - data.x) ** 2), rel=1e-12)
        assert result[length].parameter[2] == pytest.approx(np.sum((got.f + 0.3) ** 2), rel=1e-12)
        assert result[length].order[2] == pytest.approx(np.sum((got.alpha - 0.6) ** 2), rel=1e-12)
        assert result[length].settled_order[2] == pytest.approx(got.alpha[-133:].mean(), rel=1e-12)


def test_without_a_truth_lengths_are_compared_with_the_longest() -> None:
    scenario = gyroscope.white_noise()["x"]
    data = scenario.make(SEEDS)
    result = outcomes(scenario, SEEDS, Options(), quiet)
    assert list(result) == [1500]
    long, brief = (estimate(scenario, data, length, Options()) for length in (3000, 1500))
    assert result[1500].order == pytest.approx(np.sum((long.alpha - brief.alpha) ** 2, axis=0), rel=1e-9)
    assert np.all(result[1500].state < 1e-5)
    # In the first 1,500 samples, the memories of both lengths include all past samples, so the estimates are
    # equal.
    assert np.array_equal(long.f[:1500], brief.f[:1500])


def test_progress_counts_every_run_once() -> None:
    steps: list[int] = []
    outcomes(replace(short(2, 50), lengths=(50, 20)), range(70), Options(), steps.append)
    assert sum(steps) == 140


def test_the_engine_of_the_tables_is_the_printed_algorithm() -> None:
    scenario = short(3)
    data = scenario.make([3])
    plain = timing.run_reference(scenario.filters, 150, data)
    got = estimate(scenario, data, 150, Options())
    for column, estimates in enumerate((got.x, got.f, got.alpha)):
        assert estimates[:, 0] == pytest.approx(plain[:, column], rel=1e-8, abs=1e-10)


def test_infinite_estimates_and_far_ones_are_told_apart() -> None:
    n, runs, sigma = 20, 6, 0.1
    calm = np.zeros((n, runs))
    arrays = {name: calm.copy() for name in ("alpha", "f", "x")}
    arrays["alpha"][3, 0] = 10.01
    arrays["x"][4, 1] = -1.01
    arrays["f"][5, 2] = np.inf
    arrays["x"][6, 3] = np.nan
    arrays["f"][7, 4] = 1e9
    arrays["alpha"][:, 5] = -10.0
    got = Estimates(**arrays, **dict.fromkeys(set(Estimates._fields) - set(arrays), calm))
    assert not_finite(got).tolist() == [False, False, True, True, False, False]
    assert far_off(got, calm, sigma).tolist()[:3] == [True, True, False]
    assert far_off(got, calm, sigma).tolist()[4:] == [False, False]


def test_lost_runs_are_counted_and_guards_prevent_them() -> None:
    wild = short(2, 1200, SawTooth(5.0))
    printed = outcomes(wild, range(8), Options(), quiet)[4000]
    guarded = outcomes(wild, range(8), Options(guard="consistent"), quiet)[4000]
    assert (printed.not_finite | printed.far_off).sum() >= 6
    assert not (printed.not_finite & printed.far_off).any()
    assert not (guarded.not_finite | guarded.far_off).any()
    row = paper_tables.outcome_row(printed, paper.TABLE_3[4000])
    assert (row["seeds"], row["far_off"]) == (8, int(printed.far_off.sum()))


def test_a_finite_run_that_is_far_off_stays_in_every_statistic() -> None:
    # With a saw-tooth of ±1.2, all numbers stay finite, but a sixth of the seeds end far off: the error of
    # the state is more than 10 √R, where R is the variance of the measurement noise.
    scenario = replace(short(2, 4000, SawTooth(1.2)), lengths=(4000,))
    printed = outcomes(scenario, range(32), Options(), quiet)[4000]
    assert printed.far_off.sum() >= 1
    assert not printed.not_finite.any()
    row = paper_tables.outcome_row(printed, None)
    assert row["parameter"]["median"] == pytest.approx(np.median(printed.parameter))


def test_joint_runs_too() -> None:
    result = outcomes(short(1), SEEDS, Options(variant="joint"), quiet)[4000]
    assert np.isfinite(result.order).all()


# --- rows of the tables ---


def test_medians_are_of_all_that_are_finite() -> None:
    outcome = make_outcome(
        [False, True, False, False], [False, False, True, False], state=[1.0, np.nan, 3.0, 2.0]
    )
    row = paper_tables.outcome_row(outcome, paper.Errors(2.5, 8.0, 1.0))
    assert (row["seeds"], row["not_finite"], row["far_off"]) == (4, 1, 1)
    spread = {"median": 2.0, "p05": pytest.approx(1.1), "p95": pytest.approx(2.9), "paper": 2.5}
    assert row["state"] == spread | {"percentile": pytest.approx(200 / 3)}
    assert row["parameter"]["percentile"] == 100
    # `percentile`: percentage of the errors that are below the paper's; an error equal to it counts as one
    # half
    assert (row["order"]["paper"], row["order"]["percentile"]) == (1.0, 50)


def test_what_is_not_a_number_is_null() -> None:
    row = paper_tables.outcome_row(make_outcome([True, True]), None)
    assert row["state"] == dict.fromkeys(("median", "p05", "p95", "paper", "percentile"))
    overflowed = paper_tables.spread(np.array([np.inf, 1.0, np.inf]))
    assert (overflowed["median"], overflowed["p95"]) == (None, None)


def test_the_seed_that_is_drawn_is_the_median_of_those_that_are_finite() -> None:
    outcome = make_outcome([False, False, False, True], order=[5.0, 1.0, 9.0, 6.0])
    assert median_seed(short(1), {4000: outcome})[0] == 0
    white = gyroscope.white_noise()["x"]
    accepted = make_outcome([False] * 3, settled_order=[0.1, 0.2, 0.3], order=[3.0, 9.0, 1.0])
    assert median_seed(white, {1500: accepted})[0] == 1
    assert median_seed(short(1), {4000: make_outcome([True, True])}) == (0, "not one of 2 is finite")


def test_every_printed_number_stands_beside_ours_with_its_percentile() -> None:
    scenario = short(1)
    result = {L: make_outcome([False] * 2, order=[1.0, 70.0 + L / 1e4]) for L in scenario.lengths}
    rows = paper_tables.example_rows(2, 1, scenario, result, Options())
    assert [row["L"] for row in rows] == [4000, 3000, 2500, 2000]
    assert [row["parameter"]["paper"] for row in rows] == [37.8467, 38.1044, 38.6321, 39.8187]
    assert [row["order"]["percentile"] for row in rows] == [50.0] * 4
    assert rows[0]["data"] == "saw-tooth ±1, 1 Hz, starting at -1"
    text = paper_tables.markdown("2", rows)
    assert (
        "| example 1 | 2,000 | 0 | 0 | 1 | 0.217 (0) | 1 | 39.82 (100) | 35.6 (4.46 … 66.7) | 62.91 (50) |"
        in text
    )
    assert "saw-tooth ±1" in text


def test_changes_with_the_length_are_those_of_each_seed() -> None:
    result = {
        4000: make_outcome([False, False, True], state=[1.0, 2.0, np.nan], order=[5.0, np.inf, 1.0]),
        2000: make_outcome([False] * 3, state=[1.5, 1.0, 1.0], order=[6.0, np.inf, 1.0]),
    }
    rows = paper_tables.example_rows(4, 2, short(2), result, Options())
    assert "change" not in rows[0]
    change = rows[1]["change"]
    assert change["state"]["median"] == pytest.approx(-0.25)
    assert change["state"]["paper"] == pytest.approx(0.4831 - 0.4711)
    assert change["state"]["percentile"] == 50
    assert change["order"]["median"] == 1
    assert change["order"]["paper"] == pytest.approx(27.1)
    text = paper_tables.markdown("4", rows)
    assert "|  | 4,000 to 2,000 |  |  | -0.25 (-0.925 … +0.425) | +0.012 (50) |" in text


def test_percentiles_of_0_and_100_stand_for_none_and_all() -> None:
    texts = [paper_tables.percent_text(share) for share in (0.0, 1e-4, 0.3, 41.88, 99.96, 100.0)]
    assert texts == ["0", "0.01", "0.3", "41.9", "99.9", "100"]


def test_tables_of_seeds_do_not_follow_links_or_wait_for_pipes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link is replaced, and the file to which it leads stays as it was. A pipe is left alone."""
    made = dict.fromkeys((4000, 2000), make_outcome([False, False]))
    monkeypatch.setattr("fltea.lab.reproduce.report.outcomes", lambda *_: made)
    (tmp_path / "other").write_text("mine")
    path = tmp_path / "table-04.csv"
    path.symlink_to("other")
    Report(Request(("4",), (), 2, out=tmp_path)).run()
    assert (tmp_path / "other").read_text() == "mine"
    with path.open() as file:
        found = [(row["run"], row["L"], row["seed"]) for row in csv.DictReader(file)]
    assert found == [(run, L, seed) for run in "32" for L in ("4000", "2000") for seed in "01"]
    assert not path.is_symlink()
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(UsageError, match="something that is not a file"):
        Report(Request(("4",), (), 2, out=tmp_path)).run()
    assert path.is_fifo()

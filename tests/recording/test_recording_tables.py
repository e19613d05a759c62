"""Tests what is made from recordings: exports that can be replayed, summaries, and recovered files."""

import csv
import dataclasses
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from fltea.archive.export import export
from fltea.archive.info import Summary, as_text, sessions, summarise
from fltea.cli import record as cli_record
from fltea.recording.recovery import recover
from fltea.records.block import AxisColumns, Block
from fltea.records.errors import UsageError
from fltea.records.events import Chunk, Failed
from fltea.records.ports import Wanted
from fltea.records.records import Corrected, Epoch, Estimate, Fit, Gap, Hello, Sample
from fltea.sinks import record as record_module
from fltea.sinks.json_lines import BlockLines
from fltea.stream.decode import Decoded, Decoder
from mcap.reader import make_reader

from tests.rig.blocks import of, records_of
from tests.rig.mcap_support import files, kill, record, replay, transport
from tools.fed_source import FedSource


@pytest.fixture
def many_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record_module, "FLUSH_NS", 0)


def exported(folder: Path, what: str) -> tuple[list[dict[str, str]], dict[str, np.ndarray]]:
    """Export the recording in `folder / "rec"` as .csv and as .npz. Return the rows of the CSV file, each by
    column name, and the arrays of the .npz file.
    """
    for name in ("out.csv", "out.npz"):
        export([folder / "rec"], folder / name, what, 100)  # type: ignore[arg-type]
    with (folder / "out.csv").open(newline="", encoding="utf-8") as file, np.load(folder / "out.npz") as data:
        return list(csv.DictReader(file)), dict(data)


def comparable(records: list, kind: type[Any]) -> list[tuple]:
    """Return epoch (number of the run between restarts) and axes of each estimate.

    The estimate's host time and number are left out, since a file without times of the host clock lacks them.
    """
    return [(r.epoch, r.axes) for r in of(kind, records)]


# --- the pipeline without the estimator ---


def test_a_decoder_numbers_samples_as_the_pipeline_does(tmp_path: Path) -> None:
    items = transport(samples=300, boots=2)
    assert any(isinstance(item, Failed) for item in items)
    assert any(isinstance(item, Chunk) and not item.data.endswith(b"\0") for item in items)
    live, _ = record(tmp_path, items)
    source = FedSource("/dev/due")
    decoder = Decoder(lambda: source.unix_offset_ns, 100, "due")
    found: list[Any] = []
    for item in items:
        for event in source.wire.feed(item, item.host_ns):
            found += decoder.feed(event)
        source.wire.resume(item.host_ns)
    samples = [one for one in found if isinstance(one, Decoded)]
    assert records_of(one.block for one in samples) == of(Sample, live)
    assert sum(one.missing for one in samples) == sum(gap.missing for gap in of(Gap, live)) == 6
    assert [one.new_epoch for one in samples if one.new_epoch] == [e.reason for e in of(Epoch, live)]


# --- export ---


def test_samples_as_they_were_and_an_npz_replays_to_the_same_estimates(tmp_path: Path) -> None:
    """The recording includes gaps, lost samples and a restart of the device."""
    live, _ = record(tmp_path / "rec", transport(samples=300, boots=2))
    rows, data = exported(tmp_path, "samples")
    samples = of(Sample, live)
    assert len(rows) == len(samples) == 594
    assert data["gyro_raw"].shape == (594, 3)
    assert data["seq"].tolist() == [s.seq for s in samples]
    assert data["host_ns"].tolist() == [int(row["host_ns"]) for row in rows] == [s.host_ns for s in samples]
    assert data["accel_raw"][0].tolist() == [0, 0, 16384]
    assert float(data["accel_lsb_per_g"]) == 16384.0
    assert data["temperature_c"][0] == samples[0].temperature_c
    gyro, accel = ([f"{what}_{axis}" for axis in "xyz"] for what in ("gyro", "accel"))
    names = ["time_s", *(f"{axis}_dps" for axis in gyro), *(f"{axis}_ms2" for axis in accel), "temperature_c"]
    assert [*rows[0]][:8] == names
    assert [tuple(float(row[name]) for name in names[1:4]) for row in rows] == [s.gyro_dps for s in samples]
    times = np.array([float(row["time_s"]) for row in rows])
    for found in (times, data["time_s"]):
        assert found[0] == 0.0
        assert (np.diff(found) > 0).all()
        assert found[297] - found[296] == pytest.approx(
            7.0, abs=0.1
        )  # the port was lost for 7 s by the host's clock
        assert found[60] - found[59] == pytest.approx(0.03)
    again = replay(tmp_path / "out.npz")
    assert comparable(again, Estimate) == comparable(live, Estimate)
    assert [(g.epoch, g.missing) for g in of(Gap, again)] == [(g.epoch, g.missing) for g in of(Gap, live)]


def test_corrected_rates_are_those_of_a_run_whether_they_were_recorded_or_not(tmp_path: Path) -> None:
    record(tmp_path / "rec", transport(samples=300, boots=2))
    expected = of(Corrected, replay(tmp_path / "rec", **{"output.corrected": True}))
    rows, data = exported(tmp_path, "corrected")
    assert [(int(row["epoch"]), int(row["seq"])) for row in rows] == [(e.epoch, e.seq) for e in expected]
    for field in ("rate", "rate_std"):
        wanted = [getattr(e.axes["gyro_y"], field) for e in expected]
        assert [float(x) if x else None for x in (row[f"{field}_gyro_y_dps"] for row in rows)] == wanted
        np.testing.assert_array_equal(data[f"{field}_gyro_y_dps"], np.array(wanted, dtype=float))
    assert {row["moving_gyro_z"] for row in rows} == {"0"}
    np.savez(tmp_path / "rest.npz", gyro_dps=np.ones((50, 1)), fs_hz=100.0)
    assert export([tmp_path / "rest.npz"], tmp_path / "rates.csv", "corrected", 100).rows == 50


def test_csv_replays_to_the_same_estimates_where_nothing_is_lost(tmp_path: Path) -> None:
    live, _ = record(tmp_path / "rec", transport(samples=59))
    export([tmp_path / "rec"], tmp_path / "out.csv", "samples", 100)
    again = replay(tmp_path / "out.csv", **{"replay.rate_hz": 100.0})
    assert len(of(Estimate, live)) == 39
    assert comparable(again, Estimate) == comparable(live, Estimate)


@pytest.mark.slow
def test_estimates_are_those_that_were_published(tmp_path: Path) -> None:
    """Exported estimates equal the published ones, including the result of the whiteness test."""
    live, _ = record(tmp_path / "rec", transport(samples=1_100))
    rows, data = exported(tmp_path, "estimates")
    first = ["time_s", "epoch", "seq", "device_us", "host_ns", "bias_gyro_x_dps", "bias_std_gyro_x_dps"]
    assert [*rows[0]][:7] == first
    names = {
        "fltea_f_gyro_x_s^-alpha",
        "fltea_f_std_gyro_z_s^-alpha",
        "state_gyro_y_dps",
        "fltea_valid_gyro_z",
    }
    assert names < set(rows[0])
    estimates = of(Estimate, live)
    assert len(rows) == len(estimates) == 1_077
    for row, estimate in zip(rows, estimates, strict=True):
        assert int(row["seq"]) == estimate.seq
        for axis, e in estimate.axes.items():
            assert float(row[f"bias_{axis}_dps"]) == e.bias
            assert float(row[f"state_{axis}_dps"]) == e.state
            assert float(row[f"fltea_alpha_{axis}"]) == e.fltea.alpha
            assert float(row[f"fltea_f_{axis}_s^-alpha"]) == e.fltea.f
            assert row[f"fltea_valid_{axis}"] == str(int(e.fltea.valid))
    assert data["fltea_alpha_gyro_x"].tolist() == [e.axes["gyro_x"].fltea.alpha for e in estimates]
    assert data["host_ns"].tolist() == [e.host_ns for e in estimates]
    last = estimates[-1].axes["gyro_y"]
    rejected = last.whiteness == "rejected"
    assert last.null_p is not None
    assert float(rows[-1]["null_p_gyro_y"]) == last.null_p
    assert (rows[0]["not_white_gyro_y"], rows[-1]["not_white_gyro_y"]) == ("", str(int(rejected)))
    assert data["not_white_gyro_y"][-1] == float(rejected)
    assert np.isnan(data["null_p_gyro_y"][0])


def test_fits_are_those_that_were_published(tmp_path: Path) -> None:
    live, _ = record(tmp_path / "rec", transport(samples=430))
    fits = of(Fit, live)
    assert len(fits) >= 2
    rows, data = exported(tmp_path, "fits")
    for row, fit in zip(rows, fits, strict=True):
        assert [int(row[name]) for name in ("seq", "samples")] == [fit.seq, fit.samples]
        for axis, one in fit.axes.items():
            assert row[f"fractional_{axis}"] == str(int(one.verdict == "fractional"))
            for column, value in (
                ("null_p_{}", one.null_p),
                ("alpha_{}", one.alpha.value),
                ("alpha_low_{}", one.alpha.low),
                ("f_high_{}_s^-alpha", one.f.high),
                ("R_{}_dps^2", one.R.value),
            ):
                assert row[column.format(axis)] == ("" if value is None else str(value))
    assert data["samples"].tolist() == [fit.samples for fit in fits]


def test_what_was_not_valid_stays_empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    of_block = BlockLines.of

    def invalid(lines: BlockLines, block: Block, wanted: Wanted, rows: range) -> bytes:
        changed: list[AxisColumns] = []
        for one in block.estimates:
            there = (block.seq == 40)[:, np.newaxis] & [axis == "gyro_x" for axis in one.axes]
            numbers = [np.where(there, np.nan, column) for column in one[4:10]]
            changed.append(one._make((*one[:4], *numbers, one.valid & ~there, one.settled & ~there)))
        return of_block(lines, dataclasses.replace(block, estimates=tuple(changed)), wanted, rows)

    monkeypatch.setattr(BlockLines, "of", invalid)
    record(tmp_path / "rec", transport(samples=60))
    rows, data = exported(tmp_path, "estimates")
    (row,) = [row for row in rows if row["seq"] == "40"]
    assert (row["fltea_alpha_gyro_x"], row["fltea_valid_gyro_x"]) == ("", "0")
    assert row["fltea_alpha_gyro_y"]
    assert np.flatnonzero(np.isnan(data["fltea_alpha_gyro_x"])).tolist() == [20]


def test_exports_of_other_recordings(tmp_path: Path) -> None:
    np.savez(tmp_path / "rest.npz", gyro_raw=np.ones((50, 2)), lsb_per_dps=131.0, fs_hz=100.0)
    assert export([tmp_path / "rest.npz"], tmp_path / "out.csv", "samples", 100).rows == 50
    assert (tmp_path / "out.csv").read_text().splitlines()[2].startswith(f"0.01,{1 / 131},{1 / 131},,")


@pytest.mark.parametrize(
    ("out", "what", "text"),
    [
        ("out.txt", "samples", r"give a name that ends in \.csv or \.npz"),
        ("out.csv", "estimates", "holds no estimates. Compute them from its samples: fltea run -s replay:"),
        ("out.csv", "fits", "holds no fits. Compute them from its samples"),
        ("out.csv", "device_estimates", "holds no estimates that a device computed"),
    ],
)
def test_exports_that_cannot_be(out: str, what: str, text: str, tmp_path: Path) -> None:
    record(tmp_path / "rec", transport(samples=60), channels=("sample",))
    with pytest.raises(UsageError, match=text):
        export([tmp_path / "rec"], tmp_path / out, what, 100)  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == ["rec"]


@pytest.mark.parametrize("name", ["out.csv", "link.npz"])
def test_an_export_replaces_nothing_unless_it_is_told_to(name: str, tmp_path: Path) -> None:
    record(tmp_path / "rec", transport(samples=60))
    (tmp_path / "out.csv").write_text("of yesterday")
    (tmp_path / "link.npz").symlink_to(tmp_path / "nowhere")
    with pytest.raises(UsageError, match=rf"--to .*{name}: exists already; .*--force"):
        export([tmp_path / "rec"], tmp_path / name, "samples", 100)
    assert (tmp_path / "out.csv").read_text() == "of yesterday"
    assert export([tmp_path / "rec"], tmp_path / name, "samples", 100, force=True).rows > 50
    assert not (tmp_path / "nowhere").exists()


# --- info ---


def test_a_sum_counts_what_the_live_run_counted(tmp_path: Path) -> None:
    live, _ = record(tmp_path, transport(samples=300, boots=2), rotate_s=2.0)
    wire = FedSource("/dev/due").wire
    for item in transport(samples=300, boots=2):
        list(wire.feed(item, item.host_ns))
    (paths,) = sessions([tmp_path])
    found = summarise(paths, 100)
    assert found.device == "due"
    assert (found.files, found.whole, found.breaks) == (len(files(tmp_path)), True, 0)
    assert (found.counts.delivered, found.counts.lost, found.counts.gaps, found.resets) == (594, 6, 4, 1)
    assert found.epochs == {"start": 1, "restart": 1}
    assert found.link == wire.link_stats()
    assert found.size_bytes == sum(path.stat().st_size for path in files(tmp_path))
    assert found.start_unix_ns == of(Sample, live)[0].host_ns
    assert found.hello.device == "due"
    assert (
        of(Hello, live)[-1].host_ns <= found.hello.host_ns <= of(Sample, live)[-1].host_ns
    )  # the summary has the last HELLO that was received
    assert found.duration_s == pytest.approx(13.0, abs=0.1)
    assert found.rate_hz == pytest.approx(100.0, rel=1e-3)
    text = as_text(found)
    for part in (
        "MPU-9250, ±2000 deg/s",
        "594, 6 lost in 4 gaps",
        "1 x restart",
        "whole",
        "2027-01-15 08:00:05",
    ):
        assert part in text
    again = msgspec.json.decode(msgspec.json.encode(found), type=Summary)
    assert again == found


@pytest.mark.parametrize("contradicting", [300, 1200])
def test_a_sum_names_samples_whose_times_contradict_hello(contradicting: int, tmp_path: Path) -> None:
    live, _ = record(tmp_path, transport(1200, contradicting=contradicting))
    found = summarise(files(tmp_path), 100)
    assert found.counts.rate_differs >= contradicting - 150
    assert found.counts.delivered == len(of(Sample, live))
    said = f", {found.counts.rate_differs} whose times contradict the rate of HELLO\n"
    assert said in as_text(found)


@pytest.mark.usefixtures("many_chunks")
def test_a_sum_says_that_a_file_is_being_written_or_was_cut(tmp_path: Path) -> None:
    _, sink = record(tmp_path, transport(samples=100), end=False)
    found = summarise(files(tmp_path), 100)
    assert (found.whole, found.being_written) == (False, True)
    assert "still being written" in as_text(found)
    assert "killed" not in as_text(found)
    kill(sink)
    found = summarise(files(tmp_path), 100)
    assert (found.whole, found.being_written) == (False, False)
    assert "not finished: killed" in as_text(found)


def test_sums_of_many_recordings_and_of_other_kinds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for device in ("left", "right"):
        record(tmp_path, transport(samples=60), device=device)
    np.savez(tmp_path / "rest.npz", gyro_dps=np.ones((50, 2)), fs_hz=100.0)
    cli_record.info([tmp_path, tmp_path / "rest.npz"], json=True)
    lines = [msgspec.json.decode(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["device"] for line in lines] == [None, "left", "right"]
    assert [line["samples"] for line in lines] == [50, 60, 60]
    assert {line["class"] for line in lines} == {"recording"}
    cli_record.info([tmp_path / "rest.npz"], json=False)
    assert "50, 0 lost in 0 gaps" in capsys.readouterr().out


# --- recover ---


@pytest.mark.usefixtures("many_chunks")
def test_a_torn_file_becomes_whole_beside_itself(tmp_path: Path) -> None:
    live, sink = record(tmp_path, transport(samples=100), end=False)
    kill(sink)
    path = files(tmp_path)[0]
    with path.open("ab") as file:
        file.write(b"\6\xff\xff")  # the beginning of an MCAP record, which was never completed
    before = path.read_bytes()
    found = recover(path, in_place=False)
    assert found.out == path.with_name(f"{path.stem}.recovered.mcap")
    assert (found.lost_bytes, found.damaged_chunks) == (3, 0)
    assert path.read_bytes() == before
    with found.out.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_summary() is not None
        assert sum(1 for _ in reader.iter_messages()) == found.messages
    assert of(Sample, replay(found.out)) == of(Sample, replay(path)) == of(Sample, live)
    assert recover(found.out, in_place=False).out is None
    with pytest.raises(UsageError, match="exists already"):
        recover(path, in_place=False)
    found.out.unlink()
    assert recover(path, in_place=True).out == path
    assert files(tmp_path) == [path]
    assert not [r for r in replay(tmp_path) if getattr(r, "kind", "") == "cut_recording"]
    assert of(Sample, replay(tmp_path)) == of(Sample, live)


def test_a_file_in_use_is_left_alone(tmp_path: Path) -> None:
    _, sink = record(tmp_path, transport(samples=60), end=False)
    with pytest.raises(UsageError, match="a running program still writes this file"):
        recover(files(tmp_path)[0], in_place=True)
    sink.close()
    assert recover(files(tmp_path)[0], in_place=True).out is None


def test_nothing_to_save_and_nothing_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(UsageError, match="nothing in this file can be recovered"):
        recover(tmp_path / "empty.mcap", in_place=False)
    with pytest.raises(UsageError, match="cannot be read"):
        recover(tmp_path / "none.mcap", in_place=False)
    record(tmp_path, transport(samples=60))
    # this error about one file is reported after all other files are done
    with pytest.raises(UsageError, match=r"empty\.mcap: nothing in this file"):
        cli_record.recover([tmp_path])
    assert "is whole" in capsys.readouterr().out
    assert sorted(tmp_path.glob(".*.part")) == []

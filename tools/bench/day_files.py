"""Writes recordings of any length as .npz, .csv, and MCAP as the live recorder writes it.

The MCAP files have one message for each read of the serial port.

`python -m tools.bench.day_files FOLDER HOURS` writes rest.npz, rest.csv and a folder of MCAP files with the
same samples: white noise of 3 LSB on three axes at 100 Hz, with a slow random walk.
"""

import csv
import sys
from itertools import chain
from pathlib import Path

import numpy as np
from fltea.records.events import Chunk, Opened
from fltea.settings.outputs import RecordConfig
from fltea.sinks.record import RecordSink
from fltea.wire.message_events import hello_event
from numpy.typing import NDArray

from tools.bench.feeder import RATE_HZ, board, sent_by

LSB_PER_DPS = 16.4
BEGIN_NS = 10**9
UNIX_NS = 1_900_000_000 * 10**9
AT_ONCE = 8192


def counts(samples: int, seed: int = 1) -> NDArray[np.int16]:
    """Return the counts of three axes at rest, in LSB, an array of shape (samples, 3)."""
    rng = np.random.default_rng(seed)
    found = np.empty((samples, 3), dtype=np.int16)
    level = np.zeros(3)
    for begin in range(0, samples, AT_ONCE):
        part = found[begin : begin + AT_ONCE]
        walk = level + np.cumsum(rng.normal(0, 0.005, part.shape), axis=0)
        level = walk[-1] * 0.9
        part[:] = np.rint(walk + rng.normal(0, 3, part.shape))
    return found


def write_npz(path: Path, gyro: NDArray[np.int16]) -> None:
    """Write an .npz file with counts, scale and sampling rate. A source `replay:` needs at least these."""
    np.savez_compressed(path, gyro_raw=gyro, lsb_per_dps=LSB_PER_DPS, fs_hz=float(RATE_HZ))


def write_csv(path: Path, gyro: NDArray[np.int16]) -> None:
    """Write a CSV file with the times, and the angular rates in deg/s."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps"])
        for begin in range(0, len(gyro), AT_ONCE):
            part = gyro[begin : begin + AT_ONCE]
            time_s = (np.arange(begin, begin + len(part)) / RATE_HZ).round(2)
            writer.writerows(np.column_stack([time_s, (part / LSB_PER_DPS).round(6)]).tolist())


def write_mcap(folder: Path, gyro: NDArray[np.int16]) -> Path:
    """Write MCAP files by the program's own recorder; return their folder."""
    sink = RecordSink(
        RecordConfig(folder=str(folder)).for_devices(1), "bench", lambda kind, text: print(kind, text)
    )
    device = board(0)
    sink.write(Opened(BEGIN_NS, UNIX_NS))
    sink.write(hello_event(device.hello, "serial:bench", BEGIN_NS + UNIX_NS))
    parts = (gyro[begin : begin + AT_ONCE].tolist() for begin in range(0, len(gyro), AT_ONCE))
    for i, data in enumerate(sent_by(device, chain.from_iterable(parts))):
        sink.write(Chunk(data, BEGIN_NS + i * (10**9 // RATE_HZ) + 900_000, UNIX_NS))
        if i % 50 == 0:
            sink.flush()
    sink.close()
    return folder


def main() -> None:
    """Run the command line: write the recording in all three formats."""
    folder, hours = Path(sys.argv[1]), float(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    gyro = counts(round(hours * 3600 * RATE_HZ))
    write_npz(folder / "rest.npz", gyro)
    write_csv(folder / "rest.csv", gyro)
    write_mcap(folder / "mcap", gyro)


if __name__ == "__main__":
    main()

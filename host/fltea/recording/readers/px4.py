"""Logs of PX4 (.ulg)."""

from pathlib import Path

from fltea.recording.column_names import axis_of
from fltea.recording.files import listed
from fltea.recording.readers.arrays import of_arrays
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError

PX4_TOPICS = "sensor_combined", "sensor_gyro"
"""Those of a log that are read if none is named, the first that is there."""


def read(path: Path, topic: str) -> Sheet:
    """The gyroscope of a log: `sensor_combined`, or the topic that is named, whose first instance is read."""
    from pyulog import ULog

    log = ULog(str(path))
    there = {data.name for data in log.data_list}
    name = topic or next((known for known in PX4_TOPICS if known in there), "")
    if name not in there:
        asked = f"no topic {topic}" if topic else f"no topic {' or '.join(PX4_TOPICS)}"
        raise UsageError(f"is a PX4 log with {asked}; name one by --topic: {listed(sorted(there))}.")
    data = log.get_dataset(name).data
    sheet = of_arrays(data)
    of_sensor = name.startswith("sensor_gyro")
    names = [f"gyro_{n}" if of_sensor and n in "xyz" else n for n in sheet.names]
    units = ["us" if n == "timestamp" else "rad/s" if axis_of(n) else "" for n in names]
    units = ["m/s^2" if n.startswith("accelerometer_m_s2") else u for n, u in zip(names, units, strict=True)]
    return sheet._replace(names=names, units=units)

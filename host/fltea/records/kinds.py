"""List all kinds of `error` records, with what each of them means and what to do about it.

The documentation shows this list in host/docs/reference/errors.md.
"""

from typing import NamedTuple


class ErrorKind(NamedTuple):
    """What a kind of error means in general, and what to do about it.

    The text of each `error` record has the details.
    """

    meaning: str
    remedy: str


ERROR_KINDS = {
    "no_port": ErrorKind(
        "There is no such port, or nothing listens there; the text lists the ports that exist.",
        "Plug the board in, or give the port that `fltea devices` lists; it is tried again.",
    ),
    "no_permission": ErrorKind(
        "The port belongs to a group that you have not joined.",
        "Join the group that the text names, and log in again.",
    ),
    "port_busy": ErrorKind(
        "Another program has the port.",
        "End the other program, such as a serial monitor; it is tried again.",
    ),
    "open_failed": ErrorKind(
        "The port could not be opened; the text says why.",
        "Check the cable and the address; it is tried again.",
    ),
    "unplugged": ErrorKind(
        "The port, or the I²C bus, was lost while in use.",
        "Plug the board in again; it is opened as soon as it is back.",
    ),
    "silent": ErrorKind(
        "The port is open, but nothing came for 5 s.",
        "Check that this is the board's port, that it has power and this program's firmware (`fltea flash`).",
    ),
    "no_valid_frame": ErrorKind(
        "Bytes came for 5 s, and no valid frame was among them.",
        "Check the baud rate, and flash this program's firmware (`fltea flash`).",
    ),
    "no_hello": ErrorKind(
        "Valid frames came for 5 s without a HELLO, so the scale of the samples is not known.",
        "Reset the board; if that does not help, flash its firmware (`fltea flash`).",
    ),
    "bad_hello": ErrorKind(
        "HELLO states a rate or a scale of 0, so the samples cannot be used.",
        "Flash this program's firmware (`fltea flash`).",
    ),
    "version": ErrorKind(
        "The device speaks another version of the protocol; the text names both.",
        "Flash this program's firmware (`fltea flash`), or use the program's version that the device has.",
    ),
    "bad_lines": ErrorKind(
        "Lines of text hold no sample and are left out; the text counts them, live once a minute.",
        "Look at the line that the text shows; a line that looks like a sample counts as a lost one.",
    ),
    "no_columns": ErrorKind(
        "Lines of text come, but none names the columns.",
        "Name them (`--columns`), by position (`1,2,3`) where there is no header.",
    ),
    "arrival_jump": ErrorKind(
        "Samples without times come later than before and stay late: some were lost.",
        "Let the sender write its time, and name that column (`--time-column`).",
    ),
    "rate_differs": ErrorKind(
        "Samples come at another rate than `--rate`, the IIO driver, or a board's HELLO says.",
        "Give the rate that the text names, or a column of times (`--time-column`). Of a board: correct its "
        "firmware; until both agree, its samples are counted (`sample_counts.rate_differs`) and not used.",
    ),
    "no_trigger": ErrorKind(
        "An IIO device has no trigger; the text lists those that exist.",
        "Make a trigger as the text says, or name one: `iio:NAME?trigger=TRIGGER`.",
    ),
    "no_rate": ErrorKind(
        "The times of samples are uneven or impossible, so the samples are left out.",
        "Give the unit of the times (`--time-unit`), or the rate (`--rate`; for IIO `?rate_hz=`).",
    ),
    "recording_open": ErrorKind(
        "A recording was read while a program writes it; what had reached the disk was read.",
        "Nothing to do; read it again when that program has ended.",
    ),
    "cut_recording": ErrorKind(
        "A recording ends within a line or message, without its index, or has a wrong length; what is there "
        "was read.",
        "Nothing to do; `fltea recover` gives an MCAP file its index again.",
    ),
    "unread_file": ErrorKind(
        "A file of a recording, or a piece of it, cannot be read and is left out; the exit code will be 1.",
        "Copy the file again; remove it if it is empty.",
    ),
    "too_short": ErrorKind(
        "The samples end before the start-up window is full, so there is no estimate.",
        "Record ten minutes at rest, or shorten the window (`--startup`).",
    ),
    "recording_gap": ErrorKind(
        "A replay reached a part that was not recorded, or is damaged; the text says why.",
        "Nothing to do; samples are missing there.",
    ),
    "missing_numbers": ErrorKind(
        "Rows have an empty field or NaN where a number should be; the text counts them.",
        "Nothing to do; if there are many, look at the logger.",
    ),
    "row_times": ErrorKind(
        "A column of times runs back, repeats, is uneven, or contradicts `--rate`.",
        "Check `--rate`; name the column of the device's own clock (`--time-column`).",
    ),
    "reading": ErrorKind(
        "The interpretation of a file is doubtful, or an option changed it; the text says what and why.",
        "Compare it with the logger's settings; `fltea info FILE` shows the reason for each interpretation.",
    ),
    "bag_stamps": ErrorKind(
        "Header stamps of a bag are missing, uneven or run backwards; the text counts them.",
        "Nothing to do; stamps by the sensor's own clock are better.",
    ),
    "bag_messages": ErrorKind(
        "Messages of a bag are damaged or repeated; the text counts them.",
        "If there are many, look at the driver that sent them.",
    ),
    "device_fault": ErrorKind(
        "The device reports a fault of its own or of its sensor; the same one once a minute at most.",
        "Do what the text says.",
    ),
    "sensor_relative": ErrorKind(
        "The sensor is a relative or a clone of the MPU-9250.",
        "Nothing to do; its noise is not an MPU-9250's.",
    ),
    "sensor_unknown": ErrorKind(
        "The sensor's WHO_AM_I is unknown.",
        "Check what the sensor is; its scales may not hold.",
    ),
    "fifo_overflow": ErrorKind(
        "The FIFO of an I²C sensor overflowed: it was not read for longer than it holds samples.",
        "Give the machine less to do; the text counts lost samples.",
    ),
    "fifo_restarted": ErrorKind(
        "The FIFO of an I²C sensor held impossible data and was emptied; the text says why.",
        "Check the wires, and that no other program reads the sensor.",
    ),
    "no_axis": ErrorKind(
        "`--channels` names axes that the source does not have, or whose scale it does not know.",
        "Name axes that the source has.",
    ),
    "constant_axis": ErrorKind(
        "An axis did not change over the start-up window, so it stays invalid.",
        "Check the sensor; if the data are meant to be so, give R (`--r`).",
    ),
    "axis_runaway": ErrorKind(
        "The filter of an axis diverged and starts again.",
        "Keep the sensor at rest; use a guard (`--guard consistent`); check R.",
    ),
    "axis_bound": ErrorKind(
        "The guard held an axis in a quarter of its last 200 samples; its estimate is invalid meanwhile.",
        "Keep the sensor at rest, and compare R with `stats`.",
    ),
    "no_device_estimates": ErrorKind(
        "The device sends samples but no estimates (`--estimate-on device` or `both`).",
        "Flash a firmware that estimates (`fltea flash`), or estimate here (`--estimate-on host`).",
    ),
    "device_skipped": ErrorKind(
        "The device's estimator fell behind and skipped samples.",
        "Lower the rate of the device's estimates in the firmware's settings.",
    ),
    "device_settings": ErrorKind(
        "The device estimates with settings that this program cannot use, so nothing is compared.",
        "Flash this program's firmware (`fltea flash`).",
    ),
    "settings_unused": ErrorKind(
        "Settings of `[estimator]` have no effect, since the device has its own.",
        "Take them out, or change them in the firmware.",
    ),
    "state_unused": ErrorKind(
        "The snapshot of `--state` belongs to other settings or another device; the text says why.",
        "Nothing to do: the start-up window begins, and a new snapshot takes its place.",
    ),
    "state_failed": ErrorKind(
        "The snapshot of `--state` cannot be written; the old one is kept.",
        "Make room on the disk, or give a file that can be written.",
    ),
    "state_refused": ErrorKind(
        "The snapshot of `--state` is damaged; the text says where the file is kept.",
        "Nothing to do: the start-up window begins, and a new snapshot is written.",
    ),
    "too_many_visitors": ErrorKind(
        "More browsers want the live page than `dashboard.visitors` allows.",
        "Close a window that shows the page, or raise `dashboard.visitors`.",
    ),
    "too_many_connections": ErrorKind(
        "The live page has no room for more connections.",
        "End the program that holds the connections; the text names its address.",
    ),
    "too_many_devices": ErrorKind(
        "A source reported more than four device IDs in an hour.",
        "Check board and cable; further IDs get no topics or labels.",
    ),
    "devices_refused": ErrorKind(
        "Messages of a shared source were refused: too many devices, or impossible names.",
        "Bind each account to its own name in the broker's access list, or raise `ingest.devices`.",
    ),
    "frames_overflow": ErrorKind(
        "A device behind a broker sends more frames than can be read; the text names the worst.",
        "Stop the device that floods.",
    ),
    "output_slow": ErrorKind(
        "An output is slow, so reading from the broker waits, and the broker keeps the frames.",
        "Find out why the reader of that output is slow, or remove the output.",
    ),
    "fits_slowed": ErrorKind(
        "This machine is too slow, so the live fits of all devices come less often for a while.",
        "No data are lost; share the devices among several processes if it stays so.",
    ),
    "partition_taken": ErrorKind(
        "This worker takes over the devices of a partition from another worker.",
        "Nothing to do, if the other worker was stopped on purpose.",
    ),
    "partition_left": ErrorKind(
        "This worker cannot read a partition any more and has given it back; the text says why.",
        "Nothing to do unless it happens again: another worker goes on from the snapshots.",
    ),
    "partition_caught_up": ErrorKind(
        "The messages since the snapshots of a partition were processed again; the text counts them.",
        "Nothing to do; records of that time may have been published twice.",
    ),
    "snapshot_failed": ErrorKind(
        "The snapshot of a device cannot be stored in NATS.",
        "Look at the server's limits and log; until then an older snapshot is the newest.",
    ),
    "nats_lost": ErrorKind(
        "No NATS server can be reached, or the connection broke.",
        "Start the server, or check address and network; it is tried again.",
    ),
    "nats_back": ErrorKind(
        "The NATS server is back; devices go on from their snapshots.",
        "Nothing to do.",
    ),
    "nats_mapping": ErrorKind(
        "The NATS server does not map devices to `ingest.partitions` partitions, so frames are lost.",
        "Add the line that the text names to the server's settings, and reload them.",
    ),
    "nats_settings": ErrorKind(
        "The NATS server cannot keep frames (no JetStream, no room), or has other limits.",
        "Change the server's settings as the text says, or start a worker with `ingest.change_limits`.",
    ),
    "nats_clock": ErrorKind(
        "The clock of the NATS server differs from this machine's by seconds.",
        "Set both clocks by NTP; records have the server's time, and no sample is lost.",
    ),
    "line_broken": ErrorKind(
        "One device of many failed; the text says why, and the other devices go on.",
        "Do what the text says; it is tried again after a minute.",
    ),
    "output_lost": ErrorKind(
        "An output failed, or its reader ended; the other outputs go on.",
        "Restart the program to have that output back.",
    ),
    "page_fault": ErrorKind(
        "The live page has a bug.",
        "Load the page again, and report the text.",
    ),
    "broker_lost": ErrorKind(
        "The MQTT broker cannot be reached, or the connection broke.",
        "Start the broker, or check address and network; it is tried again.",
    ),
    "broker_refused": ErrorKind(
        "The broker refuses user and password, or its access list forbids a topic.",
        "Correct the password, or let the user write to the topics that the text names.",
    ),
    "broker_certificate": ErrorKind(
        "The broker's certificate is not accepted, or TLS failed.",
        "Give the authority that signed it (`mqtt.ca`), and the name in the certificate as address.",
    ),
    "broker_plain": ErrorKind(
        "The password goes to another machine without TLS.",
        "Use `mqtts://` if the broker can.",
    ),
    "broker_back": ErrorKind(
        "The broker is back; the text says after how long, and how many records were lost.",
        "Nothing to do.",
    ),
    "clock_wrong": ErrorKind(
        "The machine's clock says a date before 1970 or after 2099; times count from the machine's start.",
        "Set the clock: give the machine a time server, or a battery for its clock.",
    ),
    "disk_full": ErrorKind(
        "No room or quota is left: the recording stopped, or the history of `fltea fleet` waits.",
        "Make room; it then continues automatically.",
    ),
    "record_failed": ErrorKind(
        "The recording stopped because the disk failed; it is tried again every 5 s.",
        "Check the disk and the folder that the text names.",
    ),
    "record_deleted": ErrorKind(
        "Another program deleted a file of a recording, or cut it short, while it was written.",
        "Find what did it. The recording goes on in a new file, in the same folder.",
    ),
    "record_moved": ErrorKind(
        "Another program moved a file of a recording while it was written; nothing is lost.",
        "Nothing to do; the recording goes on in a new file, in the same folder.",
    ),
    "record_resumed": ErrorKind(
        "The recording goes on in a new file; the text says how much was not recorded.",
        "Nothing to do.",
    ),
    "history_lost": ErrorKind(
        "The history of `fltea fleet` cannot be written or read; 50,000 rows wait in memory.",
        "Check the database's file or server, and the account; it is tried again.",
    ),
    "history_back": ErrorKind(
        "The history is written again; the text says how many rows were lost.",
        "Nothing to do.",
    ),
}
"""All kinds of errors by name, in the order of processing, from the port to the outputs."""

FILE_TROUBLES = ("recording_open", "cut_recording", "unread_file", "recording_gap")
"""Kinds of errors after which a part of a file is unread, so that the file may hold more samples."""

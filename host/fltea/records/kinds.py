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
        "Plug the board in, or give the port that `fltea devices` lists; the program tries again.",
    ),
    "no_permission": ErrorKind(
        "The port belongs to a group that you have not joined.",
        "Join the group that the text names, and log in again.",
    ),
    "port_busy": ErrorKind(
        "Another program has the port.",
        "End the other program, such as a serial monitor; the program tries again.",
    ),
    "open_failed": ErrorKind(
        "The port could not be opened; the text says why.",
        "Check the cable and the address; the program tries again.",
    ),
    "unplugged": ErrorKind(
        "The connection to the port, or to the I²C bus, was lost while the program used it.",
        "Plug the board in again; the program opens the port as soon as it is back.",
    ),
    "silent": ErrorKind(
        "The port is open, but nothing came for 5 s.",
        "Check that this is the board's port, that it has power and this program's firmware (`fltea flash`).",
    ),
    "no_valid_frame": ErrorKind(
        "Bytes came for 5 s, but there was no valid frame among them.",
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
        "The device uses another version of the protocol; the text names both versions.",
        "Flash this program's firmware (`fltea flash`), or use that version of the program that matches "
        "the device.",
    ),
    "bad_lines": ErrorKind(
        "Lines of text hold no sample and are left out; the message counts them (of a live source once a "
        "minute).",
        "Look at the line that the message shows; a line that looks like a sample counts as a lost sample.",
    ),
    "no_columns": ErrorKind(
        "Lines of text come, but none names the columns.",
        "Name the columns (`--columns`), by position (`1,2,3`) if there is no header.",
    ),
    "arrival_jump": ErrorKind(
        "Samples that state no time arrive later than before, and stay late: samples were lost.",
        "Let the sender write a time with each sample, and name the column of times (`--time-column`).",
    ),
    "rate_differs": ErrorKind(
        "Samples come at a rate other than the one that `--rate`, the IIO driver, or a board's HELLO states.",
        "Give the rate that the text names, or a column of times (`--time-column`). If it is a board, "
        "correct its firmware; until both rates agree, its samples are counted "
        "(`sample_counts.rate_differs`) and not used.",
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
        "A recording was read while a program was writing it; only what had reached the disk was read.",
        "Nothing to do; read it again when that program has ended.",
    ),
    "cut_recording": ErrorKind(
        "A recording ends in the middle of a line or message, lacks its index, or has a wrong length; all "
        "that is there was read.",
        "Nothing to do; `fltea recover` gives an MCAP file its index again.",
    ),
    "unread_file": ErrorKind(
        "A file of a recording, or a part of such a file, cannot be read and is left out; the exit code "
        "will be 1.",
        "Copy the file again; remove it if it is empty.",
    ),
    "too_short": ErrorKind(
        "The samples end before the start-up window is full, so there is no estimate.",
        "Record ten minutes at rest, or shorten the window (`--startup`).",
    ),
    "recording_gap": ErrorKind(
        "A replay has reached a part of the recording that is missing or damaged; the text says why.",
        "Nothing to do; the samples of this part are missing.",
    ),
    "missing_numbers": ErrorKind(
        "Rows have an empty field or NaN where a number should be; the text counts them.",
        "Nothing to do; if there are many, look at the logger.",
    ),
    "row_times": ErrorKind(
        "The times in a column run backwards, repeat, are uneven, or contradict `--rate`.",
        "Check `--rate`; name the column of the device's own clock (`--time-column`).",
    ),
    "reading": ErrorKind(
        "The interpretation of a file is doubtful, or an option changed it; the text says what and why.",
        "Compare it with the logger's settings; `fltea info FILE` shows the reason for each interpretation.",
    ),
    "bag_stamps": ErrorKind(
        "Header stamps of a bag are missing, uneven or run backwards; the text counts them.",
        "Nothing to do; header stamps by the sensor's own clock would avoid this.",
    ),
    "bag_messages": ErrorKind(
        "Messages of a bag are damaged or repeated; the text counts them.",
        "If there are many, look at the driver that sent them.",
    ),
    "device_fault": ErrorKind(
        "The device reports a fault of its own or of its sensor. The same fault is reported at most once a "
        "minute.",
        "Do what the text says.",
    ),
    "sensor_relative": ErrorKind(
        "The sensor is a relative or a clone of the MPU-9250.",
        "Nothing to do, but do not expect the noise of an MPU-9250.",
    ),
    "sensor_unknown": ErrorKind(
        "The sensor's WHO_AM_I is unknown.",
        "Check what the sensor is; its scales may not hold.",
    ),
    "fifo_overflow": ErrorKind(
        "The FIFO of an I²C sensor overflowed: it was full before this program read it.",
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
        "All samples of an axis in the start-up window are equal, so its estimates stay invalid.",
        "Check the sensor; if the data are meant to be constant, give R (`--r`).",
    ),
    "axis_runaway": ErrorKind(
        "The filter of an axis diverged and was started again.",
        "Keep the sensor at rest; use a guard (`--guard consistent`); check R.",
    ),
    "axis_bound": ErrorKind(
        "The guard intervened in a quarter of an axis's last 200 samples; until that ends, the axis's "
        "estimate is invalid.",
        "Keep the sensor at rest, and check the R that `stats` shows.",
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
        "Settings of `[estimator]` have no effect, since the device estimates with its own settings.",
        "Remove these settings, or change them in the firmware.",
    ),
    "state_unused": ErrorKind(
        "The snapshot of `--state` belongs to other settings or another device; the text says why.",
        "Nothing to do: the start-up window begins again, and a new snapshot replaces this one.",
    ),
    "state_failed": ErrorKind(
        "The snapshot of `--state` cannot be written; the old one is kept.",
        "Make room on the disk, or give a file that can be written.",
    ),
    "state_refused": ErrorKind(
        "The snapshot of `--state` is damaged; the text says where the file is kept.",
        "Nothing to do: the start-up window begins again, and a new snapshot is written.",
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
        "An output is slow, so the program stops reading from the broker, and the broker keeps the frames.",
        "Find out why the reader of that output is slow, or remove the output.",
    ),
    "fits_slowed": ErrorKind(
        "This machine is too slow, so the live fits of all devices come less often for a while.",
        "No data are lost; if this does not end, share the devices among several processes.",
    ),
    "partition_taken": ErrorKind(
        "This worker takes over the devices of a partition (a fixed part of all devices) from another "
        "worker.",
        "Nothing to do, if the other worker was stopped on purpose.",
    ),
    "partition_left": ErrorKind(
        "This worker cannot read a partition any more and has given it back; the text says why.",
        "Nothing to do unless it happens again: another worker continues from the snapshots.",
    ),
    "partition_caught_up": ErrorKind(
        "A worker took a partition over, and processed all messages after the snapshots a second time; the "
        "text counts them.",
        "Nothing to do; records of that time may have been published twice.",
    ),
    "snapshot_failed": ErrorKind(
        "The snapshot of a device cannot be stored in NATS.",
        "Look at the server's limits and log; until this is mended, the newest stored snapshot is an older "
        "one.",
    ),
    "nats_lost": ErrorKind(
        "No NATS server can be reached, or the connection broke.",
        "Start the server, or check address and network; the program tries again.",
    ),
    "nats_back": ErrorKind(
        "The NATS server is back; the devices continue from their snapshots.",
        "Nothing to do.",
    ),
    "nats_mapping": ErrorKind(
        "The NATS server does not assign the devices to `ingest.partitions` partitions, so frames are lost.",
        "Add the line that the text names to the server's settings, and reload them.",
    ),
    "nats_settings": ErrorKind(
        "The NATS server cannot keep frames (no JetStream, no room), or has limits other than the settings.",
        "Change the server's settings as the text says, or start a worker with `ingest.change_limits`.",
    ),
    "nats_clock": ErrorKind(
        "The clock of the NATS server differs from this machine's by seconds.",
        "Set both clocks by NTP; records have the server's time, and no sample is lost.",
    ),
    "line_broken": ErrorKind(
        "One device of many failed; the text says why. The other devices are not affected.",
        "Do what the text says; the program tries again after a minute.",
    ),
    "output_lost": ErrorKind(
        "An output failed, or the program that reads it has ended; the other outputs are not affected.",
        "Restart this program to get the output back.",
    ),
    "page_fault": ErrorKind(
        "The live page has a bug.",
        "Load the page again, and report the text.",
    ),
    "broker_lost": ErrorKind(
        "The MQTT broker cannot be reached, or the connection broke.",
        "Start the broker, or check address and network; the program tries again.",
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
        "The machine's clock shows a date before 1970 or after 2099; until it is set, times count from the "
        "machine's start.",
        "Set the clock: give the machine a time server, or a battery for its clock.",
    ),
    "disk_full": ErrorKind(
        "The disk or the quota is full: the recording stopped, or the history of `fltea fleet` is not "
        "written for now.",
        "Make room; the program then continues automatically.",
    ),
    "record_failed": ErrorKind(
        "The recording stopped because the disk failed; the program tries again every 5 s.",
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
        "Check the database's file or server, and the account; the program tries again.",
    ),
    "history_back": ErrorKind(
        "The history is written again; the text says how many rows were lost.",
        "Nothing to do.",
    ),
}
"""All kinds of errors by name, in the order of processing, from the port to the outputs."""

FILE_TROUBLES = ("recording_open", "cut_recording", "unread_file", "recording_gap")
"""Kinds of errors after which a part of a file is unread, so that the file may hold more samples."""

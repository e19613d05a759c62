"""Every kind of `error` record: what it means, and what a person does about it.

The table of host/docs/reference/errors.md is generated from this list (`make gen`). A test compares it with
the code.
"""

from typing import NamedTuple


class ErrorKind(NamedTuple):
    """A sentence each, without what only the text of the record can say."""

    meaning: str
    remedy: str


ERROR_KINDS = {
    "no_port": ErrorKind(
        "There is no such port, or nobody listens there; the text lists the ports that exist.",
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
        "The port could not be opened for another reason, which the text gives.",
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
        "Valid frames came for 5 s, but no HELLO, so nobody knows what the samples mean.",
        "Reset the board; if that does not help, flash its firmware (`fltea flash`).",
    ),
    "bad_hello": ErrorKind(
        "HELLO states a rate or a scale of 0, so the samples cannot be used.",
        "Flash the firmware of this program (`fltea flash`).",
    ),
    "version": ErrorKind(
        "The device speaks another version of the protocol; the text names both.",
        "Flash the firmware of this program (`fltea flash`), or use the program that fits the device.",
    ),
    "bad_lines": ErrorKind(
        "Lines of text hold no sample and are left out; the text counts them, live once a minute.",
        "Look at the line that the text shows; a line that looks like a sample counts as a lost one.",
    ),
    "no_columns": ErrorKind(
        "Lines of text come, but no line names the columns, so nobody knows which numbers are the axes.",
        "Name the columns (`--columns`), by their positions (`1,2,3`) where there is no header.",
    ),
    "arrival_jump": ErrorKind(
        "Samples without a time of their own come later than before and stay late: some were lost.",
        "Let the sender write its time and name it (`--time-column`), so that gaps are seen.",
    ),
    "rate_differs": ErrorKind(
        "Samples come at another rate than `--rate`, or the driver of an IIO device, says.",
        "Lines of text: give the rate that the text names, or a column of times (`--time-column`).",
    ),
    "no_trigger": ErrorKind(
        "Nothing tells an IIO device when to take a sample; the text lists the triggers that exist.",
        "Make a trigger as the text says, or name one: `iio:NAME?trigger=TRIGGER`.",
    ),
    "no_rate": ErrorKind(
        "The times of samples are uneven or tell no rate that a gyroscope has: the samples are left out.",
        "Give the unit of the times (`--time-unit`), or the rate (`--rate`; for IIO `?rate_hz=`).",
    ),
    "cut_recording": ErrorKind(
        "A recording ends in the middle of a line, or without its index; all that reached the disk was read.",
        "Nothing has to be done; `fltea recover` gives an MCAP file its index again.",
    ),
    "unread_file": ErrorKind(
        "A file among those of a recording cannot be read, and is in no figure; the exit code will be 1.",
        "Fetch the file again from where it came; if it is empty, nothing was recorded in it: remove it.",
    ),
    "recording_gap": ErrorKind(
        "A replay came to a place where something was not recorded; the text says why.",
        "Nothing can be done now; mind the gap when you judge what follows it.",
    ),
    "missing_numbers": ErrorKind(
        "Rows have an empty field or NaN where a number should be; the text counts them.",
        "Nothing has to be done; if there are many, look at the logger.",
    ),
    "row_times": ErrorKind(
        "A column of times runs back or repeats times, or with `--rate` is uneven or tells another rate.",
        "Check `--rate`; name a column of the device's own clock (`--time-column`), if there is one.",
    ),
    "bag_stamps": ErrorKind(
        "Header stamps of a bag are missing, uneven or run backwards; the text counts them.",
        "Nothing has to be done; stamps by the sensor's own clock would make rate and gaps surer.",
    ),
    "bag_messages": ErrorKind(
        "Messages of a bag cannot be used, or stand there twice; the text counts them.",
        "Look at the driver that sent them, if there are many.",
    ),
    "device_fault": ErrorKind(
        "The device reports a fault of its own or of its sensor; the same one once a minute at most.",
        "Do what the text says; host and firmware name the same faults.",
    ),
    "sensor_relative": ErrorKind(
        "The sensor is a relative or a clone of the MPU-9250; reported once.",
        "Nothing has to be done, if you know that its noise is another sensor's.",
    ),
    "sensor_unknown": ErrorKind(
        "The sensor's WHO_AM_I is that of no chip that is known.",
        "Check what the sensor is; its scales may not hold.",
    ),
    "fifo_overflow": ErrorKind(
        "The FIFO of a sensor on I²C ran over, because nobody read it for more than a third of a second.",
        "Relieve the machine; the text says how many samples are lost.",
    ),
    "fifo_restarted": ErrorKind(
        "The FIFO of a sensor on I²C was emptied, since it could not be believed; the text says why.",
        "Check the wires, and that no other program reads the sensor.",
    ),
    "no_axis": ErrorKind(
        "`--channels` names axes that the source does not have, or of which it does not know the scale.",
        "Name axes that the source has.",
    ),
    "constant_axis": ErrorKind(
        "An axis did not change over the start-up window, so R is not known and the axis stays invalid.",
        "Check that the sensor is alive; if such data are meant, give R (`--r`).",
    ),
    "axis_runaway": ErrorKind(
        "The estimate of an axis ran away; the axis begins again.",
        "Use a guard (`--guard consistent`), and check that the sensor is at rest and R fits it.",
    ),
    "axis_bound": ErrorKind(
        "An axis needed the guard in over a quarter of its last 200 samples; it is invalid until that ends.",
        "Keep the sensor at rest, and compare R with `stats`.",
    ),
    "no_device_estimates": ErrorKind(
        "With `--estimate-on device` or `both`: samples came for 5 s, no word of estimates; ends `--once`.",
        "Flash a firmware that estimates (`fltea flash`), or estimate here (`--estimate-on host`).",
    ),
    "device_skipped": ErrorKind(
        "The device's estimator had fallen behind and skipped samples; reported once a minute at most.",
        "Lower the rate of the device's estimates in the firmware's settings.",
    ),
    "device_settings": ErrorKind(
        "The device estimates with settings that this program cannot use, so nothing is compared.",
        "Flash the firmware of this program (`fltea flash`).",
    ),
    "settings_unused": ErrorKind(
        "Settings of `[estimator]` were changed for nothing, since the device has its own; reported once.",
        "Take them out, or change them in the firmware.",
    ),
    "state_unused": ErrorKind(
        "The snapshot of `--state` does not fit; the text says why, and the start-up window begins.",
        "Nothing has to be done: a new snapshot takes its place.",
    ),
    "state_failed": ErrorKind(
        "The snapshot of `--state` cannot be written; the old one is kept.",
        "Make room on the disk, or give a file that can be written.",
    ),
    "state_refused": ErrorKind(
        "The snapshot of `--state` is not sound; the text says what is wrong, and where the file is kept.",
        "Nothing has to be done: the start-up window begins, and a new snapshot is written.",
    ),
    "too_many_visitors": ErrorKind(
        "More browsers want the live page than `dashboard.visitors` allows; reported once a minute at most.",
        "Close a window that shows the page, or raise `dashboard.visitors`.",
    ),
    "too_many_connections": ErrorKind(
        "The live page has no room for more connections; reported once a minute at most.",
        "Look for a program that connects to it and asks for nothing: the text names the address.",
    ),
    "too_many_devices": ErrorKind(
        "A source said more than four different things of itself within an hour; reported once an hour.",
        "Check the board and the line: further ones get no topics or labels.",
    ),
    "devices_refused": ErrorKind(
        "Messages of a shared source were not taken: too many devices, or names that no device has.",
        "Let the broker's access list bind each account to its own name, or raise `ingest.devices`.",
    ),
    "frames_overflow": ErrorKind(
        "Frames of a device behind a broker came faster than any makes them, or were left when the program "
        "ended; the text names the worst of them.",
        "Stop the device that floods; end the program when nothing waits.",
    ),
    "output_slow": ErrorKind(
        "An output takes nothing, so nothing more is read from the broker, which keeps it as far as it has "
        "room.",
        "Look what holds the reader of that output up, or leave the output away.",
    ),
    "fits_slowed": ErrorKind(
        "This machine does not keep up, so the live fits of all devices come more rarely for a while.",
        "Nothing is lost by it; share the devices among several processes if it stays so.",
    ),
    "partition_taken": ErrorKind(
        "This worker goes on with the devices of a partition that another served before.",
        "Nothing has to be done; look why the other ended, if it was not asked to.",
    ),
    "partition_left": ErrorKind(
        "This worker cannot read a partition any more and has given it back; the text says why.",
        "Nothing has to be done unless it happens again: a worker goes on from the snapshots.",
    ),
    "partition_caught_up": ErrorKind(
        "The messages since the snapshots of a partition were walked again; the text counts them.",
        "Nothing has to be done; records of that time may have been published twice.",
    ),
    "snapshot_failed": ErrorKind(
        "The snapshot of a device cannot be kept in the store of NATS.",
        "Look at the server's limits and log; without it another worker begins with an older one.",
    ),
    "nats_lost": ErrorKind(
        "No NATS server can be reached, or the connection broke; reported once an outage.",
        "Start the server, or check address and network; it is tried again.",
    ),
    "nats_back": ErrorKind(
        "The NATS server is back; devices go on from their snapshots.",
        "Nothing has to be done.",
    ),
    "nats_mapping": ErrorKind(
        "The NATS server does not map devices to `ingest.partitions` partitions, so frames are lost.",
        "Write the line that the text names into the server's settings, and load them again.",
    ),
    "nats_settings": ErrorKind(
        "The NATS server cannot keep frames (no JetStream, no room), or keeps them by other limits.",
        "The text names them: change the server's settings, or start a worker with `ingest.change_limits`.",
    ),
    "nats_clock": ErrorKind(
        "The clock of the NATS server differs from this machine's by seconds.",
        "Set both clocks by NTP; times of records are the server's, and no sample is lost.",
    ),
    "line_broken": ErrorKind(
        "One device of many cannot be walked with these settings, or by a fault of the program's own.",
        "Do what the text says; it is tried again after a minute, and the other devices go on.",
    ),
    "output_lost": ErrorKind(
        "An output cannot go on, or its reader left; the other outputs do.",
        "Start the program again to have that output back.",
    ),
    "page_fault": ErrorKind(
        "The live page has a fault of its own; reported once a minute at most.",
        "Load the page again, and report the text.",
    ),
    "broker_lost": ErrorKind(
        "The MQTT broker cannot be reached, or the connection broke; reported once an outage.",
        "Start the broker, or check address and network; it is tried again.",
    ),
    "broker_refused": ErrorKind(
        "The broker does not take user and password, or its access list forbids a topic.",
        "Correct the password, or let the user write to the topics that the text names.",
    ),
    "broker_certificate": ErrorKind(
        "The broker's certificate is not accepted, or TLS could not be agreed on.",
        "Give the authority that signed it (`mqtt.ca`), and the name that stands in it.",
    ),
    "broker_plain": ErrorKind(
        "The password goes to another machine without TLS.",
        "Use `mqtts://` if the broker can.",
    ),
    "broker_back": ErrorKind(
        "The broker is back; the text says after how long, and how many records were lost.",
        "Nothing has to be done.",
    ),
    "disk_full": ErrorKind(
        "The recording stopped, or the history of `fltea fleet` waits, for lack of room or of quota; "
        "all else goes on.",
        "Make room; it then goes on by itself.",
    ),
    "record_failed": ErrorKind(
        "The recording stopped because of another failure of the disk, and is tried again every 5 s.",
        "Check the disk and the folder that the text names.",
    ),
    "record_resumed": ErrorKind(
        "The recording goes on in a new file; the text says how much was not recorded.",
        "Nothing has to be done.",
    ),
    "history_lost": ErrorKind(
        "The history of `fltea fleet` cannot be written or read; rows wait in memory, and are lost beyond "
        "50,000.",
        "Check the database's file or server, and the account; it is tried again.",
    ),
    "history_back": ErrorKind(
        "The history is written again; the text says how many rows were lost.",
        "Nothing has to be done.",
    ),
}
"""All kinds by their names, in the order of the way from the port to the outputs."""

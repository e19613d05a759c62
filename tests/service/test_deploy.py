"""Tests of the udev rule, of the systemd unit, and of the script that installs both. Here the script installs
into a test's folder.
"""

import os
import re
import shutil
import stat
import subprocess
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from fltea.diagnostics.folders import SERVICE_USER
from fltea.machine.doctor.checks_host import RULE, UNIT
from fltea.service.descriptors import MOST
from fltea.settings.config import load_config, load_configs
from fltea.wire.transport import DUE_NATIVE_PORT, DUE_PROGRAMMING_PORT, DUE_VENDORS

from tests.rig.host_support import ROOT
from tests.rig.toolchain import needed

DEPLOY = ROOT / "tools/deploy"
SCRIPT = DEPLOY / "service.sh"
LARGEST_EXPOSURE = 20
"""Largest accepted "exposure level" of the service that `systemd-analyze security` shows, in tenths.

The service's exposure level is 16 now, mostly since the service needs the network and the serial ports.
"""

CLAUSE = re.compile(r'([A-Z_]+(?:\{[A-Za-z_]+\})?)(==|!=|\+=|=)"([^"]*)"')
MATCHES = {"ACTION", "SUBSYSTEM", "KERNEL", "ATTRS{idVendor}", "ATTRS{idProduct}", "ENV{ID_SERIAL_SHORT}"}
ACTIONS = {
    "GOTO",
    "LABEL",
    "ENV{ID_MM_DEVICE_IGNORE}",
    "ENV{ID_MM_PORT_IGNORE}",
    "GROUP",
    "MODE",
    "TAG",
    "SYMLINK",
    "RUN",
}


def run(*command: str | Path, **environment: str | Path) -> subprocess.CompletedProcess[str]:
    settings = os.environ | {name: str(value) for name, value in environment.items()}
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=settings, timeout=60)


def script(action: str, **environment: str | Path) -> subprocess.CompletedProcess[str]:
    return run(SCRIPT, action, **environment)


SHUT = "umask 077; exec "
"""The beginning of a command that runs as in the shell of a careful administrator, where only the user may
read new files.
"""

INSTALLER = """#!/bin/sh
# Does to the umask what Python's venv and pip do to it: nothing.
case "$*" in
"-m venv "*) mkdir -p "$3/bin" "$3/lib" && : > "$3/pyvenv.cfg" && cp "$0" "$3/bin/python" ;;
"-m pip "*)
    here=$(dirname "$0")
    echo > "$here/../lib/module.py"
    echo '#!/bin/sh' > "$here/fltea"
    chmod +x "$here/fltea" ;;
esac
"""


def modes(folder: Path) -> dict[str, int]:
    """Return the permissions of a folder and of everything in it, by path."""
    paths = (folder, *folder.rglob("*"))
    return {str(path.relative_to(folder)): stat.S_IMODE(path.stat().st_mode) for path in paths}


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    done = script("install", DESTDIR=tmp_path / "tree", PREFIX="/usr/lib/fltea")
    assert (done.returncode, done.stderr) == (0, "")
    return tmp_path / "tree"


def rules() -> list[list[tuple[str, str, str]]]:
    """Return each line of the udev rule as its clauses: key, operator and value."""
    lines = (DEPLOY / RULE).read_text("utf-8").splitlines()
    found = []
    for line in lines:
        if line and not line.startswith("#"):
            clauses = [part.strip() for part in line.split(", ")]
            assert all(CLAUSE.fullmatch(clause) for clause in clauses), line
            found.append([match.groups() for clause in clauses if (match := CLAUSE.fullmatch(clause))])
    return found  # type: ignore[return-value]


class Device(dict[str, str]):
    """The properties of a device in udev. `apply` changes them as the udev rule says."""

    def apply(self) -> "Device":
        label = ""
        for clauses in rules():
            if label and ("LABEL", "=", label) not in clauses:
                continue
            label = ""
            for key, sign, value in clauses:
                if sign in ("==", "!="):
                    if any(self._is(key, one) for one in value.split("|")) != (sign == "=="):
                        break
                elif key == "GOTO":
                    label = value
                elif key != "LABEL":
                    self[key] = re.sub(r"\$env\{(\w+)\}", lambda m: self[f"ENV{{{m[1]}}}"], value)
        assert not label, f"there is no label {label}"
        return self

    def _is(self, key: str, pattern: str) -> bool:
        value = self.get(key, "")
        return fnmatchcase(value, pattern)


def due(vendor: int, product: int, subsystem: str = "tty", action: str = "add") -> Device:
    return Device(
        {
            "ACTION": action,
            "SUBSYSTEM": subsystem,
            "ATTRS{idVendor}": f"{vendor:04x}",
            "ATTRS{idProduct}": f"{product:04x}",
            "ENV{ID_SERIAL_SHORT}": "7523",
        }
    ).apply()


def test_the_rule_is_made_of_keys_that_udev_knows() -> None:
    for clauses in rules():
        for key, sign, _ in clauses:
            assert key in (MATCHES if sign in ("==", "!=") else ACTIONS)


@pytest.mark.parametrize("vendor", DUE_VENDORS)
def test_the_programming_port_gets_name_group_and_peace(vendor: int) -> None:
    port = due(vendor, DUE_PROGRAMMING_PORT)
    assert port["SYMLINK"] == "fltea-7523"
    assert (port["GROUP"], port["MODE"]) == ("dialout", "0660")
    assert port["ENV{ID_MM_DEVICE_IGNORE}"] == port["ENV{ID_MM_PORT_IGNORE}"] == "1"
    board = due(vendor, DUE_PROGRAMMING_PORT, "usb", "change")
    assert board["ENV{ID_MM_DEVICE_IGNORE}"] == "1"
    assert "MODE" not in board


def test_the_native_port_gets_no_name_of_ours() -> None:
    port = due(DUE_VENDORS[0], DUE_NATIVE_PORT)
    assert "SYMLINK" not in port
    assert port["ENV{ID_MM_DEVICE_IGNORE}"] == "1"


@pytest.mark.parametrize(
    "device", [(0x0403, DUE_PROGRAMMING_PORT), (DUE_VENDORS[0], 0x0043), (DUE_VENDORS[0], 0x003D, "hidraw")]
)
def test_other_devices_are_left_alone(device: tuple[int, int]) -> None:
    assert not {"MODE", "GROUP", "SYMLINK", "ENV{ID_MM_DEVICE_IGNORE}"} & due(*device).keys()
    assert "MODE" not in due(DUE_VENDORS[0], DUE_PROGRAMMING_PORT, action="remove")


def of_kernel(subsystem: str, kernel: str, action: str = "add") -> Device:
    return Device({"ACTION": action, "SUBSYSTEM": subsystem, "KERNEL": kernel}).apply()


@pytest.mark.parametrize("name", ["iio:device0", "iio:device12", "trigger0"])
def test_a_sensor_of_the_kernel_and_its_trigger_may_be_set_up_by_the_group(name: str) -> None:
    device = of_kernel("iio", name)
    assert (device["GROUP"], device["MODE"]) == ("dialout", "0660")
    assert "chgrp -R dialout /sys%p" in device["RUN"]
    assert "SYMLINK" not in device
    assert "RUN" not in of_kernel("iio", name, "remove")


def test_a_timer_that_is_loaded_has_a_trigger() -> None:
    assert of_kernel("module", "iio_trig_hrtimer")["RUN"].endswith(
        " /sys/kernel/config/iio/triggers/hrtimer/fltea"
    )
    assert "RUN" not in of_kernel("module", "usbcore")


def test_udev_itself_takes_the_rule() -> None:
    udevadm = shutil.which("udevadm")
    if udevadm is None:
        pytest.skip("udevadm is not installed; Debian 12's could not do it anyway")
    version = int(re.findall(r"\d+", run(udevadm, "--version").stdout)[0])
    if version < 254:
        pytest.skip(f"udevadm verify came with version 254, and this is {version}")
    done = run(udevadm, "verify", DEPLOY / RULE)
    assert done.returncode == 0, done.stdout + done.stderr


def test_everything_is_written_into_the_tree(tree: Path) -> None:
    files = sorted(f"/{path.relative_to(tree)}" for path in tree.rglob("*") if path.is_file())
    assert files == [
        "/etc/fltea/fltea.toml",
        "/etc/fltea/mqtt.env",
        f"/etc/systemd/system/{UNIT}",
        "/etc/sysusers.d/fltea.conf",
        f"/etc/udev/rules.d/{RULE}",
    ]
    assert stat.S_IMODE((tree / "etc/fltea/mqtt.env").stat().st_mode) == 0o600
    unit = (tree / "etc/systemd/system" / UNIT).read_text("utf-8")
    assert "\nExecStart=/usr/lib/fltea/bin/fltea run --config /etc/fltea/fltea.toml --format none\n" in unit


def test_what_is_installed_under_a_strict_umask_can_be_read(tmp_path: Path) -> None:
    done = run("sh", "-c", f"{SHUT}{SCRIPT} install", DESTDIR=tmp_path / "tree")
    assert (done.returncode, done.stderr) == (0, "")
    found = modes(tmp_path / "tree")
    assert found.pop("etc/fltea/mqtt.env") == 0o600  # the file contains a password
    assert set(found.values()) == {0o755, 0o644}


def test_a_program_installed_under_a_strict_umask_is_run_by_any_user(tmp_path: Path) -> None:
    """Any user can run the installed program. The program is installed twice. In between, the test makes
    files unreadable for other users, and the second installation replaces these files.
    """
    python, program = tmp_path / "python", tmp_path / "opt/program"
    python.write_text(INSTALLER)
    python.chmod(0o700)
    wanted = {".": 0o755, "bin": 0o755, "lib": 0o755, "bin/fltea": 0o755}
    for _ in range(2):
        done = run("sh", "-c", f"{SHUT}{SCRIPT} program", PREFIX=program, PYTHON=python)
        assert (done.returncode, done.stderr) == (0, "")
        assert modes(program) == wanted | {
            "bin/python": 0o755,
            "lib/module.py": 0o644,
            "pyvenv.cfg": 0o644,
        }
        assert stat.S_IMODE(program.parent.stat().st_mode) == 0o755
        for path in program.rglob("*"):
            path.chmod(path.stat().st_mode & 0o700)
        program.chmod(0o700)


def test_the_unit_allows_as_many_descriptors_as_the_program_would_take() -> None:
    assert f"\nLimitNOFILE={MOST}\n" in (DEPLOY / UNIT).read_text("utf-8")


def test_again_it_keeps_settings_and_secrets_and_renews_the_rest(tree: Path) -> None:
    (tree / "etc/fltea/fltea.toml").write_text("mine")
    (tree / "etc/fltea/mqtt.env").write_text("mine")
    (tree / "etc/udev/rules.d" / RULE).write_text("old")
    done = script("install", DESTDIR=tree)
    assert done.returncode == 0
    assert (tree / "etc/fltea/fltea.toml").read_text() == (tree / "etc/fltea/mqtt.env").read_text() == "mine"
    assert (tree / "etc/udev/rules.d" / RULE).read_text("utf-8") == (DEPLOY / RULE).read_text("utf-8")
    assert f"kept {tree}/etc/fltea/fltea.toml as it is" in done.stdout


def test_removed_again_it_leaves_what_is_the_users(tree: Path) -> None:
    for _ in range(2):
        done = script("uninstall", DESTDIR=tree)
        assert (done.returncode, done.stderr) == (0, "")
    files = sorted(f"/{path.relative_to(tree)}" for path in tree.rglob("*") if path.is_file())
    assert files == ["/etc/fltea/fltea.toml", "/etc/fltea/mqtt.env"]


def test_the_rule_alone(tmp_path: Path) -> None:
    assert script("udev", DESTDIR=tmp_path).returncode == 0
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == [RULE]


def test_without_systemd_it_refuses_and_says_what_to_do_instead() -> None:
    if Path("/run/systemd/system").is_dir():
        pytest.skip("this machine is run by systemd, and nothing is to be installed on it")
    done = script("install", DESTDIR="")
    assert done.returncode == 1
    assert "this machine is not run by systemd" in done.stderr
    assert "DESTDIR=FOLDER" in done.stderr
    assert script("nonsense").returncode == 1


def test_the_settings_are_valid_also_with_every_comment_taken_out(tmp_path: Path) -> None:
    shipped = DEPLOY / "fltea.toml"
    assert load_config(shipped, {}).state.file == "/var/lib/fltea/state"
    file = tmp_path / "all.toml"
    file.write_text(re.sub(r"^# (?=\[|\w+ = )", "", shipped.read_text("utf-8"), flags=re.MULTILINE))
    configs = load_configs(file, {})
    assert [config.name for config in configs] == ["bench", "pi"]
    config = configs[0]
    assert config.record.folder == "/var/lib/fltea/recordings"
    assert config.mqtt.broker
    assert config.dashboard.address
    assert config.metrics.address


def test_the_unit_fits_the_program() -> None:
    unit = (DEPLOY / UNIT).read_text("utf-8")
    users = (DEPLOY / "fltea.sysusers").read_text("utf-8")
    assert f"User={SERVICE_USER}\n" in unit
    assert f"\nu {SERVICE_USER} - " in users
    for group in re.findall(r"SupplementaryGroups=(.*)", unit)[0].split():
        assert f"\ng {group} -\n" in users  # systemd does not start a service that names a missing group
    for wanted in (
        "StartLimitIntervalSec=0",
        "RestartPreventExitStatus=2",
        "EnvironmentFile=-/etc/fltea/mqtt.env",
    ):
        assert f"\n{wanted}\n" in unit
    drivers = set(re.findall(r"modprobe@(\w+)", unit))
    assert drivers == {"cdc_acm", "usbserial", "i2c_dev", "industrialio"}
    allowed = set(re.findall(r"\nDeviceAllow=(\S+) rw", unit))
    assert {"char-ttyACM", "char-ttyUSB", "char-i2c", "char-iio"} <= allowed
    assert "\nReadWritePaths=-/sys/devices\n" in unit


def test_systemd_itself_takes_the_unit(tmp_path: Path) -> None:
    analyze = needed("systemd-analyze", "systemd")
    program = tmp_path / "program/bin/fltea"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    script("install", DESTDIR=tmp_path / "tree", PREFIX=tmp_path / "program")
    unit = tmp_path / "tree/etc/systemd/system" / UNIT
    newer = r"^Restart(Steps|MaxDelaySec)=.*\n"  # settings that versions of systemd before 254 do not know
    unit.write_text(re.sub(newer, "", unit.read_text("utf-8"), flags=re.MULTILINE))
    checked = run(analyze, "verify", "--man=no", unit)
    assert (checked.returncode, checked.stderr) == (0, "")
    threshold = f"--threshold={LARGEST_EXPOSURE}"
    rated = run(analyze, "security", "--offline=yes", "--no-pager", threshold, unit)
    assert rated.returncode == 0, rated.stdout[-200:]


def test_make_knows_the_targets() -> None:
    for target in ("install-service", "install-udev", "uninstall-service"):
        # the tests may run under make, whose messages must not appear here
        done = run("make", "--no-print-directory", "-n", target)
        assert done.stdout.startswith("tools/deploy/service.sh ")

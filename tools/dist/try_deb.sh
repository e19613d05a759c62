#!/usr/bin/env bash
# Install the Debian package of each system named on a bare system in a folder, use it there, and remove it. The package
# for arm64 and Debian 12 is unpacked next to that system's Python and run under QEMU. Run this as root, or where user
# namespaces are allowed.
# Usage: tools/dist/try_deb.sh [SYSTEM…]    (without a name: Debian's; Ubuntu's archive is not always reachable)
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=tools/dist/common.sh
. tools/dist/common.sh
need qemu-aarch64-static qemu-user-static
[ $# -gt 0 ] || set -- deb12 deb13

cat >"$work/inside.sh" <<'INSIDE'
#!/bin/sh
# What a new user does, inside the bare system.
set -eux
export DEBIAN_FRONTEND=noninteractive
apt-get update -q
apt-get install -q -y --no-install-recommends /tmp/fltea.deb
test -z "$(dpkg --verify fltea)"
fltea --version
fltea simulate /tmp/record.npz --alpha 0.5 --f -1 -n 2000 --seed 1 --force
fltea run --source replay:/tmp/record.npz --once --set live.on=false >/tmp/run.ndjson
grep -q '"class":"estimate"' /tmp/run.ndjson
fltea identify /tmp/record.npz --channels gyro_x --shuffles 1 --jobs 2 >/tmp/verdict.txt
# Check the service's unit, user and settings. There is no board here, so the doctor judges only the settings.
systemd-analyze verify /lib/systemd/system/fltea.service
systemctl is-enabled fltea
id fltea
fltea doctor --config /etc/fltea/fltea.toml >/tmp/doctor.txt || true
grep -q '70-fltea.rules is installed' /tmp/doctor.txt
test "$(stat -c '%a %U' /etc/fltea/mqtt.env)" = "600 root"
for page in $(zgrep -oh '/usr/share/doc/fltea/[a-z_/\\-]*[.]md' /usr/share/man/man1/fltea*.1.gz | tr -d '\\' | sort -u); do
    test -s "$page"
done
apt-get remove -q -y fltea
test ! -e /usr/lib/fltea
test -e /etc/fltea/fltea.toml
apt-get purge -q -y fltea
test ! -e /etc/fltea
INSIDE
for system in "$@"; do
    say "a bare ${suite_of[$system]}, with the package for amd64"
    # shellcheck disable=SC2016  # $1: the folder, set by mmdebstrap
    bare "${suite_of[$system]}" /dev/null --variant=minbase --include=systemd --architectures=amd64 \
        --customize-hook="copy-in $work/inside.sh /tmp" \
        --customize-hook="upload $(deb_of "$system" amd64) /tmp/fltea.deb" \
        --customize-hook='chroot "$1" sh /tmp/inside.sh' >"$work/try_$system.log" 2>&1 || {
        tail -n 40 "$work/try_$system.log" >&2
        refuse "the package does not work on a bare ${suite_of[$system]}; all of it: $work/try_$system.log"
    }
    say "installed, used, removed and purged; log: $work/try_$system.log"
done

say "the package for arm64, unpacked, under QEMU"
root=$(arm_root)
rm -rf "$work/try-arm64"
dpkg-deb -x "$(deb_of deb12 arm64)" "$work/try-arm64"
[ "$(dpkg-deb -f "$(deb_of deb12 arm64)" Architecture)" = arm64 ] || refuse "the package's architecture is not arm64"
PYTHONPATH=$work/try-arm64/usr/lib/fltea qemu-aarch64-static -L "$root" "$root/usr/bin/python3.11" -P -S -c '
import cobs.cobs, lz4, mcap, numpy, paho.mqtt, prometheus_client, zstandard, fltea._native
from fltea.cli.app import main
raise SystemExit(main())' --version

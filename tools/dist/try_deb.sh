#!/usr/bin/env bash
# Installs the Debian package on a bare Debian 12 in a folder, uses it there, and removes it again. The one for arm64 is
# unpacked beside Debian's Python for arm64, and run under QEMU. As root, or where user namespaces are allowed.
# Usage: tools/dist/try_deb.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=tools/dist/common.sh
. tools/dist/common.sh
need mmdebstrap mmdebstrap
need qemu-aarch64-static qemu-user-static
deb_version=$version-1

say "a bare Debian 12, with the package for amd64"
cat >"$work/inside.sh" <<'INSIDE'
#!/bin/sh
# What a new user does, inside of the bare system.
set -eux
export DEBIAN_FRONTEND=noninteractive
apt-get update -q
apt-get install -q -y --no-install-recommends /tmp/fltea.deb
test -z "$(dpkg --verify fltea)"
fltea --version
fltea simulate /tmp/record.npz --alpha 0.5 --f -1 -n 2000 --seed 1
fltea run --source replay:/tmp/record.npz --once --set live.on=false >/tmp/run.ndjson
grep -q '"class":"estimate"' /tmp/run.ndjson
fltea identify /tmp/record.npz --channels gyro_x --shuffles 1 --jobs 2 >/tmp/verdict.txt
# As the service starts it: its user, its settings; here without a board, so that only the settings are judged.
systemd-analyze verify /lib/systemd/system/fltea.service
systemctl is-enabled fltea
id fltea
fltea doctor --config /etc/fltea/fltea.toml >/tmp/doctor.txt || true
grep -q '70-fltea.rules is installed' /tmp/doctor.txt
test "$(stat -c '%a %U' /etc/fltea/mqtt.env)" = "600 root"
test -e /usr/share/man/man1/fltea-run.1.gz
apt-get remove -q -y fltea
test ! -e /usr/lib/fltea
test -e /etc/fltea/fltea.toml
apt-get purge -q -y fltea
test ! -e /etc/fltea
INSIDE
# shellcheck disable=SC2016  # $1: the folder, of mmdebstrap's
if ! mmdebstrap --quiet --variant=minbase --include=systemd --architectures=amd64 \
    --customize-hook="copy-in $work/inside.sh /tmp" \
    --customize-hook="upload $out/fltea_${deb_version}_amd64.deb /tmp/fltea.deb" \
    --customize-hook='chroot "$1" sh /tmp/inside.sh' \
    bookworm /dev/null "deb http://deb.debian.org/debian bookworm main" >"$work/try_deb.log" 2>&1; then
    tail -n 40 "$work/try_deb.log" >&2
    refuse "the package does not work on a bare Debian 12; all of it: $work/try_deb.log"
fi
say "installed, used, removed and purged; log: $work/try_deb.log"

say "the package for arm64, unpacked, under QEMU"
root=$(arm_root)
rm -rf "$work/try-arm64"
dpkg-deb -x "$out/fltea_${deb_version}_arm64.deb" "$work/try-arm64"
[ "$(dpkg-deb -f "$out/fltea_${deb_version}_arm64.deb" Architecture)" = arm64 ] || refuse "its architecture is another"
PYTHONPATH=$work/try-arm64/usr/lib/fltea qemu-aarch64-static -L "$root" "$root/usr/bin/python3.11" -P -S -c '
import bokeh, cobs.cobs, lz4, mcap, numpy, paho.mqtt, prometheus_client, zstandard, fltea._native
from fltea.cli.app import main
raise SystemExit(main())' --version

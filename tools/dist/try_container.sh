#!/usr/bin/env bash
# Build the image of tools/deploy/Containerfile and run daemon and fleet in it, where buildah is installed.
# Its base image of Debian is made here from Debian's archive, so no image registry is contacted.
# Usage: tools/dist/try_container.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=tools/dist/common.sh
. tools/dist/common.sh
if ! command -v buildah >/dev/null; then
    say "the container is not tried: apt-get install buildah"
    exit
fi
base=docker.io/library/debian:trixie-slim
build() { buildah --storage-driver vfs --root "$work/images" --runroot "$work/images-run" "$@"; }
# A builder that runs inside a container may make no namespaces; chroot needs none.
export BUILDAH_ISOLATION=chroot
trap 'build rm --all >/dev/null 2>&1; rm -rf "$work/images" "$work/images-run"' EXIT

say "an image of Debian 13, and fltea in it"
bare trixie "$work/trixie.tar" --variant=minbase
container=$(build from scratch)
build add --quiet "$container" "$work/trixie.tar" >/dev/null
build commit --quiet "$container" "$base" >/dev/null
build bud --quiet --pull-never -f tools/deploy/Containerfile -t fltea "$out" >"$work/container.log" 2>&1 || {
    tail -n 30 "$work/container.log" >&2
    refuse "the image was not built; all of it: $work/container.log"
}
container=$(build from --pull-never fltea)
inside() { build run "$container" -- "$@"; }
[ "$(inside id -un)" = fltea ] || refuse "the image runs as another user"
inside fltea simulate record.npz --alpha 0.5 --f -1 -n 2000 --seed 1 --force
inside fltea run --source replay:record.npz --once --set live.on=false >"$work/container.ndjson"
grep -q '"class":"estimate"' "$work/container.ndjson" ||
    refuse "the daemon in the image says nothing"
inside fltea fleet --help >/dev/null
say "the image runs daemon and fleet as the user fltea; log: $work/container.log"

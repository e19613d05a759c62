#!/usr/bin/env bash
# Build the Debian packages of each machine named, one for each system, from its wheel, into build/dist, and
# check them with lintian.
# Usage: tools/dist/deb.sh [amd64] [arm64]          (without a name: both)
#   DEBFULLNAME, DEBEMAIL    the package's maintainer; default: the author of the last commit
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=tools/dist/common.sh
. tools/dist/common.sh
architectures=("$@")
[ ${#architectures[@]} -gt 0 ] || architectures=(amd64 arm64)
need dh_builddeb debhelper
need lintian lintian
here=$PWD
maintainer="${DEBFULLNAME:-$(git log -1 --format=%an)} <${DEBEMAIL:-$(git log -1 --format=%ae)}>"

"$python" -m tools.man_pages >/dev/null
pack() { # SYSTEM ARCHITECTURE
    local system=$1 architecture=$2 machine py=${python_of[$1]} package folder tree
    machine=$(machine_of "$architecture")
    package=$(deb_of "$system" "$architecture")
    say "packing for $system, $architecture"
    folder=$work/deb-$system-$architecture
    tree=$folder/debian/fltea
    rm -rf "$folder"
    mkdir -p "$folder/debian"
    install_into "$machine" "$py" "$tree/usr/lib/fltea"
    (
        cd "$tree/usr/lib/fltea"
        # Remove commands, examples and tests of the libraries, and files that only a compiler reads.
        rm -rf bin share typings tornado/test numpy/_core/*_tests.*.so numpy/_core/include numpy/_core/lib numpy/f2py
        find . -type d -name tests -prune -exec rm -rf {} +
        find . -name '*.pyi' -delete
    )
    cd "$folder"
    cp "$here"/tools/dist/debian/{prerm,postrm} debian/
    sed "s|@PYTHON@|$py|" "$here/tools/dist/debian/postinst" >debian/postinst
    sed "s|@MAINTAINER@|$maintainer|; s|@PYTHON@|$py|; s|@NEXT@|3.$((${py#3.} + 1))|" "$here/tools/dist/debian/control" \
        >debian/control
    cp "$here/tools/dist/debian/lintian-overrides" debian/fltea.lintian-overrides
    printf 'fltea (%s) %s; urgency=medium\n\n  * Release %s: see changelog.gz.\n\n -- %s  %s\n' "$version-1~$system" \
        "${suite_of[$system]}" "$version" "$maintainer" "$(date -uR -d "@$SOURCE_DATE_EPOCH")" >debian/changelog
    "$python" "$here/tools/dist/deb_copyright.py" "$here/LICENSE" "$tree/usr/lib/fltea" /usr/lib/fltea >debian/copyright

    install -D -m 755 "$here/tools/dist/debian/fltea.py" "$tree/usr/bin/fltea"
    install -D -m 644 "$here/tools/deploy/fltea.toml" "$tree/etc/fltea/fltea.toml"
    install -D -m 600 "$here/tools/deploy/mqtt.env" "$tree/etc/fltea/mqtt.env"
    completions=$here/build/completions
    install -D -m 644 "$completions/bash/fltea" "$tree/usr/share/bash-completion/completions/fltea"
    install -D -m 644 "$completions/zsh/_fltea" "$tree/usr/share/zsh/vendor-completions/_fltea"
    install -D -m 644 "$completions/fish/fltea.fish" "$tree/usr/share/fish/vendor_completions.d/fltea.fish"
    local unit='s|/opt/fltea/bin/|/usr/bin/|'
    # Debian 12 has systemd 252; these settings came with 254.
    [ "$system" != deb12 ] || unit+='; /^RestartSteps=/d; /^RestartMaxDelaySec=/d'
    sed "$unit" "$here/tools/deploy/fltea.service" >debian/fltea.service
    cp "$here/tools/deploy/70-fltea.rules" debian/fltea.udev
    cp "$here/tools/deploy/fltea.sysusers" debian/fltea.sysusers

    (
        eval "$(dpkg-architecture -a"$architecture" -s 2>/dev/null)"
        # The documents that the man pages refer to.
        dh_installdocs "$here"/host/docs/*
        dh_installchangelogs "$here/CHANGELOG.md"
        dh_installman "$here"/build/man/*.1
        dh_installsysusers
        dh_installsystemd
        dh_installudev --priority=70
        dh_lintian
        dh_compress --exclude=.md
        # Only root may read the file with the broker's password.
        dh_fixperms --exclude=mqtt.env
        dh_installdeb
        dh_gencontrol
        dh_md5sums
        dh_builddeb --destdir="$out" -- --root-owner-group -Zxz -z3
    )
    cd "$here"
    lintian --allow-root --fail-on error,warning --tag-display-limit 0 "$package"
    say "$package"
}
for architecture in "${architectures[@]}"; do
    for system in "${systems[@]}"; do pack "$system" "$architecture"; done
done

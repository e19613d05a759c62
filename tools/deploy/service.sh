#!/usr/bin/env bash
# Install fltea on this machine as a service, or only its udev rule or its program, or remove it.
# Usage: service.sh install|udev|uninstall          (make install-service, install-udev, uninstall-service)
#        service.sh program                         the program alone, into PREFIX, for another supervisor
#   PREFIX=/opt/fltea    where the program is installed, in a virtual environment of its own
#   DESTDIR=             put the files into this tree and touch nothing else; the packager then installs the
#                        program (a wheel), and PREFIX names where it will be
set -euo pipefail
# The service and every user read and run the installed files, whatever umask the installing user has.
umask 022
cd "$(dirname "$0")/../.."
action=${1:?usage: service.sh install|program|udev|uninstall}
prefix=${PREFIX:-/opt/fltea}
tree=${DESTDIR:-}
python=${PYTHON:-python3}

unit=/etc/systemd/system/fltea.service
rule=/etc/udev/rules.d/70-fltea.rules
user=/etc/sysusers.d/fltea.conf
settings=/etc/fltea/fltea.toml
secrets=/etc/fltea/mqtt.env
command=/usr/local/bin/fltea

say() { printf 'fltea: %s\n' "$*"; }
refuse() { printf 'fltea: error: %s\n' "$*" >&2; exit 1; }

put() { # FILE WHERE MODE
    install -D -m "$3" "tools/deploy/$1" "$tree$2"
    say "wrote $tree$2"
}

put_unless_there() {
    if [ -e "$tree$2" ]; then
        say "kept $tree$2 as it is"
    else
        put "$@"
    fi
}

put_unit() {
    put fltea.service "$unit" 644
    sed -i "s|/opt/fltea/|$prefix/|" "$tree$unit"
    # RestartSteps (ever longer waits between restarts) came with systemd 254; older versions warn about it.
    if [ -z "$tree" ] && [ "$(systemctl --version | sed -n '1s/[^0-9]*\([0-9]*\).*/\1/p')" -lt 254 ]; then
        sed -i '/^RestartSteps=/d; /^RestartMaxDelaySec=/d' "$tree$unit"
    fi
}

put_program() {
    "$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null ||
        refuse "Python 3.11 or newer with venv is needed: apt-get install python3-venv, or make … PYTHON=python3.12"
    say "installing the program into $prefix: this takes a minute or two"
    local build
    build=$(mktemp -d)
    # shellcheck disable=SC2064  # the folder's name is expanded now
    trap "rm -rf '$build'" EXIT
    "$python" -m venv "$prefix"
    local pip=("$prefix/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation)
    # Packages are checked by their hashes. The program is built outside the clone, so that root leaves no
    # files in it.
    if ! { "${pip[@]}" --require-hashes -r tools/hashes/build.txt &&
        "${pip[@]}" --require-hashes -r tools/hashes/run.txt &&
        PATH="$prefix/bin:$PATH" "${pip[@]}" --config-settings=build-dir="$build" .; }; then
        refuse "the program could not be installed; see above. It needs g++ and python3-dev, and the network."
    fi
    chmod -R u+rwX,go+rX,go-w "$prefix" # also what an earlier installation made under another umask
}

put_command() {
    if [ ! -e "$command" ] || [ "$(readlink "$command")" = "$prefix/bin/fltea" ]; then
        install -d "$(dirname "$command")"
        ln -sf "$prefix/bin/fltea" "$command"
    fi
}

reload_udev() {
    if command -v udevadm >/dev/null && [ -S /run/udev/control ]; then
        udevadm control --reload
        udevadm trigger --subsystem-match=tty --subsystem-match=usb --subsystem-match=iio
    else
        say "no udev runs here, so $rule waits for one"
    fi
}

need_root() { [ "$(id -u)" = 0 ] || refuse "only root may do this: sudo make $1"; }

case $action in
install)
    if [ -n "$tree" ]; then
        put_unit
        put 70-fltea.rules "$rule" 644
        put fltea.sysusers "$user" 644
        put_unless_there fltea.toml "$settings" 644
        put_unless_there mqtt.env "$secrets" 600
        exit
    fi
    [ -d /run/systemd/system ] ||
        refuse "this machine is not run by systemd. Let its own supervisor run 'fltea run --format none --config FILE'," \
            "with SIGTERM to end it and no restart after exit code 2; or give DESTDIR=FOLDER to only write the files."
    need_root install-service
    put_program
    put_command
    put fltea.sysusers "$user" 644
    systemd-sysusers "$user"
    put 70-fltea.rules "$rule" 644
    put_unless_there fltea.toml "$settings" 644
    put_unless_there mqtt.env "$secrets" 600
    put_unit
    reload_udev
    systemctl daemon-reload
    systemctl enable --quiet fltea
    systemctl restart fltea
    say "the service runs, and will after each start of the machine."
    say "    its log:      journalctl -u fltea -f"
    say "    its health:   systemctl status fltea; fltea doctor --config $settings"
    say "    its settings: $settings, then: sudo systemctl restart fltea"
    say "    its data:     /var/lib/fltea"
    say "    undo:         sudo make uninstall-service"
    ;;
program)
    put_program
    say "the program is $prefix/bin/fltea"
    ;;
udev)
    [ -n "$tree" ] || need_root install-udev
    put 70-fltea.rules "$rule" 644
    [ -n "$tree" ] || reload_udev
    ;;
uninstall)
    if [ -z "$tree" ]; then
        need_root uninstall-service
        if [ -d /run/systemd/system ] && [ -e "$unit" ]; then
            systemctl disable --quiet --now fltea
            systemctl reset-failed fltea 2>/dev/null || true
        fi
        if [ "$(readlink "$command" || true)" = "$prefix/bin/fltea" ]; then
            rm -f "$command"
        fi
        # Remove only what this script made: a virtual environment with fltea in it.
        if [ -e "$prefix/pyvenv.cfg" ] && [ -e "$prefix/bin/fltea" ]; then
            rm -rf "$prefix"
        fi
    fi
    rm -f "$tree$unit" "$tree$rule" "$tree$user"
    if [ -z "$tree" ]; then
        reload_udev
        [ ! -d /run/systemd/system ] || systemctl daemon-reload
    fi
    say "removed. Your settings, data and user were kept: $tree/etc/fltea, $tree/var/lib/fltea and the user 'fltea'. To remove them too:"
    say "    sudo rm -r $tree/etc/fltea $tree/var/lib/fltea && sudo userdel fltea"
    ;;
*)
    refuse "usage: service.sh install|program|udev|uninstall"
    ;;
esac

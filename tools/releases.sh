#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs this checkout's last commit on fresh Debian releases, in chroots, and notes the results in doc/releases.md.
# As root, with debootstrap installed; no part of the tests.
#
#   tools/releases.sh [--demo | --unit] [CODENAME ...]
#
# --demo: only ./smokebot demo; --unit: also the unit tests; else everything that ./smokebot test runs, which takes
# one and a half hours a release. CODENAMEs are those of tools/supported.txt; without any: all that ./smokebot prepares.
# Environment: CHROOTS, the folder of the chroots (/var/tmp/smokebot-releases); EACH, a command before each step, as nice.
set -euo pipefail

top=$(cd "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")/.." && pwd)
chroots=${CHROOTS:-/var/tmp/smokebot-releases}
page=$top/doc/releases.md
tests=all
case ${1:-} in --demo|--unit) tests=${1#--}; shift ;; esac
mapfile -t all < <(sed '/^#/d; s/ *| */|/g' "$top/tools/supported.txt" | awk -F'|' '$3 != "nothing" { print $1 }')

say() { printf 'releases: %s\n' "$*" >&2; }

# fresh CODENAME: the path of a new chroot of this release with the last commit in /root/smokebot_udp. A base system is
# kept for the next run.
fresh() {
    local codename=$1 base=$chroots/base-$1 root=$chroots/$1 script=()
    # a release that is newer than this machine's debootstrap
    [ -e "/usr/share/debootstrap/scripts/$codename" ] || script=('' /usr/share/debootstrap/scripts/sid)
    if [ ! -e "$base/etc/os-release" ]; then
        say "making a base system of $codename"
        ${EACH:-} debootstrap --variant=minbase "$codename" "$base" "${script[@]}" >"$chroots/debootstrap.log"
    fi
    rm -rf "$root"
    cp -a "$base" "$root"
    # the network as this machine has it: name service, proxies, certificates
    cp /etc/resolv.conf "$root/etc/resolv.conf"
    echo '127.0.0.1 localhost' >"$root/etc/hosts"
    apt-config dump Acquire >"$root/etc/apt/apt.conf.d/90releases"
    [ ! -e /etc/pip.conf ] || cp /etc/pip.conf "$root/etc/"
    cp -a /usr/local/share/ca-certificates/. "$root/usr/local/share/ca-certificates/" 2>/dev/null || true
    git clone -q --no-hardlinks "$top" "$root/root/smokebot_udp"
    echo "$root"
}

# inside ROOT [-n] COMMAND: in the chroot; with -n in a network of its own, where nothing else uses the ports.
inside() {
    local root=$1 network=()
    shift
    if [ "$1" = -n ]; then network=(--net); shift; fi
    # shellcheck disable=SC2016
    ${EACH:-} unshare --mount --pid --fork "${network[@]}" bash -c '
        mount -t proc proc "$1/proc"; mount --rbind /dev "$1/dev"; mount --rbind /sys "$1/sys"
        mount -t tmpfs tmpfs "$1/dev/shm"
        ip link set lo up; ip route show | grep -q default || ip route add default dev lo
        exec env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 chroot "$1" bash -c "cd /root && $2"
    ' bash "$root" "$*" </dev/null
}

megabytes() { du -sxm --exclude=proc --exclude=sys --exclude=dev "$1" | cut -f1; }

# try CODENAME: its row of the table.
try() {
    local codename=$1 root log=$chroots/$1.log before begun install demo result='not run'
    root=$(fresh "$codename")
    before=$(megabytes "$root") begun=$SECONDS
    if ! inside "$root" smokebot_udp/smokebot build >"$log" 2>&1; then
        echo "failed: $(tail -n 1 "$log" | tr '|' ' ') | | |"
        return
    fi
    install="$(((SECONDS - begun + 30) / 60)) min, $(($(megabytes "$root") - before)) MB"
    say "$codename: demo"
    inside "$root" -n smokebot_udp/smokebot demo >"$chroots/$codename.demo.log" 2>&1 || true
    demo="$(grep -cE ' good( |$)' "$chroots/$codename.demo.log" || true) of $(grep -cE ' (good|poor|nothing)( |$)' "$chroots/$codename.demo.log" || true) lines good"
    if [ "$tests" != demo ]; then
        say "$codename: tests"
        inside "$root" smokebot_udp/smokebot test --version >>"$log" 2>&1 || true  # what tests need besides
        inside "$root" -n smokebot_udp/smokebot test "$([ "$tests" = all ] || echo test/unit -q)" \
            >"$chroots/$codename.test.log" 2>&1 || true
        result=$(grep -E '^[0-9]+ (passed|failed)' "$chroots/$codename.test.log" | tail -n 1 | sed 's/ in .*//')
        [ "$tests" = all ] || result+=' (unit tests)'
    fi
    echo "$install | $demo | ${result:-no result: see the log} |"
}

if [ "$(id -u)" != 0 ] || ! command -v debootstrap >/dev/null; then
    say 'only root can run this, with debootstrap installed'
    exit 2
fi
mkdir -p "$chroots"
names=("$@")
[ $# -gt 0 ] || names=("${all[@]}")
commit=$(git -C "$top" rev-parse --short=10 HEAD)
for codename in "${names[@]}"; do
    name=$(sed -n "s/ *| */|/g; s/^$codename|//p" "$top/tools/supported.txt" | cut -d '|' -f 1)
    row="| $name | $(date +%F) | $commit | $(try "$codename")"
    sed -i "/^| $name |/d" "$page"
    printf '%s\n' "$row" | tee -a "$page"
done

#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Runs this checkout's last commit on fresh Debian releases, in chroots, and notes the results in doc/releases.md.
# As root, with debootstrap installed; no part of the tests.
#
#   tools/releases.sh [--demo | --unit] [CODENAME ...]
#   tools/releases.sh --mixed ROBOT DESK [SECONDS]
#
# --demo: only ./smokebot demo; --unit: also the unit tests; else everything that ./smokebot test runs, which takes
# one and a half hours a release. CODENAMEs are those of tools/supported.txt; without any: all that ./smokebot prepares.
# tools/workspace.sh takes its place on the others.
# --mixed: the robot's side of one release and the desk of another for SECONDS (600), each with a master of its own and
# link_lab between them, which loses 20 %: what came, and how often a reference of predicted images differed. ROBOT and
# DESK are releases that were prepared before, or `here`: this machine.
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
    echo "127.0.0.1 localhost $(hostname)" >"$root/etc/hosts"    # nodes contact each other by its name
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
    ${EACH:-} unshare --mount --pid --fork --kill-child "${network[@]}" bash -c '
        mount --bind "$1" "$1"      # unshare needs a root that is a mount point: the sides of the soak have hosts of their own
        mount -t proc proc "$1/proc"; mount --rbind /dev "$1/dev"; mount --rbind /sys "$1/sys"
        mount -t tmpfs tmpfs "$1/dev/shm"
        if [ -n "$3" ]; then
            mount --bind /dev/null "$1/etc/resolv.conf"     # nobody answers: each name would take a time-out
            ip link set lo up; ip route show | grep -q default || ip route add default dev lo
        fi
        exec env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 chroot "$1" \
            bash -c "cd /root && $2; exit \$?"   # this bash stays, and reaps orphans
    ' bash "$root" "$*" "${network[*]}" </dev/null
}

megabytes() { du -sxm --exclude=proc --exclude=sys --exclude=dev "$1" | cut -f1; }

# try CODENAME: its row of the table.
try() {
    local codename=$1 root log=$chroots/$1.log before begun install demo result='not run' command=smokebot_udp/smokebot
    [[ " ${all[*]} " = *" $codename "* ]] || command=smokebot_udp/tools/workspace.sh
    root=$(fresh "$codename")
    before=$(megabytes "$root") begun=$SECONDS
    if ! inside "$root" "$command" build >"$log" 2>&1; then
        echo "failed: $(tail -n 1 "$log" | tr '|' ' ') | | |"
        return
    fi
    install="$(((SECONDS - begun + 30) / 60)) min, $(($(megabytes "$root") - before)) MB"
    say "$codename: demo"
    inside "$root" -n "$command" demo >"$chroots/$codename.demo.log" 2>&1 || true
    demo="$(grep -cE ' good( |$)' "$chroots/$codename.demo.log" || true) of $(grep -cE ' (good|poor|nothing)( |$)' "$chroots/$codename.demo.log" || true) lines good"
    if [ "$tests" != demo ]; then
        say "$codename: tests"
        inside "$root" "$command" test --version >>"$log" 2>&1 || true  # what tests need besides
        inside "$root" -n "$command" test "$([ "$tests" = all ] || echo test/unit -q)" \
            >"$chroots/$codename.test.log" 2>&1 || true
        result=$(grep -E '^[0-9]+ (passed|failed)' "$chroots/$codename.test.log" | tail -n 1 | sed 's/ in .*//')
        [ "$tests" = all ] || result+=' (unit tests)'
    fi
    echo "$install | $demo | ${result:-no result: see the log} |"
}

declare -A address=([robot]=10.77.0.1 [operator]=10.77.0.2)     # as link_lab has them

# at SIDE RELEASE COMMAND ...: run a command on a side of the emulated link, with this side's master.
at() {
    local side=$1 release=$2 names
    shift 2
    names=("ROS_IP=${address[$side]}" "ROS_MASTER_URI=http://${address[$side]}:11311")
    if [ "$release" = here ]; then
        "${lab[@]}" run "$side" -- env "${names[@]}" "$top/smokebot" exec "$@"
    else
        EACH="${lab[*]} run $side --" inside "$chroots/$release" "${names[@]}" smokebot_udp/smokebot exec "${@@Q}"
    fi
}

# mixed ROBOT DESK SECONDS: whether both sides understand each other.
mixed() {
    local robot=$1 desk=$2 seconds=$3 logs=$chroots/mixed-$1-$2 release key=/root/mixed.key obeyed differed
    lab=("$top/smokebot" exec rosrun smokebot_udp link_lab)
    rm -rf "$logs"
    mkdir -p "$logs"
    "$top/smokebot" exec rosrun smokebot_udp make_key "$logs/key"
    for release in "$robot" "$desk"; do     # both of this commit
        if [ "$release" = here ]; then key_here=$logs/key; continue; fi
        git -C "$chroots/$release/root/smokebot_udp" pull -q "$top" HEAD
        install -m 600 "$logs/key" "$chroots/$release$key"
        inside "$chroots/$release" smokebot_udp/smokebot build >"$logs/$release.build.log" 2>&1
    done
    set -m      # each side is a process group
    # roslaunch takes up to 20 s to end its nodes, which are in groups of their own
    trap 'for signal in INT KILL; do for job in $(jobs -p); do kill -$signal -- "-$job"; done; sleep 25; done 2>/dev/null' EXIT
    "${lab[@]}" up --seed 1 loss=0.2 delay=0.02 rate=4e6 queue=0.2 >"$logs/lab.log" 2>&1 &
    until "${lab[@]}" show >/dev/null 2>&1; do sleep 1; done
    at robot "$robot" roslaunch --skip-log-check smokebot_udp simulated_robot.launch link_port:=17001 \
        key_file:="$(key_of "$robot")" >"$logs/robot.log" 2>&1 &
    at operator "$desk" roslaunch --skip-log-check smokebot_udp operator.launch robot:=10.77.0.1:17001 rviz:=false \
        key_file:="$(key_of "$desk")" >"$logs/desk.log" 2>&1 &
    say "robot's side $robot, desk $desk: $seconds s"
    sleep "$seconds"
    at operator "$desk" rosrun smokebot_udp link_top --once --wait 10 | tee "$logs/table"
    at operator "$desk" timeout -k 1 15 rostopic echo /diagnostics >"$logs/diagnostics" || true
    at operator "$desk" timeout -k 1 40 rostopic pub -r 10 /operator/cmd_vel geometry_msgs/Twist '[0.2, 0, 0]' '[0, 0, 0]' \
        >"$logs/commands.log" 2>&1 &
    # by the times when they came, as the sides start their commands at different times
    at robot "$robot" timeout 25 rostopic echo -p /cmd_vel >"$logs/obeyed" 2>"$logs/obeyed.log" || true
    obeyed=$(awk -F, '$2 == 0.2 { if (!n++) first = $1; else if ($1 - last > gap) gap = $1 - last; last = $1 }
        END { s = (last - first) / 1e9; printf "%.1f a second (%d in %.1f s), longest gap %.2f s", s ? (n - 1) / s : 0, n, s, gap / 1e9 }' \
        "$logs/obeyed")
    [ -s "$logs/diagnostics" ] || { say 'no diagnostics came from the desk'; exit 1; }
    # a reason that never occurred has no line
    differed=$(grep -A 1 'dropped, reference' "$logs/diagnostics" | grep -o '[0-9][0-9]*' | sort -n | tail -n 1) || true
    say "references of predicted images that differed: ${differed:-0}; commands at the robot: $obeyed"
}

# key_of RELEASE: where the key of --mixed is there.
key_of() { if [ "$1" = here ]; then echo "$key_here"; else echo "$key"; fi; }

if [ "$(id -u)" != 0 ] || ! command -v debootstrap >/dev/null; then
    say 'only root can run this, with debootstrap installed'
    exit 2
fi
mkdir -p "$chroots"
if [ "${1:-}" = --mixed ]; then
    mixed "$2" "$3" "${4:-600}"
    exit
fi
names=("$@")
[ $# -gt 0 ] || names=("${all[@]}")
commit=$(git -C "$top" rev-parse --short=10 HEAD)
for codename in "${names[@]}"; do
    name=$(sed -n "s/ *| */|/g; s/^$codename|//p" "$top/tools/supported.txt" | cut -d '|' -f 1)
    row="| $name | $(date +%F) | $commit | $(try "$codename")"
    sed -i "/^| $name |/d" "$page"
    sed -i "/^|---|---|---|---|---|---|\$/a $row" "$page"
    echo "$row"
done

#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# ./smokebot's build, demo and test for tools/releases.sh on a release that it does not prepare: in a catkin workspace, as
# doc/install.md describes it, with Debian's packages alone. As root, in a chroot that is made for it.
#
#   tools/workspace.sh build | demo | test [PYTEST_ARG ...]
set -eo pipefail

top=$(cd "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")/.." && pwd)
workspace=$HOME/catkin_ws

# bring LIST [NAME ...]: install the packages of a list, but for those that a release may lack, and these.
bring() {
    local list=$1
    shift
    # shellcheck disable=SC2046
    DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        $(sed 's/#.*//; s/[^ ]*?//g' "$top/tools/$list") "$@"
}

case $1 in
    build)
        apt-get update
        bring packages.txt python3-opencv python3-rospkg python3-pcl
        # Debian 11's rospy and rostest call what Python 3.9 removed; Noetic's Python 3.8 has it
        echo 'import threading; threading.Thread.isAlive = threading.Thread.is_alive' \
            >"$(python3 -c 'import site; print(site.getsitepackages()[0])')/isalive.pth"
        mkdir -p "$workspace/src"
        ln -sfn "$top" "$workspace/src/smokebot_udp"
        catkin_make -C "$workspace"
        PYTHONPATH=$top/src python3 -m smokebot_udp.codecs.layered.compile ;;
    demo)
        # shellcheck disable=SC1091
        source "$workspace/devel/setup.bash"
        roslaunch smokebot_udp demo.launch rviz:=false seconds:=20 picture:="$HOME/demo.png" ;;
    test)
        bring screen-packages.txt rviz python3-hypothesis python3-skimage python3-tqdm python3-markdown
        # shellcheck disable=SC1091
        source "$workspace/devel/setup.bash"
        cd "$top"
        if [ $# -gt 1 ]; then exec python3 -m pytest "${@:2}"; fi
        # without the checks, whose tools Debian does not have
        PYTHONPATH=$top/tools:$PYTHONPATH python3 -c 'import pathlib, sys, run_tests
_, files = run_tests.run_workspace_tests(pathlib.Path(sys.argv[1]))
print("%d passed, %d failed, %d skipped" % run_tests.count(files))' "$workspace" ;;
esac

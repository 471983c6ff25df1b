# The robot's side on ROS Noetic: docker build -f docker/Dockerfile.robot -t smokebot-robot .
# Run with --network host: docker run --network host -e ROS_MASTER_URI -e ROS_IP smokebot-robot link_port:=17001
# -v ~/.ros:/root/.ros keeps the link's key.
FROM ros:noetic-ros-base-focal
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
COPY . /ws/src/smokebot_udp
WORKDIR /ws
# rviz is for the desk; versions are those of the release
# hadolint ignore=DL3008
RUN apt-get update && rosdep update --include-eol-distros \
    && rosdep install --from-paths src --ignore-src -y --skip-keys "rviz xvfb" \
    && apt-get install -y --no-install-recommends python3-av && rm -rf /var/lib/apt/lists/* \
    && source /opt/ros/noetic/setup.bash && catkin_make -DCATKIN_ENABLE_TESTING=OFF
ENTRYPOINT ["/bin/bash", "-c", "source devel/setup.bash && exec roslaunch --wait smokebot_udp robot.launch \"$@\"", "robot"]

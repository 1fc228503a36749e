# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
#
# The package on ROS 2 Jazzy, for a desktop without ROS:
#   docker build -t retrolidar_ros .
#   docker run --rm -it --network host --ipc host --device /dev/ttyACM0 retrolidar_ros \
#     ros2 launch retrolidar_ros retrolidar.launch.py serial_port:=/dev/ttyACM0

FROM ros:jazzy

SHELL ["/bin/bash", "-c"]
WORKDIR /workspace
COPY . src/retrolidar_ros
RUN apt-get update \
  && rosdep update \
  && rosdep install --from-paths src --ignore-src -y \
    --dependency-types build --dependency-types buildtool --dependency-types exec \
  && rm -rf /var/lib/apt/lists/* \
  && source /opt/ros/jazzy/setup.bash \
  && colcon build --packages-select retrolidar_ros --cmake-args -DBUILD_TESTING=OFF
ENTRYPOINT ["/bin/bash", "-c", "source install/setup.bash && exec \"$@\"", "--"]
CMD ["ros2", "launch", "retrolidar_ros", "retrolidar.launch.py", "emulate:=coffee"]

# Tracker and console on ROS 2 Jazzy, for x86-64 and ARM 64 (Jetson, Raspberry Pi): see docs/docker.md.
FROM ros:jazzy-ros-base

WORKDIR /workspace
COPY . src/pf_tracker_ros
RUN apt-get update \
    && rosdep update \
    && rosdep install --from-paths src --ignore-src --default-yes \
    && rm -rf /var/lib/apt/lists/*
RUN . /opt/ros/jazzy/setup.sh && colcon build --packages-select pf_tracker_ros

# The entry point of the base image sources ROS; this one the workspace, too.
RUN printf '#!/bin/bash\nset -e\nsource /workspace/install/setup.bash\nexec "$@"\n' > /entrypoint.sh \
    && chmod +x /entrypoint.sh
ENTRYPOINT ["/entrypoint.sh"]
CMD ["ros2", "launch", "pf_tracker_ros", "tracker.launch.py", "image:=/camera/image_raw", "console:=true"]

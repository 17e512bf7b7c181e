# mbaid_ros on ROS 2 Jazzy:
#   docker build -t mbaid_ros .
#   docker run --rm --net=host -v "$PWD:/data" mbaid_ros ros2 run mbaid_ros replay /data/bag --model /data/robot.urdf
FROM ros:jazzy-ros-base

ENV PIP_BREAK_SYSTEM_PACKAGES=1
WORKDIR /ws

# The manifests alone first: what they ask for is kept while only the code changes.
COPY package.xml src/mbaid_ros/package.xml
COPY msg_defs/package.xml src/mbaid_ros/msg_defs/package.xml
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3-pip \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src/mbaid_ros src/mbaid_ros/msg_defs --ignore-src -y --dependency-types=buildtool \
        --dependency-types=buildtool_export --dependency-types=build --dependency-types=build_export --dependency-types=exec \
    && pip install --no-cache-dir mcap \
    && rm -rf /var/lib/apt/lists/*

COPY . src/mbaid_ros
RUN . /opt/ros/jazzy/setup.sh && colcon build --base-paths src/mbaid_ros src/mbaid_ros/msg_defs

# The image's own entry point sources /opt/ros/jazzy alone.
RUN printf '#!/bin/bash\nset -e\n. /ws/install/setup.bash\nexec "$@"\n' > /entrypoint.sh && chmod +x /entrypoint.sh
WORKDIR /data
ENTRYPOINT ["/entrypoint.sh"]
CMD ["ros2", "run", "mbaid_ros", "estimator"]

# For a vehicle: docker build -t sphere_nav . && docker run --net=host --ipc=host -v ~/maps:/maps sphere_nav
FROM ros:jazzy-ros-base
WORKDIR /ws/src
COPY . sphere_nav
RUN ln -s sphere_nav/msg_defs msg_defs
RUN echo "yaml file:///ws/src/sphere_nav/rosdep/sphere_nav.yaml" > /etc/ros/rosdep/sources.list.d/10-sphere_nav.list
RUN apt-get update && rosdep update && \
    PIP_BREAK_SYSTEM_PACKAGES=1 rosdep install --from-paths sphere_nav sphere_nav/msg_defs --ignore-src -y
RUN cd /ws && . /opt/ros/jazzy/setup.sh && colcon build
ENTRYPOINT ["/bin/bash", "-c", ". /ws/install/setup.bash && exec \"$@\"", "sphere_nav"]
CMD ["ros2", "launch", "sphere_nav", "localisation.launch.py", "map:=/maps/map"]

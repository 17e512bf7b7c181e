# Sourced by pixi: the workspace on top of the environment's ROS, once it has been built.
if [ -f "${PIXI_PROJECT_ROOT:-.}/install/setup.sh" ]; then
  . "${PIXI_PROJECT_ROOT:-.}/install/setup.sh"
fi

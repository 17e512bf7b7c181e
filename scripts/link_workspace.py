"""Tie a virtual environment that holds the ROS 2 wheels to this colcon workspace.

`make setup` runs it with the environment's Python. The wheels lack the `local_setup` files of a ROS 2 prefix;
with these colcon chains them like any underlay. A start-up file lets the environment's Python find the workspace.
The wheels lack `ros2`, too: scripts/ros2 stands in for it.
"""

import sys
import sysconfig
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parents[1]

LOCAL_SETUP = """\
# Written by scripts/link_workspace.py: makes the ROS 2 wheels of this virtual environment an underlay.
_mbaid_prepend() {{
  eval "_mbaid_value=\\"\\${{$1:-}}\\""
  case ":$_mbaid_value:" in
    *":$2:"*) ;;
    *) export "$1=$2${{_mbaid_value:+:$_mbaid_value}}" ;;
  esac
  unset _mbaid_value
}}
export MBAID_ROS_SOURCED="{prefix}"
export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
export VIRTUAL_ENV="{prefix}"
_mbaid_prepend PATH "{prefix}/bin"
_mbaid_prepend AMENT_PREFIX_PATH "{prefix}"
_mbaid_prepend CMAKE_PREFIX_PATH "{prefix}"
unset -f _mbaid_prepend
"""

STARTUP = """\
# Written by scripts/link_workspace.py: puts the workspace and the ROS 2 wheels into the environment of this Python.
import os
import sys

INSTALL = {install!r}
MESSAGES = [os.path.join(INSTALL, name) for name in ("mbaid_msgs", "tf2_msgs")]
PACKAGE = os.path.join(INSTALL, "mbaid_ros")
SITE_PACKAGES = os.path.join("lib", "python{version}", "site-packages")


def existing(*paths):
    return [path for path in paths if os.path.isdir(path)]


def prepend(name, paths):
    old = [path for path in os.environ.get(name, "").split(os.pathsep) if path]
    new = [path for path in paths if path not in old]
    os.environ[name] = os.pathsep.join(new + old)


# After `. install/setup.bash` everything is there already; while that script runs, it asks this Python for the missing
# parts.
if os.environ.get("MBAID_ROS_SOURCED") != sys.prefix:
    prepend("AMENT_PREFIX_PATH", existing(PACKAGE, *MESSAGES, sys.prefix))
    prepend("LD_LIBRARY_PATH", existing(*(os.path.join(messages, "lib") for messages in MESSAGES)))
    # The package as colcon installs it with links (build/) or with copies (install/), and its messages.
    packages = [PACKAGE, *MESSAGES]
    sys.path += existing({build!r}, *(os.path.join(package, SITE_PACKAGES) for package in packages))
"""

# Start-up files run in the order of their names: this one has to come before the wheels' own
# ros_wheels_bootstrapper.pth, which starts Python anew with the library path found so far.
STARTUP_NAME = 'mbaid_ros_workspace'


def main() -> None:
    """Write the files into the virtual environment whose Python runs this."""
    if sys.prefix == sys.base_prefix:
        sys.exit(f'{sys.executable} is not the Python of a virtual environment')
    for shell in ('sh', 'bash', 'zsh'):
        (Path(sys.prefix) / f'local_setup.{shell}').write_text(LOCAL_SETUP.format(prefix=sys.prefix))
    if not (command := Path(sys.prefix) / 'bin' / 'ros2').exists():
        command.symlink_to(WORKSPACE / 'scripts' / 'ros2')
    site_packages = Path(sysconfig.get_path('purelib'))
    install, build = str(WORKSPACE / 'install'), str(WORKSPACE / 'build' / 'mbaid_ros')
    startup = STARTUP.format(install=install, build=build, version=sysconfig.get_python_version())
    (site_packages / f'{STARTUP_NAME}.py').write_text(startup)
    (site_packages / f'{STARTUP_NAME}.pth').write_text(f'import {STARTUP_NAME}\n')


if __name__ == '__main__':
    main()

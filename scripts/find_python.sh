#!/bin/sh
# Print the Python to build with; or name what this machine lacks, one line each, and fail.
# usage: find_python.sh [PYTHON]

fails=0
missing() {
  echo "missing: $1" >&2
  fails=1
}

check='
import sys, sysconfig, pathlib
v = "%d.%d" % sys.version_info[:2]
if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    sys.exit("is version " + v)
try:
    import ensurepip, venv
except ImportError:
    sys.exit("has no venv: apt install python%s-venv" % v)
if not pathlib.Path(sysconfig.get_path("include"), "Python.h").exists():
    sys.exit("has no headers: apt install python%s-dev" % v)
print(sys.executable)
'

python=
reasons=
for candidate in ${1:-python3.12 python3.11 python3.13 python3.10 python3}; do
  if ! "$candidate" --version >/dev/null 2>&1; then
    reasons="$reasons; $candidate not found"
  elif found=$("$candidate" -c "$check" 2>&1); then
    python=$found
    break
  else
    reasons="$reasons; $candidate $found"
  fi
done

[ -n "$python" ] || missing "Python 3.10 to 3.13 with venv and headers (${reasons#; })"
command -v "${CC:-cc}" >/dev/null || missing "a C compiler, ${CC:-cc} (apt install build-essential)"
command -v "${CXX:-c++}" >/dev/null || missing "a C++ compiler, ${CXX:-c++} (apt install build-essential)"
[ "$(uname -sm)" = "Linux x86_64" ] || missing "Linux x86_64, which the ROS 2 wheels are built for (this is $(uname -sm))"

[ "$fails" = 0 ] && echo "$python"

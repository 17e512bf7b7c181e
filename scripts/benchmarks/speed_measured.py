"""Run a command, the arguments, and print as JSON its wall and processor time (s) and peak memory (MB).

A program of its own: the peak memory of a process counts from that of the process it was forked from.
"""

import json
import os
import sys
import time

begin = time.perf_counter()
nowhere = os.open(os.devnull, os.O_WRONLY)
child = os.posix_spawnp(sys.argv[1], sys.argv[1:], os.environ, file_actions=[(os.POSIX_SPAWN_DUP2, nowhere, 1)])
_, status, usage = os.wait4(child, 0)
wall, cpu = time.perf_counter() - begin, usage.ru_utime + usage.ru_stime
print(json.dumps({'wall': wall, 'cpu': cpu, 'memory': usage.ru_maxrss * 1024 / 1e6}))
sys.exit(os.waitstatus_to_exitcode(status))

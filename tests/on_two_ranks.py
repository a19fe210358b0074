"""Runs the tests that are marked `ranks` on two MPI ranks; arguments go to pytest."""

import os
import subprocess
import sys

from tactile_fem.runtime import ranks

LONGEST_S = 1800  # a hang, at the end of the program say, fails instead of lasting for ever
# What a rank says when it ends all must not be captured.
PYTEST = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:logging", "-m", "ranks"]

if __name__ == "__main__":
    command = [ranks.launcher(), "-n", "2", *PYTEST, *sys.argv[1:]]
    environment = {"OMP_NUM_THREADS": "1", **ranks.SHARED_CORES, **os.environ}
    sys.exit(subprocess.run(command, env=environment, timeout=LONGEST_S).returncode)

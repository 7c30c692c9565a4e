"""Whole-process wall time, CPU time and peak memory of the commands, after one warm-up run of each.

python tests/benchmarks/process.py [repeats]
"""

import os
import subprocess
import sys
import tempfile
import time
from statistics import median

RUN = ["run", "quiet=true", "hydra.run.dir={folder}"]
COMMANDS = {
    "gvla2 --help": ["--help"],
    "gvla2 plugins": ["plugins"],
    "gvla2 run": RUN,
    "gvla2 memory search": ["memory", "search", "lift", "the", "cup"],  # what the runs have learned
    "gvla2 run task=push_block": [*RUN, "task=push_block", "memory=none"],
    "gvla2 run task=lamp_on": [*RUN, "task=lamp_on", "memory=none"],
}


def measure(arguments: list[str], home: str) -> tuple[float, float, float]:
    """Wall seconds, CPU seconds and peak memory in MB of one run in a folder of its own."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gvla2.cli", *(a.format(folder=folder) for a in arguments)]
        started = time.perf_counter()
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, cwd=folder, env=environment | {"GVLA2_HOME": home}
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
        wall = time.perf_counter() - started
        return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


if __name__ == "__main__":
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    print(f"{'command':30} {'wall s (median)':>16} {'max':>7} {'CPU s':>7} {'peak MB':>9}")
    with tempfile.TemporaryDirectory() as home:
        for name, arguments in COMMANDS.items():
            measure(arguments, home)
            walls, cpus, peaks = zip(*(measure(arguments, home) for _ in range(repeats)), strict=True)
            print(f"{name:30} {median(walls):16.2f} {max(walls):7.2f} {median(cpus):7.2f} {max(peaks):9.0f}")

"""Whole-process wall time and peak memory of the commands, after one warm-up run of each.

python tests/benchmarks/process.py [repeats]
"""

import os
import subprocess
import sys
import tempfile
import time

COMMANDS = {
    "gvla2 --help": ["--help"],
    "gvla2 plugins": ["plugins"],
    "gvla2 run": ["run", "quiet=true", "hydra.run.dir={folder}", "memory.url=sqlite:///{folder}/memory.db"],
    "gvla2 run task=push_block": [
        "run",
        "task=push_block",
        "quiet=true",
        "hydra.run.dir={folder}",
        "memory=none",
    ],
    "gvla2 run task=lamp_on": ["run", "task=lamp_on", "quiet=true", "hydra.run.dir={folder}", "memory=none"],
}


def measure(arguments: list[str]) -> tuple[float, float]:
    """Wall seconds and peak memory in MB of one run in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gvla2.cli", *(a.format(folder=folder) for a in arguments)]
        started = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
        return time.perf_counter() - started, usage.ru_maxrss / 1024


def main() -> None:
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    print(f"{'command':28} {'wall s (median)':>16} {'max':>7} {'peak MB':>9}")
    for name, arguments in COMMANDS.items():
        measure(arguments)
        runs = [measure(arguments) for _ in range(repeats)]
        walls = sorted(wall for wall, _ in runs)
        print(f"{name:28} {walls[len(walls) // 2]:16.2f} {walls[-1]:7.2f} {max(m for _, m in runs):9.0f}")


if __name__ == "__main__":
    main()

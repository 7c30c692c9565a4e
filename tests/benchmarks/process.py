"""Whole-process wall time, CPU time and peak memory of the commands, after one warm-up run of each.

python tests/benchmarks/process.py [repeats] [peer=PYTHON]

``peer`` is the interpreter of another checkout's environment: both then run by turns, so that what else the machine
does slows them alike, and the last column is our share of the peer's time.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

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
SEARCH = ["memory", "search", "lift the cube"]
COMPARED = {"gvla2 run": COMMANDS["gvla2 run"], "gvla2 memory search": SEARCH}


def measure(python: str, arguments: list[str], home: Path) -> tuple[float, float, float]:
    """Wall seconds, CPU seconds and peak memory in MB of one run in a folder of its own; its data is in ``home``."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"} | {
        "GVLA2_HOME": home
    }
    environment["XDG_DATA_HOME"] = str(home)  # checkouts older than GVLA2_HOME
    with tempfile.TemporaryDirectory() as folder:
        command = [python, "-m", "gvla2.cli", *(a.format(folder=folder) for a in arguments)]
        started = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=folder, env=environment)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
        wall = time.perf_counter() - started
        return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def main() -> None:
    words = sys.argv[1:]
    peer = next((word.removeprefix("peer=") for word in words if word.startswith("peer=")), "")
    repeats = next((int(word) for word in words if word.isdigit()), 3)
    pythons = {"ours": sys.executable, **({"peer": str(Path(peer).absolute())} if peer else {})}
    print(
        f"{'command':30} {'wall s (median)':>16} {'max':>7} {'CPU s':>7} {'peak MB':>9}{'  of peer' if peer else ''}"
    )
    with tempfile.TemporaryDirectory() as homes:
        for python in pythons.values() if peer else ():  # something to search
            measure(python, ["run", "quiet=true"], Path(homes, str(hash(python))))
        for name, arguments in (COMPARED if peer else COMMANDS).items():
            runs: dict[str, list[tuple[float, float, float]]] = {who: [] for who in pythons}
            for turn in range(repeats + 1):
                for who, python in pythons.items():
                    run = measure(python, arguments, Path(homes, str(hash(python))))
                    if turn:
                        runs[who].append(run)
            for who, each in runs.items():
                wall, cpu = median([run[0] for run in each]), median([run[1] for run in each])
                tail = (
                    f"{wall / median([run[0] for run in runs['peer']]):9.2f}"
                    if peer and who == "ours"
                    else ""
                )
                print(
                    f"{name + (f', {who}' if peer else ''):30} {wall:16.2f} {max(r[0] for r in each):7.2f} {cpu:7.2f} "
                    f"{max(r[2] for r in each):9.0f}{tail}"
                )


if __name__ == "__main__":
    main()

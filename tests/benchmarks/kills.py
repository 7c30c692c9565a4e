"""Runs, sweeps and benches killed at any moment: what is lost, what lives on, and whether they can be resumed.

python tests/benchmarks/kills.py [kills of each, by default 20] [run|sweep|workers|bench ...]

SIGKILL hits the command itself, or with ``workers`` one of a sweep's worker processes. A file that cannot be read, a
memory that does not verify, a process that lives for 10 s longer, a job without a name in the table, and a command that
fails when it is run again are faults. Banks alone: GVLA2_KILLS=200 pytest tests/memory/storage/test_crash.py.
"""

import csv
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

QUICK = [
    "perceiver=oracle",
    "robot.image_size=32",
    "robot.video_size=16",
    "robot.video_fps=1",
    "robot.cameras=[front]",
]
OUT = "hydra.run.dir={0}/out"
SWEEP = ["run", "-m", "task=put_block", "seed=0,1,2,3", *QUICK, "hydra.sweep.dir={0}/out"]
BENCH = ("bench", "robot", "conditions=clean", "tasks=[put_block]", "arms=[off,on]", "seeds=[0]", "workers=2")
COMMANDS = {
    "run": ["run", "task=put_block", "episodes=2", *QUICK, "memory.url=sqlite:///{0}/memory.db", OUT],
    "sweep": SWEEP,
    "workers": [*SWEEP, "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"],
    "bench": [*BENCH, *QUICK, OUT],
}
AGAIN = "run again"
ORPHANED, ENDS = 10.0, 300.0
"""Seconds after which a process left behind is a fault, and within which a command ends by itself."""


def family(token: str) -> list[int]:
    """The living processes that have the token in their environment."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if token.encode() in (place / "environ").read_bytes():
                found.append(int(place.name))
        except OSError:  # it has ended, or is another user's
            continue
    return found


def start(kind: str, folder: Path, token: str) -> subprocess.Popen[bytes]:
    words = [word.format(folder) for word in COMMANDS[kind]] + [f"results.url=sqlite:///{folder}/results.db"]
    environment = {**os.environ, "GVLA2_KILLS": token, "GVLA2_HOME": str(folder / "home")}
    log = (folder / "log.txt").open("ab")
    return subprocess.Popen(
        [sys.executable, "-m", "gvla2", *words, "quiet=true"], env=environment, stdout=log, stderr=log
    )


def kill_once(kind: str, seconds: float, rng: random.Random) -> list[str]:
    """The faults of one kill at a random moment of a command that takes ``seconds``."""
    faults, token = [], f"kill-{rng.random()}"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        folder = Path(place)
        process = start(kind, folder, token)
        time.sleep(rng.uniform(0.1, 1.0) * seconds)
        others = [pid for pid in family(token) if pid != process.pid]
        hit = rng.choice(others) if kind == "workers" and others else process.pid
        if process.poll() is None:
            os.kill(hit, signal.SIGKILL)
        if hit == process.pid:
            process.wait()
            time.sleep(0.1)
        else:
            try:
                process.wait(ENDS)
            except subprocess.TimeoutExpired:
                faults.append("it hangs after a worker's death")
                process.kill()
        until = time.monotonic() + ORPHANED
        while (left := family(token)) and time.monotonic() < until:
            time.sleep(0.2)
        faults += [f"{len(left)} processes live on"] * bool(left)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        for file in folder.rglob("*.json"):
            try:
                json.loads(file.read_text())
            except ValueError:
                faults.append(f"{file.relative_to(folder)} is cut")
        if hit != process.pid:
            faults += unnamed(folder, "after the death")
        process = start(kind, folder, token)
        if process.wait() != 0:
            faults.append(f"run again: {(folder / 'log.txt').read_text()[-300:]}")
        faults += unnamed(folder, AGAIN) if kind in ("sweep", "workers") else []
        for bank in folder.rglob("memory.db"):
            words = [sys.executable, "-m", "gvla2", "memory", "verify", f"url=sqlite:///{bank}"]
            if subprocess.run(words, capture_output=True, check=False).returncode:
                faults.append(f"{bank.relative_to(folder)} does not verify")
    return faults


def unnamed(folder: Path, when: str) -> list[str]:
    """A fault if the sweep's table lacks one of the four jobs, and nobody said that it did not begin."""
    table = folder / "out" / "report.csv"
    jobs = (
        {row["job"] for row in csv.DictReader(table.read_text().splitlines())} if table.is_file() else set()
    )
    waiting = re.findall(r"(\d) of 4 jobs did not begin", (folder / "log.txt").read_text())
    expected = 4 - int(waiting[-1] if waiting and when != AGAIN else 0)
    return [] if len(jobs) == expected else [f"{when}, the table names the jobs {sorted(jobs)}"]


def main() -> None:
    count = next((int(word) for word in sys.argv[1:] if word.isdigit()), 20)
    kinds = [word for word in sys.argv[1:] if word in COMMANDS] or list(COMMANDS)
    total = 0
    for kind in kinds:
        with tempfile.TemporaryDirectory() as place:
            begun = time.monotonic()
            if start(kind, Path(place), "warm").wait():
                raise SystemExit((Path(place) / "log.txt").read_text())
            seconds = time.monotonic() - begun
        rng, faults = random.Random(kind), []
        for number in range(count):
            found = kill_once(kind, seconds, rng)
            faults += [f"kill {number}: {fault}" for fault in found]
        total += len(faults)
        print(
            f"{kind:8} {count} kills within {seconds:.0f} s: {len(faults)} faults",
            *faults,
            sep="\n  ",
            flush=True,
        )
    sys.exit(bool(total))


if __name__ == "__main__":
    main()

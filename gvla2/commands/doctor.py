"""``gvla2 doctor``: what this installation has, one line per fact, and what to do about what is missing."""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from typing import Any, Literal

from packaging.requirements import Requirement

from gvla2.errors import Gvla2Error
from gvla2.plugins.registry import Registry, load_plugins

PROBE_SECONDS = 60
SIMULATOR = ("sapien", "pinocchio", "ompl")
"""Modules of the default run; they may crash, so a process of its own imports them."""


@dataclass(frozen=True)
class Check:
    """One finding: a ``fail`` breaks the default run, a ``warn`` something else; ``advice`` says what to do."""

    name: str
    status: Literal["ok", "warn", "fail"]
    found: str
    advice: str = ""


def main(argv: Sequence[str]) -> int:
    """Print the checks; 1 when one fails."""
    parser = argparse.ArgumentParser(
        "gvla2 doctor",
        description="Check this installation; the exit status is 1 if `gvla2 run` cannot work.",
    )
    parser.parse_args(argv)
    checks = examine(load_plugins())
    healthy = all(check.status != "fail" for check in checks)
    from gvla2.commands.tables import console, row, table

    out, listing = console(), table("check", "status", "found")
    for check in checks:
        row(listing, check.name, check.status, "\n-> ".join(filter(None, (check.found, check.advice))))
    out.print(listing)
    out.print("`gvla2 run` works here." if healthy else "`gvla2 run` cannot work: see above.")
    return int(not healthy)


def examine(registry: Registry) -> list[Check]:
    """All checks, in the order of the table."""
    with ThreadPoolExecutor(1) as pool:
        probed = pool.submit(simulator)  # a process of its own: meanwhile the rest is examined
        return [
            Check("Python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
            *packages(),
            *configuration(registry),
            *plugins(registry),
            data(),
            probed.result(),
        ]


def packages() -> Iterator[Check]:
    """List the installed version and the complete extras; pip itself sees to the packages that gvla2 requires."""
    yield Check("packages", "ok", f"gvla2 {version('gvla2')}")
    extras = {extra: lacking(extra) for extra in metadata("gvla2").get_all("Provides-Extra") or ()}
    there = [extra for extra, names in extras.items() if not names]
    absent = [f"{extra} ({', '.join(names)})" for extra, names in extras.items() if names]
    yield Check("extras", "ok", f"installed: {', '.join(there)}; not: {', '.join(absent) or 'none'}")


def lacking(extra: str) -> list[str]:
    """The packages that an extra asks for and that are missing, or of another version."""
    found = []
    for needed in map(Requirement, requires("gvla2") or ()):
        if needed.marker is None or needed.name == "gvla2" or not needed.marker.evaluate({"extra": extra}):
            continue
        try:
            if needed.specifier.contains(version(needed.name), prereleases=True):
                continue
        except PackageNotFoundError:
            pass
        found.append(needed.name)
    return found


def configuration(registry: Registry) -> Iterator[Check]:
    """Check that the default run composes and its memory opens."""
    from gvla2.commands.hydra_job import composed, explain
    from gvla2.memory.contracts import MemoryTask

    try:
        options: Any = composed("run", registry=registry)[0]
    except Exception as error:
        advice = "Repair the plugin that offers it, or unset GVLA2_DISABLE_PLUGINS."
        yield Check("default run", "fail", explain(error, registry), advice)
        return
    kinds = ("robot", "task", "planner", "memory")
    yield Check("default run", "ok", ", ".join(f"{kind}={getattr(options, kind).name}" for kind in kinds))
    try:
        memory: Any = registry.build(options, "memory")
        fault = memory.recall(MemoryTask(query="is the memory there?")).degraded
        memory.close()
    except Gvla2Error as error:
        fault = str(error)
    if fault:  # a run goes on without memory, and says so
        yield Check("memory", "warn", fault, "Make it writable, or name another: memory.url=sqlite:///FILE")
    else:
        yield Check("memory", "ok", f"the bank '{options.memory.bank}' opens")


def plugins(registry: Registry) -> Iterator[Check]:
    """Count the plugins, and list the broken ones."""
    count = sum(len(registry.components(kind)) for kind in registry.kinds)
    yield Check("plugins", "ok", f"{len(registry.plugins)} plugins offer {count} components")
    for problem in registry.problems:
        found = f"{problem.hook}: {problem.message}" if problem.hook else problem.message
        advice = f"Repair it, uninstall it, or skip it with GVLA2_DISABLE_PLUGINS={problem.plugin}."
        yield Check(f"plugin {problem.plugin}", "warn", found, advice)


def simulator(modules: Sequence[str] = SIMULATOR) -> Check:
    """Check that the simulator's modules can be imported."""
    advice = "pip install 'gvla2[sim]'; a shared library that is missing comes from a package of the system"
    try:
        command = [sys.executable, "-P", "-W", "ignore", "-c", f"import {', '.join(modules)}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PROBE_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return Check("simulator", "fail", f"no answer within {PROBE_SECONDS} s; is the machine busy?")
    if done.returncode:
        last = " ".join(done.stderr.splitlines()[-1:])
        return Check("simulator", "fail", last or f"exit status {done.returncode}", advice)
    return Check("simulator", "ok", f"{', '.join(modules)} can be imported")


def data() -> Check:
    """Locate the data sets of the benches."""
    from gvla2.evaluation.datasets import find_items, roots

    there = {}
    for kind in ("ycb30", "gso30"):
        filled = [items for place in roots(kind) if place.is_dir() and (items := find_items(kind, place))]
        there[kind] = f"{len(filled[0])} objects in {filled[0][0].folder.parent}" if filled else "not found"
    advice = (
        "Only benches need them: set GVLA2_DATA to their folder; `gvla2 bench data=NAME` says what they are."
    )
    lacking = "not found" in there.values()
    return Check(
        "data sets",
        "warn" if lacking else "ok",
        "; ".join(f"{kind}: {found}" for kind, found in there.items()),
        advice if lacking else "",
    )

"""``gvla2 doctor``: does this installation have what the default run needs, and if not, what to do."""

from __future__ import annotations

import argparse
import dataclasses
import json
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from packaging.requirements import Requirement

from gvla2.errors import Gvla2Error
from gvla2.plugins.registry import load_plugins

if TYPE_CHECKING:
    from gvla2.plugins.registry import Registry

PROBE_SECONDS = 60
SIMULATOR = ("sapien", "pinocchio", "ompl")
"""Modules of the default run; they load shared libraries of the system and may crash."""
SYSTEM_PACKAGES = {
    "libX11": "libx11-6",
    "libGL": "libgl1",
    "libEGL": "libegl1",
    "libgthread": "libglib2.0-0",
    "libgomp": "libgomp1",
    "libvulkan": "libvulkan1",
}
"""Debian and Ubuntu packages of the shared libraries that Python wheels expect from the system."""
IMPORT = """
import importlib, json, sys
faults = {}
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except (Exception, SystemExit) as error:
        faults[name] = f"{type(error).__name__}: {error}"
print(json.dumps(faults))
"""
TORCH = """
import json, torch
device = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "no CUDA device, computes on the CPU"
print(json.dumps({"found": f"{torch.__version__}, {device}"}))
"""


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
    parser.add_argument("--json", action="store_true", help="the same for programs")
    as_json = parser.parse_args(argv).json
    checks = examine(load_plugins())
    healthy = all(check.status != "fail" for check in checks)
    if as_json:
        print(json.dumps({"healthy": healthy, "checks": [dataclasses.asdict(c) for c in checks]}, indent=2))
        return int(not healthy)
    from gvla2.commands.tables import console, row, table

    out, listing = console(), table("check", "status", "found")
    for check in checks:
        row(
            listing,
            check.name,
            check.status,
            f"{check.found}\n-> {check.advice}" if check.advice else check.found,
        )
    out.print(listing)
    out.print("`gvla2 run` can go." if healthy else "`gvla2 run` cannot go: see above.")
    return int(not healthy)


def examine(registry: Registry) -> list[Check]:
    """All checks, in the order of the table. Those that may crash or hang run in processes of their own meanwhile."""
    with ThreadPoolExecutor() as pool:
        simulator = pool.submit(probe, IMPORT, *SIMULATOR)
        torch = pool.submit(probe, TORCH) if installed("torch") else None
        return [
            Check("Python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
            *packages(),
            *configuration(registry),
            *plugins(registry),
            opencv(),
            *libraries(simulator.result()),
            *([torch_device(torch.result())] if torch else []),
        ]


def probe(code: str, *arguments: str) -> dict[str, str]:
    """The JSON that the Python code prints in a process of its own, or ``{"crash": why}``."""
    try:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code, *arguments],
            capture_output=True,
            text=True,
            timeout=PROBE_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {"crash": f"no answer within {PROBE_SECONDS} s; is the machine busy?"}
    lines = done.stdout.splitlines()
    if done.returncode == 0 and lines:
        answer: dict[str, str] = json.loads(lines[-1])
        return answer
    return {"crash": f"exit status {done.returncode}: {' '.join(done.stderr.splitlines()[-1:])}"}


def installed(distribution: str) -> str:
    """The installed version, or ""."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


def packages() -> Iterator[Check]:
    """What gvla2 requires, and which extras are complete."""
    needed = [Requirement(text) for text in requires("gvla2") or ()]
    wrong = [str(r) for r in needed if (r.marker is None or r.marker.evaluate({"extra": ""})) and _lacks(r)]
    if wrong:
        yield Check(
            "packages", "fail", f"missing or of another version: {', '.join(wrong)}", "pip install gvla2"
        )
    else:
        yield Check("packages", "ok", f"gvla2 {version('gvla2')} has all that it requires")
    lacking: dict[str, list[str]] = {}
    for extra in metadata("gvla2").get_all("Provides-Extra") or ():
        own = [r for r in needed if r.marker and r.marker.evaluate({"extra": extra}) and r.name != "gvla2"]
        own = [r for r in own if not r.marker or not r.marker.evaluate({"extra": ""})]
        lacking[extra] = [r.name for r in own if _lacks(r)]
    there = [extra for extra, names in lacking.items() if not names]
    absent = [f"{extra} ({', '.join(names)})" for extra, names in lacking.items() if names]
    yield Check("extras", "ok", f"installed: {', '.join(there)}; not: {', '.join(absent) or 'none'}")


def _lacks(requirement: Requirement) -> bool:
    found = installed(requirement.name)
    return not found or not requirement.specifier.contains(found, prereleases=True)


def configuration(registry: Registry) -> Iterator[Check]:
    """Whether the default run composes, its memory opens, and its folder can be written."""
    import hydra
    from omegaconf import OmegaConf

    from gvla2.commands.hydra_job import explain
    from gvla2.commands.primary import CONFIG_MODULE, PRIMARY, VERSION_BASE
    from gvla2.memory.contracts import MemoryTask
    from gvla2.plugins.hydra_config import register

    register(registry, PRIMARY)
    try:
        with hydra.initialize_config_module(CONFIG_MODULE, version_base=VERSION_BASE):
            composed = hydra.compose("run", return_hydra_config=True)
            options: Any = OmegaConf.to_object(hydra.compose("run"))
    except Exception as error:
        advice = "Repair the plugin that offers it, or unset GVLA2_DISABLE_PLUGINS."
        yield Check("default run", "fail", explain(error, registry), advice)
        return
    chosen = ", ".join(f"{kind}={composed[kind].name}" for kind in ("robot", "task", "planner", "memory"))
    yield Check("default run", "ok", chosen)
    try:
        memory: Any = registry.build(options, "memory")
        fault = memory.recall(MemoryTask(query="is the memory there?")).degraded
        memory.close()
    except Gvla2Error as error:
        fault = str(error)
    advice = "Make it writable, or name another bank: memory.url=sqlite:///FILE" if fault else ""
    found = fault or f"the bank '{options.memory.bank}' opens"
    yield Check(
        "memory", "warn" if fault else "ok", found, advice
    )  # a run goes on without memory, and says so
    top = Path(str(composed.hydra.run.dir)).absolute()
    folder = next(parent for parent in (top, *top.parents) if parent.exists())
    try:
        with tempfile.TemporaryFile(dir=folder):
            yield Check("output folder", "ok", f"{folder} is writable")
    except OSError as error:
        yield Check("output folder", "fail", f"{folder}: {error.strerror}", "Set hydra.run.dir=FOLDER.")


def plugins(registry: Registry) -> Iterator[Check]:
    """How many plugins there are, and the broken ones."""
    count = sum(len(registry.components(kind)) for kind in registry.kinds)
    yield Check("plugins", "ok", f"{len(registry.plugins)} plugins offer {count} components")
    for problem in registry.problems:
        found = f"{problem.hook}: {problem.message}" if problem.hook else problem.message
        advice = f"Repair it, uninstall it, or skip it with GVLA2_DISABLE_PLUGINS={problem.plugin}."
        yield Check(f"plugin {problem.plugin}", "warn", found, advice)


def opencv() -> Check:
    """Which distributions own the module cv2: those of different versions overwrite each other's files."""
    names = [f"opencv{kind}-python{head}" for kind in ("", "-contrib") for head in ("", "-headless")]
    found = {name: installed(name) for name in names if installed(name)}
    owners = " and ".join(f"{name} {version}" for name, version in found.items()) or "not installed"
    if len(set(found.values())) < 2:
        return Check("cv2", "ok", owners)
    advice = f"pip uninstall {' '.join(found)}, then install one of them"
    return Check("cv2", "warn", f"{owners} write the same files", advice)


def libraries(faults: Mapping[str, str]) -> Iterator[Check]:
    """The simulator's modules, with the system package of an absent shared library."""
    if not faults:
        yield Check("simulator", "ok", f"{', '.join(SIMULATOR)} can be imported")
    for module, fault in faults.items():
        advice = "pip install 'gvla2[sim]'"
        library = re.search(r"(lib\w+)[\w.+-]*\.so", fault)
        if library and "cannot open shared object" in fault:
            advice = f"apt install {SYSTEM_PACKAGES.get(library[1], f'the package that has {library[1]}')}"
        yield Check(f"simulator: {module}", "fail", fault, advice)


def torch_device(answer: Mapping[str, str]) -> Check:
    """Torch is optional: learned perception and priors use it."""
    if "found" in answer:
        return Check("torch", "ok", answer["found"])
    return Check("torch", "warn", answer["crash"], "Reinstall it: pip install 'gvla2[perception]'")

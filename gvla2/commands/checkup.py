"""The checks of `gvla2 doctor`. Each says what it found and, in case of a problem, what to do."""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

import hydra
from hydra.errors import HydraException, MissingConfigException
from omegaconf import DictConfig

from gvla2.commands.completion import hydra_application
from gvla2.commands.config_errors import explain
from gvla2.commands.primary import PRIMARY
from gvla2.plugins.discovery import DISABLE_VARIABLE
from gvla2.plugins.kinds import chosen_kinds
from gvla2.plugins.registry import Registry

PROBE_SECONDS = 90
PACKAGES = ("gvla2", "hydra-core", "omegaconf", "numpy", "scipy", "numba", "trimesh", "sqlmodel")
CV2_OWNERS = tuple(f"opencv{kind}-python{head}" for kind in ("", "-contrib") for head in ("", "-headless"))
SYSTEM_PACKAGES = {
    "libX11": "libx11-6",
    "libGL": "libgl1",
    "libEGL": "libegl1",
    "libgthread": "libglib2.0-0",
    "libgomp": "libgomp1",
    "libvulkan": "libvulkan1",
}
"""Debian and Ubuntu packages of the shared libraries that Python wheels expect from the system."""


NEEDED = {
    "sapien": ("sapien", "the simulated Panda", "pip install 'gvla2[sim]'"),
    "pinocchio": ("pin", "kinematics and collision checks", "pip install 'gvla2[sim]'"),
    "ompl": ("ompl", "motion planning", "pip install 'gvla2[sim]'"),
}
"""Modules that the default run imports: the distribution of each, what it is for, and how to get it."""


MEMORY_ADVICE = "Move the file away or make it writable, or name another bank: memory.url=sqlite:///FILE"
Status = Literal["ok", "warn", "slow", "fail"]


@dataclass(frozen=True)
class Check:
    """One finding. A ``fail`` breaks the ``commands`` (their default runs), a ``warn`` something else.

    ``slow`` gave no answer in time, perhaps on a busy machine: nothing is known to be broken.

    A failed check without ``commands`` causes other failed checks, which have them.
    """

    name: str
    status: Status
    found: str
    advice: str = ""
    commands: tuple[str, ...] = ()


def examine(registry: Registry) -> list[Check]:
    """All checks, in the order of the table. Slow probes run side by side in processes of their own."""
    with ThreadPoolExecutor(max_workers=4) as pool:
        imports = pool.submit(probe, "imports", *NEEDED)
        torch = pool.submit(probe, "torch") if installed("torch") else None
        composed, blamed, checks = configurations(registry)
        choosing = [name for name, config in composed.items() if chosen_kinds(config, registry.kinds)]
        built = {name: pool.submit(probe, "components", name) for name in choosing}
        return [
            Check("versions", "ok", versions()),
            *checks,
            *plugins(registry, blamed),
            *needed_modules(imports.result()),
            *(c for name in choosing for c in components(name, built[name].result())),
            *output_folders(composed),
            opencv(),
            torch_device(torch.result() if torch else None),
        ]


def probe(*arguments: str) -> Any:
    """The answer of a probe, ``{"crash": why}``, or ``{"slow": how long was waited}``."""
    environment = {**os.environ, "PYTHONWARNINGS": "ignore"}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "gvla2.commands.probe", *arguments],
            capture_output=True,
            text=True,
            timeout=PROBE_SECONDS,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return {"slow": f"no answer within {PROBE_SECONDS} s"}
    lines = done.stdout.strip().splitlines()
    if done.returncode == 0 and lines:
        return json.loads(lines[-1])
    words = done.stderr.strip().splitlines()
    return {"crash": f"exit status {done.returncode}{': ' + words[-1] if words else ''}"}


def versions() -> str:
    """Python, the platform and the packages that matter, in one line."""
    packages = ", ".join(f"{name} {installed(name) or 'absent'}" for name in PACKAGES)
    return f"Python {platform.python_version()} on {platform.system()} {platform.machine()}, {packages}"


def installed(distribution: str) -> str:
    """The installed version, or ""."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


def configurations(registry: Registry) -> tuple[dict[str, DictConfig], set[str], list[Check]]:
    """Compose every primary configuration: those that compose, the kinds that lack a component, the checks."""
    composed: dict[str, DictConfig] = {}
    blamed: set[str] = set()
    checks = []
    with hydra_application(registry):
        for name in PRIMARY:
            try:
                config = hydra.compose(config_name=name, return_hydra_config=True)
            except HydraException as error:
                if isinstance(error, MissingConfigException):
                    blamed.add((error.missing_cfg_file or "").partition("/")[0])
                advice = "Repair or reinstall the plugin that offers it; see the plugins below."
                if skipped := os.environ.get(DISABLE_VARIABLE):
                    advice = f"Unset {DISABLE_VARIABLE}, which skips {skipped}."
                checks.append(
                    Check(f"configuration {name}", "fail", explain(error, registry), advice, (name,))
                )
            else:
                composed[name] = config
                chosen = ", ".join(f"{k}={config[k].name}" for k in chosen_kinds(config, registry.kinds))
                checks.append(Check(f"configuration {name}", "ok", chosen))
    return composed, blamed, checks


def plugins(registry: Registry, blamed: set[str]) -> Iterator[Check]:
    """Broken plugins; ``blamed`` are the kinds for which the default run lacks a component."""
    count = sum(len(registry.components(kind)) for kind in registry.kinds)
    yield Check("plugins", "ok", f"{len(registry.plugins)} plugins offer {count} components")
    for problem in registry.problems:
        kinds = {kind.name for kind in registry.kinds.values() if kind.hook == problem.hook} or blamed
        where = f"{problem.hook}: " if problem.hook else ""
        yield Check(
            f"plugin {problem.plugin}",
            "fail" if kinds & blamed else "warn",
            f"{where}{problem.message}",
            f"Repair it, uninstall it, or skip it with GVLA2_DISABLE_PLUGINS={problem.plugin}.",
        )


def needed_modules(answer: dict[str, str]) -> Iterator[Check]:
    """The modules of the default run, with the system package of an absent shared library."""
    if "slow" in answer:
        yield _slow("libraries", answer["slow"], "run")
        return
    for module, (distribution, purpose, advice) in NEEDED.items():
        fault = answer.get("crash") or answer.get(module, "")
        label = f"{distribution} ({purpose})"
        if not fault:
            yield Check(label, "ok", installed(distribution) or "importable")
            continue
        library = re.search(r"(lib\w+)[\w.+-]*\.so", fault)
        if library and "cannot open shared object" in fault:
            package = SYSTEM_PACKAGES.get(library.group(1), f"the package that has {library.group(1)}")
            advice = f"Install the system's {library.group(1)}: apt install {package}"
        yield Check(label, "fail", fault, advice, ("run",))


def components(name: str, answer: dict[str, Any]) -> Iterator[Check]:
    """Whether the chosen components can be built; for the memory this opens its database."""
    if "slow" in answer:
        yield _slow(f"components of {name}", answer["slow"], name)
        return
    if "crash" in answer:
        advice = f"Run it alone: gvla2 {name}"
        yield Check(f"components of {name}", "fail", str(answer["crash"]), advice, (name,))
        return
    for kind, built in answer.items():
        label = f"{kind} {built['name']}"
        if built["error"]:
            # A run goes on without memory, and says so.
            status: Status = "warn" if kind == "memory" and name == "run" else "fail"
            advice = (
                MEMORY_ADVICE if kind == "memory" else f"`gvla2 plugins {kind}` lists what else there is."
            )
            yield Check(label, status, built["error"], advice, (name,))
        else:
            yield Check(label, "ok", f"built in {built['seconds']} s")


def output_folders(composed: dict[str, DictConfig]) -> Iterator[Check]:
    """Whether runs can write their folders."""
    for name, config in composed.items():
        top = Path(str(config.hydra.run.dir)).absolute()
        folder = next(p for p in (top, *top.parents) if p.exists())
        try:
            with tempfile.TemporaryFile(dir=folder):
                yield Check(f"outputs of {name}", "ok", f"{folder} is writable")
        except OSError as error:
            advice = "Change to another directory, or set hydra.run.dir=FOLDER."
            yield Check(f"outputs of {name}", "fail", f"{folder}: {error.strerror or error}", advice, (name,))


def opencv() -> Check:
    """Which distribution owns the module cv2: two of them write the same files."""
    found = {name: installed(name) for name in CV2_OWNERS if installed(name)}
    owners = " and ".join(f"{name} {version}" for name, version in found.items())
    if len(found) < 2:
        return Check("cv2", "ok", f"owned by {owners}" if owners else "not installed, not needed")
    if len(set(found.values())) == 1:
        return Check("cv2", "ok", f"{owners} write the same files, of one version")
    advice = f"Keep one: pip uninstall {' '.join(found)}, then install one again."
    return Check("cv2", "warn", f"{owners} write the same files", advice)


def torch_device(answer: dict[str, str] | None) -> Check:
    """Torch is an option: learned perception and priors use it."""
    if answer is None:
        return Check("torch", "ok", "not installed, not needed; pip install 'gvla2[perception]' brings it")
    if "slow" in answer:
        return Check("torch", "slow", answer["slow"])
    if "crash" in answer:
        return Check("torch", "warn", answer["crash"], "Reinstall it: pip install 'gvla2[perception]'")
    return Check("torch", "ok", f"{answer['version']} on {answer['device']}")


def _slow(name: str, waited: str, command: str) -> Check:
    advice = f"The machine may be busy: try again when it is idle, or run gvla2 {command}"
    return Check(name, "slow", waited, advice, (command,))


def healthy(checks: Sequence[Check]) -> bool:
    """Whether everything that commands need works."""
    return all(check.status != "fail" for check in checks)


def broken_commands(checks: Sequence[Check]) -> list[str]:
    """The commands whose default run is broken, in the order of :data:`PRIMARY`."""
    broken = {command for check in checks if check.status == "fail" for command in check.commands}
    return [name for name in PRIMARY if name in broken]

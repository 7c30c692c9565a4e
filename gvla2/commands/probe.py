"""Probes of `gvla2 doctor` that may crash or hang, so each runs in a process of its own and prints JSON.

``python -m gvla2.commands.probe imports sapien ompl`` is how the doctor calls one.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any


def imports(modules: Sequence[str]) -> dict[str, str]:
    """Import each module; "" on success, else the error."""
    found = {}
    for module in modules:
        try:
            import_module(module)
            found[module] = ""
        except (Exception, SystemExit) as error:
            found[module] = f"{type(error).__name__}: {error}"
    return found


def torch(_: Sequence[str]) -> dict[str, str]:
    """Version of torch and the device it would compute on."""
    module: Any = import_module("torch")
    if module.cuda.is_available():
        device = f"cuda ({module.cuda.get_device_name(0)})"
    else:
        device = "mps" if module.backends.mps.is_available() else "cpu"
    return {"version": str(module.__version__), "device": device}


def components(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Build each component that the named primary configuration chooses: an error or "", and seconds."""
    import hydra

    from gvla2.commands.completion import hydra_application
    from gvla2.errors import Gvla2Error
    from gvla2.memory.contracts import MemoryTask
    from gvla2.plugins.discovery import describe
    from gvla2.plugins.kinds import NONE, chosen_kinds
    from gvla2.plugins.registry import load_plugins

    registry = load_plugins()
    with hydra_application(registry):
        config = hydra.compose(config_name=names[0])
    found: dict[str, dict[str, Any]] = {}
    chosen = [
        kind
        for kind in chosen_kinds(config, registry.kinds)
        if config[kind].name != NONE or NONE in registry.components(kind)
    ]
    needed = {need for kind in chosen for need in registry.get(kind, config[kind].name).needs}
    for kind in chosen:
        if kind == "language" and kind not in needed:  # not chosen
            continue
        start, fault = time.perf_counter(), ""
        try:
            made = registry.build(config, kind)
            if kind == "memory":
                fault = made.recall(MemoryTask(query="is the memory there?")).degraded
            if callable(getattr(made, "close", None)):
                made.close()
        except Gvla2Error as error:
            fault = str(error)
        except Exception as error:
            fault = describe(error)
        found[kind] = {
            "name": str(config[kind].name),
            "error": fault,
            "seconds": round(time.perf_counter() - start, 2),
        }
    return found


PROBES: Mapping[str, Callable[[Sequence[str]], Any]] = {
    "imports": imports,
    "torch": torch,
    "components": components,
}

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    answer = PROBES[sys.argv[1]](sys.argv[2:])
    print("\n" + json.dumps(answer))

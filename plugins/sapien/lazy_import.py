"""Modules that a library imports and seldom uses, imported when they are."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType


@contextmanager
def waiting(*names: str) -> Iterator[None]:
    """What is imported in the block imports these modules later: each when something in it is asked for.

    Of no use to a library that imports names *from* them. Elsewhere they are imported as ever.
    """
    stand_ins = {name: _stand_in(name) for name in names if name not in sys.modules}
    sys.modules.update(stand_ins)
    try:
        yield
    finally:
        for name, module in stand_ins.items():
            _leave(name, module)


def _stand_in(name: str) -> ModuleType:
    module = ModuleType(name)

    def attribute(wanted: str) -> object:
        _leave(name, module)
        return getattr(import_module(name), wanted)

    vars(module)["__getattr__"] = attribute
    return module


def _leave(name: str, module: ModuleType) -> None:
    if sys.modules.get(name) is module:
        del sys.modules[name]

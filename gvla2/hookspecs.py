"""Every extension point of gvla2 as pluggy sees it: one hook per kind of component, and three others.

A plugin is a module (or any object) with functions marked ``@hookimpl``, named after a hook. It is announced by an
entry point of the group ``gvla2``, or passed to :func:`gvla2.register` in a notebook or a test. Each hook *collects*:
it takes no arguments, and the results of all plugins are concatenated. A kind's hook returns components: a name, a
dataclass of options, and a factory that is called only when the component was chosen. The name becomes a choice of the
kind's Hydra group: ``gvla2 run planner=mine``. :data:`gvla2.plugins.kinds.KINDS` is the table of kinds.

    observe -> perceive -> reconstruct -> recall -> plan -> check -> execute -> verify -> learn
    robot      perceiver   reconstructor  memory    planner  (core)   robot     verifier  memory

pluggy's options keep their meaning. Of two components of one kind and name the one that is called first wins:
``tryfirst=True`` comes before all others, then what was registered in this process, then gvla2's own plugins, then
others by distribution and name. A ``wrapper=True`` gets from its ``yield`` the list of what each plugin returned, and
returns the list that counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from gvla2.component import hookspec
from gvla2.plugins.kinds import KINDS, Kind

if TYPE_CHECKING:
    from gvla2.skills.skill import Skill

KINDS_HOOK = "gvla2_kinds"
SEARCH_PATH_HOOK = "gvla2_config_search_path"
SKILL_HOOK = "gvla2_skills"


@hookspec
def gvla2_kinds() -> Iterable[Kind]:
    """Return kinds of components that this plugin adds to those of :data:`gvla2.plugins.kinds.KINDS`.

    Each has a hook and a Hydra group of its own, may be chosen in every ``gvla2 run``, and is built where another
    component ``needs`` it.
    """
    raise AssertionError("specification only")


@hookspec
def gvla2_skills() -> Iterable[Skill]:
    """Return skills that every planner may call: all that are offered, by name (no Hydra group)."""
    raise AssertionError("specification only")


@hookspec
def gvla2_config_search_path() -> Iterable[str]:
    """Return Hydra search paths with YAML presets of this plugin, such as ``pkg://mine.conf``."""
    raise AssertionError("specification only")


def specifications(kinds: Iterable[Kind] = KINDS.values()) -> type:
    """The hooks of these kinds, for :meth:`pluggy.PluginManager.add_hookspecs`."""
    hooks = {kind.hook: staticmethod(hookspec(_specification(kind))) for kind in kinds}
    return type("Specifications", (), hooks)


def _specification(kind: Kind) -> Callable[[], Iterable[object]]:
    def hook() -> Iterable[object]:
        raise AssertionError("specification only")

    hook.__name__ = hook.__qualname__ = kind.hook
    hook.__doc__ = f"Return {kind.what} (Hydra group ``{kind.name}``)."
    return hook

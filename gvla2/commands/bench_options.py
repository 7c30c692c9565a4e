"""Which options each suite of ``gvla2 bench`` uses: one that would do nothing is an error."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from gvla2.errors import ConfigurationError

EVERY = frozenset(("suite", "results", "quiet", "experiment"))
_GEOMETRY = ("prior", "axis", "fusion", "renderer")
_MEMORY = ("retriever", "embedder", "inducer", "judge")
_EPISODES = (
    "robot",
    "camera",
    "perceiver",
    "reconstructor",
    "verifier",
    "depth_noise",
    "scale",
    "tasks",
    "episodes",
)
_ARMS = ("arms", "own_arms")

OPTIONS: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "reconstruction": frozenset(
            (
                "data", "baselines", "baseline_options", "drifts", "variants", "noise", "seeds", "mode", "compat",
                *_GEOMETRY, "lpips_weights", "surface_samples", "workers",
            )
        ),
        "memory": frozenset(("memory", "data")),
        "robot": frozenset(
            (
                *_EPISODES, *_GEOMETRY, *_MEMORY, *_ARMS, "planner", "planners", "planner_options", "fallback",
                "agreement", "teacher", "world", "families", "task_options", "layouts", "seeds", "exploration_seeds",
                "exploration", "exploration_replan", "replan", "max_parts", "planner_timeout", "videos", "language",
                "workers",
            )
        ),
        "perception": frozenset((*_EPISODES, "perceivers", "task_options", "seeds", "workers", "language")),
        "agents": frozenset(("agents", "agent", *_MEMORY, *_ARMS, "verifier", "language", "seeds")),
    }
)  # fmt: skip
"""Options by suite, besides those common to all. A suite that is not listed takes all."""


def check_options(suite: str, overrides: Iterable[str]) -> None:
    """Raises :class:`ConfigurationError` for an override (``name=value``) that the suite does not use."""
    own = OPTIONS.get(suite)
    if own is None:
        return
    named = [m[1] for one in overrides if (m := re.match(r"[+~]*([A-Za-z_]\w*)", one))]
    for name in dict.fromkeys(named):
        others = [other for other, options in OPTIONS.items() if name in options]
        if name not in own | EVERY and others:
            shown = "arms" if name == "own_arms" else name
            raise ConfigurationError(
                f"{shown} does nothing in the suite {suite}: it is an option of {', '.join(others)}. "
                f"The suite {suite} takes {', '.join(sorted(own))}."
            )

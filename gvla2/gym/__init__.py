"""Every installed task as a Gymnasium environment; needs the extra ``[gym]``.

    env = gymnasium.make("gvla2.gym:gvla2/pick_and_lift-v0")     # names the package to import, or
    import gvla2.gym; env = gymnasium.make("gvla2/pick_and_lift-v0")

Gymnasium finds the environments of other packages by importing them, so importing this one registers them. It is the
only package of gvla2 with a side effect on import, and no other imports it.
"""

from typing import Any

from gvla2.errors import MissingDependencyError
from gvla2.plugins.registry import Registry, load_plugins

__all__ = ["RecordRollouts", "env_id", "register_envs", "replay"]

NAMESPACE, VERSION = "gvla2", 0

MAX_STEPS = 200
"""Steps, ten seconds, after which Gymnasium truncates an episode; ``gymnasium.make(..., max_episode_steps=N)``
overrides it."""


def env_id(task: str) -> str:
    """The identifier of a task's environment, as ``gymnasium.make`` takes it."""
    return f"{NAMESPACE}/{task}-v{VERSION}"


def register_envs(registry: Registry | None = None) -> tuple[str, ...]:
    """Register every installed task with Gymnasium, and return the identifiers.

    What is registered already stays as it is, so that calling it again after installing a plugin is fine. No plugin
    is built: simulators and their libraries are loaded by ``gymnasium.make``. Raises
    :class:`MissingDependencyError` without Gymnasium.
    """
    try:
        from gymnasium.envs.registration import register
        from gymnasium.envs.registration import registry as known
    except ImportError as error:
        raise MissingDependencyError(
            "gymnasium", "A task as an environment", 'pip install "gvla2[gym]"', "MIT"
        ) from error
    tasks = [name for name in (registry or load_plugins()).components("task") if name != "none"]
    for name in tasks:
        if env_id(name) not in known:
            entry, own = "gvla2.gym.env:TaskEnv", {"task": name}
            register(env_id(name), entry_point=entry, kwargs=own, max_episode_steps=MAX_STEPS)
    return tuple(map(env_id, tasks))


def __getattr__(name: str) -> Any:
    if name == "RecordRollouts":  # imported when they are asked for: they bring numpy
        from gvla2.gym.recording import RecordRollouts

        return RecordRollouts
    if name == "replay":
        from gvla2.gym.replaying import replay

        return replay
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


register_envs()

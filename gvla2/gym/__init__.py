"""Every installed task as a Gymnasium environment; needs the extra ``[gym]``.

    env = gymnasium.make("gvla2.gym:gvla2/pick_and_lift-v0")     # names the package to import, or
    import gvla2.gym; env = gymnasium.make("gvla2/pick_and_lift-v0")

Gymnasium finds the environments of other packages by importing them, so importing this one registers them. It is the
only package of gvla2 with a side effect on import, and no other imports it.
"""

from typing import Any

from gvla2.gym.registration import env_id, register_envs

__all__ = ["RecordRollouts", "env_id", "register_envs"]

register_envs()


def __getattr__(name: str) -> Any:
    if name != "RecordRollouts":  # imported when it is asked for: it brings numpy
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gvla2.gym.recording import RecordRollouts

    return RecordRollouts

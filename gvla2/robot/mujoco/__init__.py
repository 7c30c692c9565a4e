"""Worlds that somebody else built, in MuJoCo: what the plugins ``mujoco``, ``libero`` and ``robosuite`` share."""

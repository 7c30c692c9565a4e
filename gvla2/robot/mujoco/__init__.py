"""Worlds that somebody else built, in MuJoCo: what the plugins ``mujoco``, ``libero`` and ``robosuite`` share.

* ``world``: the contract of a world, its options, and the driver that steps it;
* ``description``: an arm of a compiled model as a URDF;
* ``eyes``: RGB-D views of a model's cameras;
* ``truth``: a model's bodies as a scene, for diagnosis;
* ``stepping``: environments of robosuite, old and new, driven by joint positions;
* ``backend``: the robot backend on top of all these.
"""

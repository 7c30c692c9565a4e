"""Software agents with a memory: tasks in folders, a sandbox to work in, an agent that works, a verdict, a lesson.

The same memory methods that serve a robot serve an agent at a shell: recall -> solve -> verify -> learn.
"""

from __future__ import annotations

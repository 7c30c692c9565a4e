"""The sub-commands, one module each, with ``main(argv) -> exit status``."""

from collections.abc import Mapping
from types import MappingProxyType

COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "run": "run one episode, or many: observe, plan, execute, verify, learn",
        "reconstruct": "an object's refined geometry from a folder of calibrated views",
        "bench": "measure a suite on a data set: ablation rows, baselines, drift, seeds",
        "report": "make tables of measured results: terminal, Markdown, LaTeX, HTML",
        "memory": "search and list a memory bank, import, export, govern, forget",
        "data": "list the data sets and weights found here, and how to get the others",
        "calibrate": "find where a camera stands beside a robot, from recorded pose pairs",
        "tasks": "a page of every task as laid out, from its four cameras, or a robot's own tasks",
        "export": "write runs as a data set for training: LeRobot",
        "plugins": "list robots, planners, memories and everything else to choose from, with options",
        "doctor": "check this installation and say how to fix what is missing",
    }
)
"""Sub-commands and what they do. Importing this loads none of them."""

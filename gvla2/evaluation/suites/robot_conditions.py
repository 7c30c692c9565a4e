"""Conditions of the robot suite besides the cameras: distractors, scanned objects, strangers' sentences."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from string import Formatter
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.evaluation.components import options_of, task_options
from gvla2.evaluation.config import LEARNABLE, RobotBench
from gvla2.evaluation.datasets import roots
from gvla2.plugins.kinds import OWN_TASK
from gvla2.plugins.registry import Registry
from gvla2.robot.task import Task, TaskInstance, TaskSite

SCANNED = "tabletop_objects"
"""The task with scanned objects; it joins the paper's fourteen where there are scans."""
SCANS = "ycb30"
"""The data set whose scans ``scans=auto`` takes."""

log = logging.getLogger(__name__)


def scans_of(config: RobotBench) -> str:
    """The folder of scans if the bench's tasks use some; "" for none, or where ``auto`` finds none, which is logged.

    Raises :class:`ConfigurationError` for a folder that does not exist.
    """
    unused = config.tasks and SCANNED not in config.tasks
    if config.scans == "none" or config.world == LEARNABLE or unused:
        return ""
    looked = roots(SCANS) if config.scans == "auto" else [Path(config.scans).expanduser()]
    if found := next((place for place in looked if place.is_dir()), None):
        return str(found.absolute())
    places = ", ".join(map(str, looked))
    if config.scans != "auto":
        raise ConfigurationError(f"scans: there is no folder {places}; it is a folder, auto or none.")
    log.warning("No scanned objects are measured: %s is not in %s (`gvla2 doctor`).", SCANS, places)
    return ""


def conditioned(config: RobotBench, registry: Registry, name: str, scans: str) -> dict[str, Any]:
    """The options of a task by its name with the bench's distractors and, for scanned objects, the folder ``scans``.

    What ``task_options`` says of the task comes first; a robot's own tasks and learnable worlds stay as they are.
    """
    given = task_options(config, registry, name)
    if OWN_TASK in name or config.world == LEARNABLE:
        return given
    usual: dict[str, Any] = {"objects": {"root": scans}} if name == SCANNED and scans else {}
    if config.distractors and "distractors" in options_of(registry, "task", name):
        usual["distractors"] = config.distractors
    return {**usual, **given}


def condition_labels(config: RobotBench) -> dict[str, str | int]:
    """The conditions as factors of a row, "" or 0 where they are clean."""
    if config.world == LEARNABLE:
        return {}
    return {
        "distractors": config.distractors,
        "sentences": "" if config.sentences == "own" else config.sentences,
    }


def sentences_of(config: RobotBench, task: str) -> Sequence[str]:
    """The sentences that replace a task's own, with words in braces as those have; none for the task's own."""
    if config.sentences == "own" or config.world == LEARNABLE:
        return ()
    text = files("gvla2.evaluation").joinpath("sentences.json").read_text("utf-8")
    found: Mapping[str, list[str]] = json.loads(text)
    return found.get(task, ())


class Reworded:
    """Implements :class:`gvla2.robot.task.Task`: another's episodes, asked for in other sentences drawn by the seed.

    An episode is told in its own sentence where that lacks a word that all others need, such as a colour.
    """

    def __init__(self, task: Task, sentences: Sequence[str]) -> None:
        self.__wrapped__, self.instructions = task, tuple(sentences)

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """The task's episode, laid out as without other sentences."""
        made = self.__wrapped__.sample(rng, site, instruction)
        words = _words(made.instruction, self.__wrapped__.instructions)
        fitting = [one for one in self.instructions if _slots(one) <= words.keys()]
        if instruction is not None or not fitting:
            return made
        return replace(made, instruction=fitting[int(rng.integers(len(fitting)))].format(**words))


def _slots(template: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(template) if name}


def _words(sentence: str, templates: Sequence[str]) -> dict[str, str]:
    """The words that fill the template of which the sentence was made; none if it was made of none."""
    for template in templates:
        known: set[str] = set()
        pattern = ""
        for text, name, _, _ in Formatter().parse(template):
            pattern += re.escape(text)
            if name:
                pattern += f"(?P={name})" if name in known else f"(?P<{name}>.+)"
                known.add(name)
        if made := re.fullmatch(pattern, sentence):
            return made.groupdict()
    return {}

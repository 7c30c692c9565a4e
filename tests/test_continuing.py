"""Programs of several plans, with the real simulator, perceiver, memory and verifier."""

import json
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from gvla2.commands.run import build_parts
from gvla2.continuing import goes_on, rest_of_program, with_whole_program, words_of_part
from gvla2.episode import EpisodeRequest, run_episode
from gvla2.errors import PerceptionError
from gvla2.memory.contracts import Verdict
from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Abstention, Plan
from gvla2.planning.programs import Program
from gvla2.record.recorder import RunRecorder

SMALL = ("robot.image_size=160", "robot.video_size=16", "robot.video_fps=2", "task=pick_and_lift")


class Listener:
    def __init__(self, recorder=None):
        self.stages, self.records, self._recorder = [], [], recorder

    def begin(self, stage):
        pass

    def stage(self, record, stage):
        self.stages.append(stage)
        self.records.append(record)
        if self._recorder:
            self._recorder.stage(record, stage)

    def frame(self, image):
        pass


@pytest.fixture
def parts_of(registry, compose_run):
    opened = []

    def build(*overrides):
        parts = build_parts(compose_run(*SMALL, *overrides), registry)
        opened.extend((parts.robot, parts.memory))
        return parts

    yield build
    for part in opened:
        with closing(part):
            pass

"""The planner: the model's program, the peaks of its maps, the ways between them, lifted to a trajectory."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from gvla2.errors import ConfigurationError, PlanningError
from gvla2.geometry.transform import FloatArray
from gvla2.language import LanguageModel, UnusableAnswerError, ask_typed
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.scene import Box
from gvla2.planning.scene_brief import LEGEND, SceneBrief, scene_brief
from gvla2.planning.voxel_route import VoxelGrid
from gvla2_plugins.voxposer.maps import Field, Program, Stage, read_program

if TYPE_CHECKING:
    from gvla2_plugins.voxposer import VoxPoserConfig

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from gvla2 import Component
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import View, Views
from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2_plugins import nothing

VIEWS = Views((View(Camera.from_fov(1.0, np.eye(4), 2, 2), np.zeros((2, 2, 3), np.uint8)),))
HOOKS = [
    nothing.gvla2_reconstructors,
    nothing.gvla2_geometry_priors,
    nothing.gvla2_fusion_strategies,
    nothing.gvla2_memories,
]


def build(component: Component):
    return component.build(component.config(name=component.name))


@pytest.mark.parametrize("hook", HOOKS)
def test_each_kind_has_a_null_choice_with_a_summary(hook) -> None:
    [component] = hook()
    assert component.name == "none"
    assert component.summary.endswith(".")
    assert build(component) is not None


def test_fusion_keeps_a_to_the_bit() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 5, 3))
    kept = a.copy()
    fused = build(nothing.gvla2_fusion_strategies()[0]).fuse(a, b, np.ones(5), np.ones(5))
    assert np.array_equal(fused, kept)


def test_memory_is_off_and_says_so() -> None:
    memory = build(nothing.gvla2_memories()[0])
    task = MemoryTask("lift the red cube")
    lessons = (Lesson("procedural_hint", "approach from above"),)
    before = memory.recall(task)
    learned = memory.learn(MemoryEpisode(task, lessons), Verdict.from_criteria({"done": 1.0}))
    assert (learned.added, learned.merged, learned.provisional, learned.discarded) == ((), (), (), 1)
    assert memory.recall(task) == before
    assert (before.items, before.text, before.abstained) == ((), "", "memory is off")
    assert not before.degraded
    memory.close()
    memory.close()


def test_listing_loads_no_numerical_library() -> None:
    code = (
        "import sys, gvla2_plugins.nothing as n; [h() for h in (n.gvla2_memories, n.gvla2_reconstructors)]; "
    )
    code += "assert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gvla2.geometry.views import Views
from gvla2.reconstruction.view_set import gate_report


@pytest.fixture(scope="module")
def points(jug) -> np.ndarray:
    return np.asarray(trimesh.sample.sample_surface(jug, 20_000, seed=0)[0])


@pytest.fixture(scope="module")
def views(jug, masked_views) -> Views:
    return masked_views(jug)


@pytest.mark.parametrize("scale", [0.9, 1.1, (1, 1, 0.93)])
def test_a_change_for_the_worse_is_not_and_the_way_back_is(points, views, scale):
    worse = points * scale
    refused, kept = (
        gate_report("soft_hull", points, worse, views),
        gate_report("soft_hull", worse, points, views),
    )
    assert refused.status == "rejected"
    assert "Symmetric IoU fell" in refused.reason
    assert refused.after["symmetric_iou"] < refused.before["symmetric_iou"]
    assert kept.status == "applied", kept.reason


def test_not_a_number_is_never_kept(points, views):
    broken = points.copy()
    broken[7] = np.nan
    gate = gate_report("soft_hull", points, broken, views)
    assert gate.status == "rejected"
    assert "1 points became infinite" in gate.reason


def test_without_silhouettes_nothing_changes(points, views):
    empty = Views(tuple(replace(v, mask=np.zeros_like(v.mask)) for v in views))
    gate = gate_report("soft_hull", points, points, empty)
    assert gate.status == "rejected"
    assert "Every mask is empty" in gate.reason

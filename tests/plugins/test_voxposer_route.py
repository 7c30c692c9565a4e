"""Ways through grids whose cheapest way is known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.planning.scene import Box
from gvla2.testing import inputs
from gvla2_plugins.voxposer.voxel_route import VoxelGrid

GRID = VoxelGrid.over(Box(np.zeros(3), np.array([1.0, 0.6, 0.4])), 0.02)
A, B = np.array([0.1, 0.3, 0.1]), np.array([0.9, 0.3, 0.1])


def length(way):
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def test_it_goes_round_a_wall_and_not_farther_than_it_must():
    costs = np.ones(GRID.shape)
    wall = slice(24, 26), slice(8, 30), slice(0, 20)  # a gap at low y
    costs[wall] = 1000.0
    way = GRID.route(costs, A, B)
    assert 2 < len(way) <= 8
    corner = np.array([0.5, 0.16, 0.1])
    shortest = np.linalg.norm(corner - A) + np.linalg.norm(B - corner)
    assert shortest - 0.03 < length(way) < 1.05 * shortest
    dense = np.vstack([np.linspace(p, q, 200) for p, q in pairwise(way)])
    assert costs[tuple(GRID.indices(dense).T)].max() == 1.0


def test_where_it_is_worth_it_it_goes_through():
    costs = np.ones(GRID.shape)
    costs[24:26] = 1.5
    np.testing.assert_allclose(GRID.route(costs, A, B), [A, B])


def test_clearance_is_the_distance_to_the_grown_box():
    cube = inputs.scene(inputs.RED)["red_cube"]
    cube = replace(
        cube, world_from_object=np.eye(4) + np.pad(np.array([[0.5], [0.3], [0.1]]), ((0, 1), (3, 0)))
    )
    far = GRID.clearance([cube], grown=0.02)
    at = tuple(GRID.indices(np.array([0.7, 0.3, 0.1])))
    assert far[at] == pytest.approx(0.2 - 0.026 - 0.02, abs=0.03)
    assert far[tuple(GRID.indices(np.array([0.5, 0.3, 0.1])))] == 0.0
    assert np.isinf(GRID.clearance([])).all()


@pytest.mark.parametrize("size", [0.0, -1.0, float("nan"), 0.0015, 1.0])
def test_grids_that_cannot_be_searched_are_refused(size):
    with pytest.raises(ConfigurationError, match="grid"):
        VoxelGrid.over(Box(np.zeros(3), np.ones(3)), size)


def test_a_peak_is_found_finer_than_the_grid():
    wanted = np.array([0.413, 0.277, 0.133])
    found = GRID.peak(lambda p: -np.linalg.norm(p - wanted, axis=-1), np.zeros(GRID.shape))
    assert np.linalg.norm(found - wanted) < 0.15 * GRID.size


def test_of_equal_peaks_the_least_avoided_is_taken_and_its_middle():
    def high(points):
        return np.where(np.abs(points[..., 0] - 0.5) > 0.3, 1.0, 0.0)

    avoided = np.zeros(GRID.shape)
    avoided[:25] = 1.0
    found = GRID.peak(high, avoided)
    np.testing.assert_allclose(found, [0.9, 0.3, 0.2], atol=0.03)
    with pytest.raises(ValueError, match="the same everywhere"):
        GRID.peak(lambda p: np.zeros(p.shape[:-1]), avoided)

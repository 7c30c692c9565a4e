"""Which of an arm's links may always touch: from an SRDF, or found by sampling postures."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Set
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.robot.kinematics import Kinematics
from gvla2.robot.libraries import library

Pair = frozenset[str]
"""Two links by name."""

POSTURES, USUAL = 300, 0.5
"""Number of sampled postures; links whose hulls overlap in more than this share of them are neighbours with oversized
hulls, not colliding."""


def disabled(srdf: Path, reason: str = "") -> set[Pair]:
    """The pairs whose checks an SRDF disables, for a ``reason`` ("Default": overlap at the default posture)."""
    pairs = ET.parse(srdf).getroot().iter("disable_collisions")
    return {
        frozenset((pair.get("link1", ""), pair.get("link2", "")))
        for pair in pairs
        if reason in ("", pair.get("reason"))
    }


def usually_close(kinematics: Kinematics, robot: Any, hand: Set[str]) -> set[Pair]:
    """Pairs of links whose overlap is harmless: joined by a joint, both of the ``hand`` (its fingers may meet), or
    overlapping in more than ``USUAL`` of the postures drawn within the joints' limits, always the same ones.

    ``robot`` is the pinocchio ``GeometryModel`` of the links' solids.
    """
    pin, model, solids = library("pinocchio"), kinematics.model, robot.geometryObjects
    robot = robot.copy()
    robot.removeAllCollisionPairs()
    found: set[Pair] = set()
    for i, j in combinations(range(len(solids)), 2):
        one, other = solids[i], solids[j]
        pair = frozenset((str(one.name), str(other.name)))
        a, b = one.parentJoint, other.parentJoint
        if a == b or model.parents[a] == b or model.parents[b] == a or pair <= hand:
            found.add(pair)
        else:
            robot.addCollisionPair(pin.CollisionPair(i, j))
    pairs = [frozenset((str(solids[p.first].name), str(solids[p.second].name))) for p in robot.collisionPairs]
    data, geometry_data = model.createData(), robot.createData()
    touched: Counter[Pair] = Counter()
    rng = np.random.default_rng(20240229)
    for joints in rng.uniform(kinematics.low, kinematics.high, (POSTURES, kinematics.dof)):
        pin.computeCollisions(model, data, robot, geometry_data, kinematics.full(joints, 1.0), False)
        results = geometry_data.collisionResults
        touched.update({p for p, result in zip(pairs, results, strict=True) if result.isCollision()})
    return found | {pair for pair, count in touched.items() if count > USUAL * POSTURES}

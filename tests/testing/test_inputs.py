"""The inputs that the conformance checks are made with are sound themselves."""

import numpy as np

from gvla2.testing.inputs import RED, TABLE, WORKSPACE, gantry, scene


def test_the_gantry_is_an_arm():
    arm = gantry()
    rng = np.random.default_rng(2)
    for _ in range(20):
        joints = np.array([*rng.uniform(WORKSPACE.low, WORKSPACE.high), rng.uniform(-3, 3)])
        solved = arm.inverse(arm.forward(joints), joints)
        assert solved is not None
        np.testing.assert_allclose(solved.joints, joints, atol=1e-9)
    assert arm.inverse(np.eye(4)) is None, "it points down only, and the origin is outside"
    path = arm.line(arm.home, arm.forward(arm.home - [0, 0, 0.2, 0]))
    assert path is not None
    assert len(path) >= 20


def test_the_gantry_feels_what_it_touches():
    arm, world = gantry(), scene()
    above = np.array([*RED.centre, TABLE + 0.3, RED.yaw])
    free = arm.clearance(above, 1.0, world)
    assert free.distance > 0.1
    closed = np.array([*RED.centre, TABLE + RED.side, RED.yaw])
    hit = arm.clearance(closed, 0.0, world)
    assert hit.other == "red_cube"
    assert hit.distance < 0
    straddling = np.array([*RED.centre, TABLE + 0.5 * RED.side, RED.yaw])
    assert arm.clearance(straddling, 1.0, world).distance > 0, "the open fingers pass on both sides"
    assert arm.clearance(straddling, 0.0, world, frozenset({"red_cube"})).other != "red_cube"

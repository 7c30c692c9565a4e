"""Where a camera stands beside a robot, from recorded pose pairs: OpenCV's hand-eye solver, checked and refined.

    python examples/08_hand_eye.py recording.json hand_eye.json

A recording holds at least 8 pairs, the hand turned about two axes in between:

    {"mount": "eye_to_hand", "serial": "f0123456",
     "intrinsics": {"fx": 600, "fy": 600, "cx": 320, "cy": 240, "width": 640, "height": 480},
     "pairs": [{"base_from_tcp": [[...4x4...]], "camera_from_target": [[...4x4...]]}, ...]}

With "eye_to_hand" the hand holds the target and the camera stands; with "eye_in_hand" the other way round. Without
arguments a recording with a millimetre of noise is made up. Needs `pip install gvla2`.
"""

import json
import sys
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import check_rigid, invert_rigid, look_along, rigid
from gvla2.robot.calibration import Calibration, pinhole

FEWEST, SMALLEST_TURN = 8, np.radians(15.0)
LEVER = 0.3  # metres: the weight of a radian of rotation error in the refinement


def solve(hands, targets, mount):
    """The camera's pose (4, 4), and each pair's deviations (N, 6) from the mean: metres, then radians.

    inv(base_from_tcp) base_from_camera camera_from_target is the same for every pair of an eye to the hand.
    """
    if len(hands) < FEWEST:
        sys.exit(f"At least {FEWEST} pose pairs are needed, got {len(hands)}.")
    for poses in (hands, targets):  # turns about one axis only leave the calibration open along that axis
        between = Rotation.from_matrix([b @ a.T for a, b in combinations(poses[:, :3, :3], 2)]).as_rotvec()
        spread = np.linalg.svd(between, compute_uv=False) / np.sqrt(len(between))
        if spread[1] < SMALLEST_TURN / 2:
            sys.exit("The poses are too similar: turn the hand by 15 degrees or more about two axes.")
    if mount == "eye_to_hand":  # an eye in a hand that moves the other way round
        hands = np.array([invert_rigid(hand) for hand in hands])
    pairs = (list(poses[:, :3, part]) for poses in (hands, targets) for part in (slice(3), 3))
    rotation, shift = cv2.calibrateHandEye(*pairs, method=cv2.CALIB_HAND_EYE_PARK)
    start = rigid(rotation, np.ravel(shift))

    def moved(x):
        return start @ rigid(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:])

    def weighted(x):
        return (deviations(hands @ moved(x) @ targets) * ([1.0] * 3 + [LEVER] * 3)).ravel()

    best = moved(least_squares(weighted, np.zeros(6), method="lm").x)
    return best, deviations(hands @ best @ targets)


def deviations(poses):
    """(N, 6) shifts and turns of poses (N, 4, 4) from their mean."""
    turns, shifts = Rotation.from_matrix(poses[:, :3, :3]), poses[:, :3, 3]
    return np.hstack([shifts - shifts.mean(axis=0), (turns.mean().inv() * turns).as_rotvec()])


def made_up():
    """A recording of a camera that looks at the hand from aside."""
    rng = np.random.default_rng(0)
    true = look_along([0.8, -0.3, 0.6], [-0.6, 0.3, -0.5])
    pairs = []
    for turn, place in zip(rng.uniform(-0.6, 0.6, (20, 3)), rng.uniform(0.1, 0.4, (20, 3)), strict=True):
        hand = rigid(Rotation.from_rotvec(turn).as_matrix(), place)
        noise = rigid(
            Rotation.from_rotvec(rng.normal(scale=2e-3, size=3)).as_matrix(), rng.normal(scale=1e-3, size=3)
        )
        seen = invert_rigid(true) @ hand @ noise
        pairs.append({"base_from_tcp": hand.tolist(), "camera_from_target": seen.tolist()})
    lens = {"fx": 600, "fy": 600, "cx": 320, "cy": 240, "width": 640, "height": 480}
    return {"serial": "made-up", "intrinsics": lens, "pairs": pairs}


def main(words):
    recording = json.loads(Path(words[0]).read_text()) if words else made_up()
    names = ("base_from_tcp", "camera_from_target")
    poses = [
        [check_rigid(pair[name], f"{name} of pair {k}") for name in names]
        for k, pair in enumerate(recording["pairs"])
    ]
    mount = recording.get("mount", "eye_to_hand")
    transform, off = solve(*np.array(poses).swapaxes(0, 1), mount)
    for number, pair in enumerate(off):
        shift, turn = np.linalg.norm(pair[:3]), np.linalg.norm(pair[3:])
        print(f"pair {number:<3} {1e3 * shift:8.3f} mm  {np.degrees(turn):8.4f} degrees")
    rmse = float(np.sqrt((off[:, :3] ** 2).sum(axis=1).mean()))
    print(f"RMSE     {1e3 * rmse:8.3f} mm")
    lens = pinhole(**recording["intrinsics"], pose=transform)
    made = Calibration(lens, recording["serial"], rmse, mount)  # or it is refused
    out = Path(words[1] if len(words) > 1 else "hand_eye.json")
    made.save(out)
    print(f"calibration: {out}")


if __name__ == "__main__":
    main(sys.argv[1:])

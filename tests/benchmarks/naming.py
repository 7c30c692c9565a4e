"""Names from a gallery: scans laid on a table, one at a time, seen by four cameras, with and without themselves in it.

    python -m tests.benchmarks.naming FOLDER [--poses 3] [--from 15]

FOLDER holds NAME/textured.obj (YCB). Scenes are ray cast, half of them with the errors of ``depth_noise=realistic``.
The gallery holds all scans; ``--from`` is the number of the first that is laid out (the odds were fitted on the fifteen
before).
"""

import argparse
from importlib.resources import files

import numpy as np
from omegaconf import OmegaConf
from scipy.spatial.transform import Rotation

from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.views import Observation, View, Views
from gvla2.perception.clusters import cloud_of, clusters
from gvla2.perception.frames import frames_of, raised
from gvla2.perception.gallery import Gallery
from gvla2.perception.scans import read_scan, resting_turns, scan_files
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.robot.depth_noise import apply_noise
from gvla2.robot.options import DepthNoise
from tests.plugins.rendered_table import TABLE_TOP as TABLE
from tests.plugins.rendered_table import cameras

WORKSPACE = Box(np.array([-0.02, -0.45, TABLE]), np.array([0.55, 0.45, TABLE + 0.8]))
PLAIN = DepthNoise(sigma_rel=0.0015, colour=0.012)
ERRING = DepthNoise(
    **OmegaConf.create(files("gvla2.conf").joinpath("depth_noise/realistic.yaml").read_text())
)


def laid(path, rng, upright):
    """The scan's surface in the world, at a random place and turn."""
    scan = read_textured_mesh(path)
    v, f = scan.mesh.vertices - scan.mesh.vertices.mean(axis=0), scan.mesh.faces
    rgb = scan.rgb.mean(axis=1).astype(float)
    for k, image in enumerate(scan.images):
        own = scan.texture == k
        u, w = (scan.uv[own].mean(axis=1) % 1.0).T
        rgb[own] *= (
            image[((1 - w) * (len(image) - 1)).astype(int), (u * (image.shape[1] - 1)).astype(int)] / 255.0
        )
    rests = resting_turns(v[:: max(1, len(v) // 3000)])
    turn = rests[0] if upright else rests[rng.integers(len(rests))]
    v = v @ (Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix() @ turn).T
    low, high = v.min(axis=0), v.max(axis=0)
    v = v - [*(0.5 * (low + high))[:2], low[2]] + [*rng.uniform([0.1, -0.25], [0.4, 0.25]), TABLE]
    return Surface(v, f, np.clip(rgb, 0, 1), 1)


def seen(surface, rng, erring):
    """What the cameras see of it."""
    axis = np.linspace(-1.0, 2.0, 40)
    corners = np.array([[x, y - 0.5, TABLE] for x in axis for y in axis])
    i, j = np.indices((39, 39)).reshape(2, -1)
    a = 40 * i + j
    faces = np.concatenate([np.stack([a, a + 1, a + 40], 1), np.stack([a + 1, a + 41, a + 40], 1)])
    wood = np.clip(np.array([0.62, 0.55, 0.45]) * (1 + 0.03 * rng.normal(size=(len(faces), 1))), 0, 1)
    rig = cameras()
    shots = RayCaster([Surface(corners, faces, wood, 0), surface]).cast(rig, {})
    views = tuple(View(camera, shot.image, shot.depth) for camera, shot in zip(rig, shots, strict=True))
    clean = Observation(Views(views), np.eye(4), np.zeros(7), 1.0, 0.08)
    return apply_noise(clean, ERRING if erring else PLAIN, rng, int(rng.integers(2**31)))


def main():
    """Print what was named right, wrong and not at all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("--poses", type=int, default=3)
    parser.add_argument("--from", type=int, default=15, dest="first")
    given = parser.parse_args()
    paths = scan_files(given.folder)
    scans = {name: read_scan(name, path) for name, path in paths.items()}
    whole = Gallery(list(scans.values()))
    for erring in (False, True):
        counts = dict.fromkeys(("right", "wrong", "unknown", "left out: named"), 0)
        for number, (name, path) in enumerate(list(paths.items())[given.first :]):
            without = Gallery([scan for other, scan in scans.items() if other != name])
            for pose in range(given.poses):
                rng = np.random.default_rng([number, pose, erring])
                observation = seen(laid(path, rng, pose == 0), rng, erring)
                frames, table, _ = frames_of(observation.views, WORKSPACE)
                found = clusters(frames, [raised(f, table, WORKSPACE) for f in frames])
                points, _ = cloud_of(frames, [image == 0 for image in found])
                obj = SceneObject("o1", "object", "other", "", np.eye(4), np.ones(3), points)
                scene = Scene((obj,), table.height_at(0.3, 0.0), WORKSPACE)
                (answer,) = whole.names([obj], scene, observation)
                counts["unknown" if not answer.label else "right" if answer.label == name else "wrong"] += 1
                (stranger,) = without.names([obj], scene, observation)
                counts["left out: named"] += bool(stranger.label)
                if answer.label != name or stranger.label:
                    print(f"  {name} ({pose}): '{answer.label}'; left out: '{stranger.label}'", flush=True)
        print("cameras that err:" if erring else "plain noise:", counts, flush=True)


if __name__ == "__main__":
    main()

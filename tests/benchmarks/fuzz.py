"""Damaged files through every reader: how many end in an error of ours, and which in anything else.

python tests/benchmarks/fuzz.py [mutations, by default 500] [format ...]

Each case runs in a process of its own with 5 s and 1 GB: it must read the file or raise an error of gvla2. What else it
raises, a process that dies or hangs, and memory that runs out are faults, listed with a file that shows them.
"""

import json
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from gvla2.errors import Gvla2Error

SECONDS, MEMORY = 5, 1 << 30
ODD = (
    b"0",
    b"-1",
    b"nan",
    b"inf",
    b"1e308",
    b"99999999999",
    b"4294967295",
    b"",
    b"[]",
    b"{}",
    b"null",
    b'"x"',
    b"\xff\xfe",
    b"\0",
)
Reader = Callable[[Path], object]


def mutate(content: bytes, rng: random.Random) -> bytes:
    """One to four changes: bytes flipped, cut, doubled or moved; numbers and words replaced by odd ones."""
    for _ in range(rng.randint(1, 4)):
        at, length = rng.randrange(len(content) + 1), rng.choice((1, 4, 30, 400))
        kind = rng.randrange(6)
        if kind == 0:
            content = content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :]
        elif kind == 1:
            content = content[:at] + content[at + length :]
        elif kind == 2:
            content = content[:at] + content[at : at + length] * rng.choice((2, 50)) + content[at + length :]
        elif kind == 3:
            content = content[: max(at, 1)]
        elif kind == 4:
            content = (
                content[:at]
                + rng.choice((b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", b"\xff\xff\xff\x7f"))
                + content[at + 4 :]
            )
        elif words := list(re.finditer(rb"[-\w.]+", content)):
            word = rng.choice(words)
            content = content[: word.start()] + rng.choice(ODD) + content[word.end() :]
    return content


def mesh_targets(folder: Path) -> dict[str, tuple[Path, list[Reader]]]:
    """A textured or coloured box in each format of meshes, and their readers."""
    from gvla2.geometry.articulated_files import read_articulated
    from gvla2.perception.scans import read_scan as read_known
    from gvla2.robot.scan import read_scan
    from gvla2.robot.looks import link_surfaces
    from gvla2.robot.urdf import read_urdf

    box = trimesh.creation.box((0.05, 0.06, 0.08))
    box.visual = trimesh.visual.TextureVisuals(
        uv=np.random.default_rng(0).random((8, 2)), image=Image.new("RGB", (8, 8), "red")
    )
    box.export(folder / "box.obj")
    box.export(folder / "box.glb")
    plain = trimesh.creation.box((0.05, 0.06, 0.08))
    plain.visual.vertex_colors = np.full((8, 4), 200, np.uint8)
    for name, kind in (
        ("box.ply", "ply_ascii"),
        ("binary.ply", "ply"),
        ("box.dae", "dae"),
        ("box.stl", "stl"),
        ("box.off", "off"),
    ):
        content = plain.export(
            file_type=kind.partition("_")[0], **({"encoding": "ascii"} if kind == "ply_ascii" else {})
        )
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())

    def in_urdf(path: Path) -> None:
        urdf = path.with_name("beside.urdf")
        urdf.write_text(
            f'<robot name="r"><link name="l"><visual><geometry><mesh filename="{path.name}"/></geometry></visual></link></robot>'
        )
        read_articulated(urdf)
        link_surfaces(read_urdf(urdf))

    readers: list[Reader] = [read_scan, lambda path: read_known("x", path), in_urdf]
    return {
        Path(name).suffix[1:] + ("" if name.startswith("box") else " (binary)"): (folder / name, readers)
        for name in ("box.obj", "box.ply", "binary.ply", "box.glb", "box.dae", "box.stl", "box.off")
    }


URDF = "".join(
    f'<link name="l{n}"><visual><origin xyz="0 0 0.07"/><geometry><cylinder radius="0.02" length="0.12"/></geometry></visual></link>'
    + (f'<joint name="j{n}" type="revolute"><parent link="l{n - 1}"/><child link="l{n}"/><origin xyz="0 0 0.15"/><axis xyz="{axis}"/>'
       '<limit lower="-2.8" upper="2.8" velocity="2" effort="9"/></joint>' if n else "")
    for n, axis in enumerate(("", "0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1"))
)  # fmt: skip


def robot_targets(folder: Path) -> dict[str, tuple[Path, list[Reader]]]:
    """A URDF and an MJCF file of an arm."""
    from gvla2.geometry.articulated_files import read_articulated
    from gvla2.robot.arm_from_urdf import arm_from_urdf
    from gvla2.robot.mujoco.description import write_urdf
    from gvla2_plugins.mujoco import MjcfConfig
    from gvla2_plugins.mujoco.worlds import MjcfWorld
    from gvla2_plugins.sapien import SapienArmConfig

    (folder / "arm.urdf").write_text(f'<robot name="six">{URDF}</robot>')
    joints = [f"j{n}" for n in range(1, 7)]
    body = "".join(
        f'<body name="l{n}" pos="0 0 .15"><joint name="j{n}" axis="0 {n % 2} {1 - n % 2}" range="-2.8 2.8"/><geom type="capsule" size=".02 .05" pos="0 0 .07"/>'
        for n in range(1, 7)
    )
    fingers = "".join(
        f'<body name="f{n}" pos="{n * 0.04} 0 .1"><joint name="f{n}" type="slide" axis="{-n} 0 0" range="0 .04"/><geom type="box" size=".006 .01 .025"/></body>'
        for n in (-1, 1)
    )
    motors = "".join(f'<position joint="{j}" kp="100" ctrlrange="-2.8 2.8"/>' for j in joints) + "".join(
        f'<position name="g{n}" joint="f{n}" kp="100" ctrlrange="0 .04"/>' for n in (-1, 1)
    )
    (folder / "arm.mjcf").write_text(
        f'<mujoco><worldbody><camera name="c" pos="1 0 1"/><body name="l0"><geom type="box" size=".05 .05 .05"/>{body}{fingers}{"</body>" * 6}</body></worldbody><actuator>{motors}</actuator></mujoco>'
    )

    def mujoco(path: Path) -> None:
        config = MjcfConfig(
            mjcf=str(path),
            base="l0",
            tool="l6",
            joints=joints,
            fingers=["f-1", "f1"],
            gripper_actuators=["g-1", "g1"],
            cameras=["c"],
        )
        world = MjcfWorld(config)
        world.begin(0)
        write_urdf(world.model, world.names, 2.0)

    def sapien(path: Path) -> None:
        arm_from_urdf(SapienArmConfig(urdf=str(path), tool_link="l6", home=[0.0] * 6))

    return {
        "urdf": (folder / "arm.urdf", [read_articulated, sapien]),
        "mjcf": (folder / "arm.mjcf", [mujoco]),
    }


def run_targets(folder: Path) -> dict[str, tuple[Path, list[Reader]]]:
    """What runs leave and other tools write: views, priors, results, episodes, memories."""
    from gvla2.commands.export import export
    from gvla2.commands.objects import read_scene
    from gvla2.commands.sweeps import publish_jobs, read_jobs
    from gvla2.geometry.view_folders import read_views
    from gvla2.memory import KnowledgeBank
    from gvla2.memory.transfer import import_jsonl
    from gvla2.record.motion import Motion
    from gvla2.robot.backend import Moment
    from gvla2.robot.calibration import CONVENTION, Calibration
    from gvla2_plugins.file_prior import FilePriorConfig
    from gvla2_plugins.file_prior.prior import FilePrior
    from gvla2_plugins.sam3d.results import _read_pose

    views = folder / "views"
    (views / "images").mkdir(parents=True)
    Image.new("RGB", (32, 32)).save(views / "images" / "a.png")
    K = [[40, 0, 16], [0, 40, 16], [0, 0, 1]]
    (views / "cameras.json").write_text(
        json.dumps({"K": K, "views": [{"name": "a", "T": np.eye(4).tolist()}] * 2})
    )
    episode = folder / "episode"
    episode.mkdir()
    motion = Motion(episode)
    for k in range(3):
        motion.moment(Moment(k / 5, np.zeros(3), 0.08))
        motion.frame(np.zeros((32, 32, 3), np.uint8))
    motion.finish()
    result = {
        "episode": "e",
        "success": True,
        "verdict": "verified_success",
        "instruction": "lift it",
        "robot": "sapien_panda",
        "attempts": [{}],
        "robot_options": {"urdf": "x", "cameras": ["front"]},
    }
    (episode / "result.json").write_text(json.dumps(result))
    (episode / "config.yaml").write_text("robot:\n  urdf: x\n  cameras: [front]\n")
    thing = {
        "id": "o1",
        "label": "cup",
        "shape": "box",
        "colour": "red",
        "world_from_object": np.eye(4).tolist(),
        "extents": [0.1, 0.1, 0.1],
    }
    (episode / "scene.json").write_text(
        json.dumps(
            {"objects": [thing], "workspace": {"low": [0, 0, 0], "high": [1, 1, 1]}, "table_height": 0.0}
        )
    )
    (episode / "views").symlink_to(views)
    np.savez(
        folder / "prior.npz",
        depth=np.ones((2, 32, 32), np.float32),
        world_from_camera=np.stack([np.eye(4)] * 2),
    )
    np.savez(folder / "params.npz", scale=1.0, rotation=[1.0, 0, 0, 0], translation=[0.0, 0, 1])
    lesson = {
        "memory_id": "m1",
        "content": "Lift slowly.",
        "type": "procedural_hint",
        "query": "lift",
        "signature": {"height": 0.1},
        "outcome": "verified_success",
        "quality": 0.9,
        "confidence": 0.8,
    }
    (folder / "lessons.jsonl").write_text(
        "\n".join(
            json.dumps({**lesson, "memory_id": f"m{n}", "content": f"Lift slowly {n}."}) for n in range(3)
        )
    )
    jobs = folder / "jobs" / "0"
    jobs.mkdir(parents=True)
    row = {
        "job": 0,
        "overrides": {"seed": "0"},
        "status": "ok",
        "digest": "d",
        "results": f"sqlite:///{folder}/results.db",
        "episodes": 1,
        "succeeded": 1.0,
        "seconds": 1.0,
        "layouts": [[0, True, True]],
    }
    (jobs / "job.json").write_text(json.dumps(row))
    calibration = {
        "T_base_camera": np.eye(4).tolist(),
        "intrinsics": {"fx": 40, "fy": 40, "cx": 16, "cy": 16, "width": 32, "height": 32},
        "serial": "1",
        "rmse": 0.001,
        "convention": CONVENTION,
    }
    (folder / "camera.json").write_text(json.dumps(calibration))
    pictures = read_views(views)

    def exported(path: Path) -> None:
        shutil.rmtree(path.parent / "set", ignore_errors=True)
        export([path.parent], path.parent / "set")

    def imported(path: Path) -> None:
        with KnowledgeBank(folder / "memory.db") as bank:
            import_jsonl(bank, path)

    def swept(path: Path) -> None:
        jobs = read_jobs(path.parent.parent)
        if jobs:
            publish_jobs(path.parent.parent, jobs)

    beside = {
        "result.json": (episode / "result.json", [exported]),
        "motion.npz": (episode / "motion.npz", [exported]),
        "episode.mp4": (episode / "episode.mp4", [exported]),
        "config.yaml": (episode / "config.yaml", [exported]),
        "scene.json": (episode / "scene.json", [lambda p: read_scene(p.parent)]),
    }
    return {
        "cameras.json": (views / "cameras.json", [lambda path: read_views(path.parent)]),
        "png": (views / "images" / "a.png", [lambda path: read_views(path.parent.parent)]),
        "prior npz": (
            folder / "prior.npz",
            [lambda path: FilePrior(FilePriorConfig(path=str(path))).predict(pictures)],
        ),
        "pose npz": (folder / "params.npz", [_read_pose]),
        "jsonl": (folder / "lessons.jsonl", [imported]),
        "job.json": (jobs / "job.json", [swept]),
        "calibration": (folder / "camera.json", [Calibration.load]),
        **beside,
    }


def outcome(reader: Reader, path: Path) -> str:
    """ "" for a file that was read or refused by name, else what went wrong."""
    out, into = os.pipe()
    if (child := os.fork()) == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        fault = ""
        try:
            reader(path)
        except BaseException as error:
            chain = traceback.format_exc()
            if "MemoryError" in chain or "ArrayMemoryError" in chain:
                fault = f"memory: {error!r}"
            elif not isinstance(error, Gvla2Error):
                last = traceback.extract_tb(error.__traceback__)[-1]
                fault = f"{type(error).__name__} {Path(last.filename).name}:{last.lineno} {error}"
        os.write(into, fault[:400].encode(errors="replace"))
        os._exit(0)
    os.close(into)
    signal.signal(signal.SIGALRM, lambda *_: os.kill(child, signal.SIGKILL))
    signal.alarm(SECONDS)
    _, status = os.waitpid(child, 0)
    signal.alarm(0)
    text = os.read(out, 4096).decode()
    os.close(out)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return "hang" if number == signal.SIGKILL else f"signal {number}"
    return text


def main() -> None:
    words = sys.argv[1:]
    count = next((int(word) for word in words if word.isdigit()), 500)
    chosen = [word for word in words if not word.isdigit()]
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["GVLA2_CACHE"] = str(folder / "cache")
        targets = {**mesh_targets(folder), **robot_targets(folder), **run_targets(folder)}
        for kind, (path, readers) in targets.items():
            if chosen and kind not in chosen:
                continue
            content, rng, faults = path.read_bytes(), random.Random(kind), Counter[str]()
            for reader in readers:
                reader(path)
            examples: dict[str, Path] = {}
            for number in range(count):
                path.write_bytes(mutate(content, rng))
                if fault := outcome(rng.choice(readers), path):
                    key = re.sub(r"\d+", "#", fault)[:150]
                    faults[key] += 1
                    if key not in examples:
                        kept = Path(
                            tempfile.gettempdir(),
                            "gvla2-fuzz",
                            f"{kind.replace(' ', '_')}-{number}{path.suffix}",
                        )
                        kept.parent.mkdir(exist_ok=True)
                        kept.write_bytes(path.read_bytes())
                        examples[key] = kept
            path.write_bytes(content)
            failed += sum(faults.values())
            print(
                f"{kind:14} {count} mutations, {len(readers)} readers: {sum(faults.values())} faults",
                flush=True,
            )
            for key, number in faults.most_common(40):
                print(f"    {number:4} {key}  [{examples[key]}]", flush=True)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()

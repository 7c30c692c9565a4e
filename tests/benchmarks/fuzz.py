"""Damaged files through every reader: how many end in an error of ours, and which in anything else.

python tests/benchmarks/fuzz.py [mutations, by default 500] [kind ...]

Each case runs in a process of its own with 5 s and 1 GB: it must read the file or raise an error of gvla2. Anything
else that it raises, a process that dies or hangs, and memory that runs out are faults; a file that shows it is kept.
"""

from __future__ import annotations

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

from gvla2.commands.export import export
from gvla2.commands.objects import read_scene
from gvla2.commands.sweeps import publish_jobs, read_jobs
from gvla2.errors import Gvla2Error
from gvla2.geometry.articulated_files import read_articulated
from gvla2.geometry.view_folders import read_views
from gvla2.memory import KnowledgeBank
from gvla2.memory.transfer import import_jsonl
from gvla2.perception.scans import read_scan as read_known
from gvla2.record.motion import Motion
from gvla2.robot.arm_from_urdf import arm_from_urdf
from gvla2.robot.backend import Moment
from gvla2.robot.calibration import CONVENTION, Calibration
from gvla2.robot.looks import link_surfaces
from gvla2.robot.scan import read_scan
from gvla2.robot.urdf import read_urdf
from gvla2_plugins.geofuse import FilePriorConfig
from gvla2_plugins.geofuse.results import read_result
from gvla2_plugins.geofuse.sources import FilePrior
from gvla2_plugins.mujoco import MjcfConfig
from gvla2_plugins.mujoco.worlds import MjcfWorld
from gvla2_plugins.sapien import SapienArmConfig

SECONDS, MEMORY = 5, 1 << 30
ODD = (
    b"0",
    b"-1",
    b"nan",
    b"inf",
    b"1e308",
    b"99999999999",
    b"[]",
    b"{}",
    b"null",
    b'"x"',
    b"\xff\xfe",
    b"\0",
    b"",
)
WORDS = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f")
Reader = Callable[[Path], object]
Targets = dict[str, tuple[Path, list[Reader]]]


def mutate(content: bytes, rng: random.Random) -> bytes:
    """One to four changes: bytes flipped, cut, doubled or overwritten; numbers and words replaced by odd ones."""
    for _ in range(rng.randint(1, 4)):
        at, length = rng.randrange(len(content) + 1), rng.choice((1, 4, 30, 400))
        before, after = content[:at], content[at:]
        match rng.randrange(6):
            case 0:
                content = before + bytes([rng.randrange(256)]) + after[1:]
            case 1:
                content = before + after[length:]
            case 2:
                content = before + after[:length] * rng.choice((2, 50)) + after[length:]
            case 3:
                content = content[: max(at, 1)]
            case 4:
                content = before + rng.choice(WORDS) + after[4:]
            case _:
                if words := list(re.finditer(rb"[-\w.]+", content)):
                    word = rng.choice(words)
                    content = content[: word.start()] + rng.choice(ODD) + content[word.end() :]
    return content


def meshes(folder: Path) -> Targets:
    """A textured or coloured box in each format, for those who place, recognise and draw meshes."""
    textured, coloured = (trimesh.creation.box((0.05, 0.06, 0.08)) for _ in range(2))
    uv = np.random.default_rng(0).random((8, 2))
    textured.visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.new("RGB", (8, 8), "red"))
    coloured.visual.vertex_colors = np.full((8, 4), 200, np.uint8)
    for name in ("box.obj", "box.glb"):
        textured.export(folder / name)
    for name in ("binary.ply", "box.dae", "box.stl", "box.off"):
        coloured.export(folder / name)
    coloured.export(folder / "box.ply", encoding="ascii")

    def drawn(path: Path) -> None:
        shape = f'<geometry><mesh filename="{path.name}"/></geometry>'
        urdf = path.with_name("beside.urdf")
        urdf.write_text(f'<robot name="r"><link name="l"><visual>{shape}</visual></link></robot>')
        read_articulated(urdf)
        link_surfaces(read_urdf(urdf))

    readers: list[Reader] = [read_scan, lambda path: read_known("x", path), drawn]
    names = ("box.obj", "box.ply", "binary.ply", "box.glb", "box.dae", "box.stl", "box.off")
    return {name: (folder / name, readers) for name in names}


def robots(folder: Path) -> Targets:
    """An arm as a URDF and in an MJCF file."""
    numbers, joints = range(1, 7), [f"j{n}" for n in range(1, 7)]
    link = (
        '<visual><origin xyz="0 0 .07"/><geometry><cylinder radius=".02" length=".12"/></geometry></visual>'
    )
    limit = '<limit lower="-2.8" upper="2.8" velocity="2" effort="9"/>'
    axes = [f"0 {n % 2} {1 - n % 2}" for n in numbers]
    urdf = "".join(f'<link name="l{n}">{link}</link>' for n in range(7)) + "".join(
        f'<joint name="j{n}" type="revolute"><parent link="l{n - 1}"/><child link="l{n}"/><origin xyz="0 0 .15"/>'
        f'<axis xyz="{axis}"/>{limit}</joint>'
        for n, axis in zip(numbers, axes, strict=True)
    )
    (folder / "arm.urdf").write_text(f'<robot name="six">{urdf}</robot>')
    solid = '<geom type="capsule" size=".02 .05" pos="0 0 .07"/>'
    chain = "".join(
        f'<body name="l{n}" pos="0 0 .15"><joint name="j{n}" axis="{axis}" range="-2.8 2.8"/>{solid}'
        for n, axis in zip(numbers, axes, strict=True)
    )
    hand = "".join(
        f'<body name="f{n}" pos="{0.04 * n} 0 .1"><joint name="f{n}" type="slide" axis="{-n} 0 0" range="0 .04"/>'
        '<geom type="box" size=".006 .01 .025"/></body>'
        for n in (-1, 1)
    )
    motors = "".join(f'<position joint="{name}" kp="100" ctrlrange="-2.8 2.8"/>' for name in joints)
    motors += "".join(f'<position name="g{n}" joint="f{n}" kp="100" ctrlrange="0 .04"/>' for n in (-1, 1))
    base = '<camera name="c" pos="1 0 1"/><body name="l0"><geom type="box" size=".05 .05 .05"/>'
    (folder / "arm.xml").write_text(
        f"<mujoco><worldbody>{base}{chain}{hand}{'</body>' * 7}</worldbody><actuator>{motors}</actuator></mujoco>"
    )

    def mujoco(path: Path) -> None:
        config = MjcfConfig(mjcf=str(path), base="l0", tool="l6", joints=joints, cameras=["c"])
        config.fingers, config.gripper_actuators = ["f-1", "f1"], ["g-1", "g1"]
        world = MjcfWorld(config)
        world.begin(0)
        world.measure()  # by the arm that the model has

    def sapien(path: Path) -> None:
        arm_from_urdf(SapienArmConfig(urdf=str(path), tool_link="l6", home=[0.0] * 6))

    return {"urdf": (folder / "arm.urdf", [read_articulated, sapien]), "mjcf": (folder / "arm.xml", [mujoco])}


def views(folder: Path) -> Targets:
    """Pictures with their cameras, and what programs make of them."""
    (folder / "images").mkdir()
    for name in ("a", "b"):
        Image.new("RGB", (32, 32)).save(folder / "images" / f"{name}.png")
    K, T = [[40, 0, 16], [0, 40, 16], [0, 0, 1]], np.eye(4).tolist()
    (folder / "cameras.json").write_text(
        json.dumps({"K": K, "views": [{"name": name, "T": T} for name in "ab"]})
    )
    np.savez(folder / "prior.npz", depth=np.ones((2, 32, 32), np.float32), world_from_camera=[T, T])
    np.savez(folder / "params.npz", scale=1.0, rotation=[1.0, 0, 0, 0], translation=[0.0, 0, 1])
    trimesh.creation.box((1, 1, 1)).export(folder / "result.glb")
    size = {"fx": 40, "fy": 40, "cx": 16, "cy": 16, "width": 32, "height": 32}
    seen = {"T_base_camera": T, "intrinsics": size, "serial": "1", "rmse": 0.001, "convention": CONVENTION}
    (folder / "camera.json").write_text(json.dumps(seen))
    pictures = read_views(folder)
    return {
        "cameras.json": (folder / "cameras.json", [lambda path: read_views(path.parent)]),
        "png": (folder / "images" / "a.png", [lambda path: read_views(path.parent.parent)]),
        "prior.npz": (
            folder / "prior.npz",
            [lambda path: FilePrior(FilePriorConfig(path=str(path))).predict(pictures)],
        ),
        "params.npz": (folder / "params.npz", [lambda path: read_result(path.parent)]),
        "calibration": (folder / "camera.json", [Calibration.load]),
    }


def runs(folder: Path) -> Targets:
    """What runs, sweeps and memories leave."""
    motion = Motion(folder)
    for k in range(3):
        motion.moment(Moment(k / 5, np.zeros(3), 0.08))
        motion.frame(np.zeros((32, 32, 3), np.uint8))
    motion.finish()
    result = {
        "episode": "e",
        "success": True,
        "instruction": "lift it",
        "robot": "sapien_panda",
        "attempts": [{}],
    }
    (folder / "result.json").write_text(
        json.dumps({**result, "robot_options": {"urdf": "x", "cameras": ["c"]}})
    )
    (folder / "config.yaml").write_text("robot:\n  urdf: x\n  cameras: [front]\n")
    cup = {"id": "o1", "label": "cup", "shape": "box", "colour": "red", "extents": [0.1, 0.1, 0.1]}
    scene = {"objects": [{**cup, "world_from_object": np.eye(4).tolist()}], "table_height": 0.0}
    (folder / "scene.json").write_text(
        json.dumps({**scene, "workspace": {"low": [0, 0, 0], "high": [1, 1, 1]}})
    )
    shutil.copytree(folder.parent / "views", folder / "views")
    lesson = {"query": "lift", "signature": {"height": 0.1}, "outcome": "verified_success", "quality": 0.9}
    lines = [
        json.dumps({"content": f"Lift slowly {n}.", "type": "procedural_hint", **lesson}) for n in range(3)
    ]
    (folder / "lessons.jsonl").write_text("\n".join(lines))
    (folder / "jobs" / "0").mkdir(parents=True)
    row = {"factors": {"seed": 0}, "measures": {"success": 1.0, "seconds": 1.0}, "notes": {"folder": "x"}}
    job = {"job": 0, "overrides": {"seed": "0"}, "status": "ok", "digest": "d", "value": 1.0, "rows": [row]}
    job |= {"results": f"sqlite:///{folder}/results.db"}
    (folder / "jobs" / "0" / "job.json").write_text(json.dumps(job))

    def exported(path: Path) -> None:
        shutil.rmtree(path.parent / "set", ignore_errors=True)
        export([path.parent], path.parent / "set")

    def imported(path: Path) -> None:
        with KnowledgeBank(path.with_name("memory.db")) as bank:
            import_jsonl(bank, path)

    def published(path: Path) -> None:
        if jobs := read_jobs(path.parent.parent):
            publish_jobs("run", path.parent.parent, jobs)

    episode = ("result.json", "motion.npz", "episode.mp4", "config.yaml")
    return {
        **{name: (folder / name, [exported]) for name in episode},
        "scene.json": (folder / "scene.json", [lambda path: read_scene(path.parent)]),
        "jsonl": (folder / "lessons.jsonl", [imported]),
        "job.json": (folder / "jobs" / "0" / "job.json", [published]),
    }


def outcome(reader: Reader, path: Path) -> str:
    """What went wrong, "" for a file that was read or refused by name."""
    out, into = os.pipe()
    if (child := os.fork()) == 0:
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        fault = ""
        try:
            reader(path)
        except BaseException as error:
            if "MemoryError" in traceback.format_exc():
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
    os.set_blocking(out, False)  # a process that the reader left behind may hold the other end
    try:
        text = os.read(out, 4096).decode()
    except BlockingIOError:
        text = ""
    os.close(out)
    if os.WIFSIGNALED(status):
        return "hangs" if os.WTERMSIG(status) == signal.SIGKILL else f"signal {os.WTERMSIG(status)}"
    return text


def attack(name: str, path: Path, readers: list[Reader], count: int) -> Counter[str]:
    """The faults of ``count`` mutations, each with a file that shows it."""
    content, rng, faults = path.read_bytes(), random.Random(name), Counter[str]()
    shown: dict[str, Path] = {}
    for reader in readers:
        reader(path)
    for number in range(count):
        path.write_bytes(mutate(content, rng))
        if fault := re.sub(r"\d+", "#", outcome(rng.choice(readers), path)):
            if fault not in shown:
                kept = Path(tempfile.gettempdir(), "gvla2-fuzz", f"{path.stem}-{number}{path.suffix}")
                kept.parent.mkdir(exist_ok=True)
                shown[fault] = Path(shutil.copyfile(path, kept))
            faults[f"{fault}  [{shown[fault]}]"] += 1
    path.write_bytes(content)
    return faults


def main() -> None:
    count = next((int(word) for word in sys.argv[1:] if word.isdigit()), 500)
    chosen = [word for word in sys.argv[1:] if not word.isdigit()]
    total = 0
    with tempfile.TemporaryDirectory() as place:
        os.environ["GVLA2_CACHE"] = f"{place}/cache"
        for made in (meshes, robots, views, runs):
            folder = Path(place, made.__name__)
            folder.mkdir()
            for name, (path, readers) in made(folder).items():
                if chosen and name not in chosen:
                    continue
                faults = attack(name, path, readers, count)
                total += faults.total()
                print(f"{name:14} {count} mutations: {faults.total()} faults", flush=True)
                for fault, number in faults.most_common():
                    print(f"    {number:4} {fault}", flush=True)
    sys.exit(bool(total))


if __name__ == "__main__":
    main()

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
from importlib.resources import files
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from gvla2 import run
from gvla2.commands.export import export
from gvla2.commands.objects import read_scene
from gvla2.commands.sweeps import publish_jobs, read_jobs
from gvla2.errors import Gvla2Error
from gvla2.geometry.articulated_files import read_articulated
from gvla2.geometry.view_folders import CAMERAS, VIEWS, read_views
from gvla2.memory import KnowledgeBank
from gvla2.memory.transfer import import_jsonl
from gvla2.perception.scans import read_scan as read_known
from gvla2.robot.arm_from_urdf import arm_from_urdf
from gvla2.robot.calibration import Calibration
from gvla2.robot.looks import link_surfaces
from gvla2.robot.scan import read_scan
from gvla2.robot.urdf import read_urdf
from gvla2_plugins.geofuse import FilePriorConfig
from gvla2_plugins.geofuse.results import read_result
from gvla2_plugins.geofuse.sources import FilePrior
from gvla2_plugins.mujoco import MjcfConfig
from gvla2_plugins.mujoco.worlds import MjcfWorld
from gvla2_plugins.sapien import SapienPiperConfig

SECONDS, MEMORY = 5, 1 << 30
ODD = (*b'0 -1 nan inf 1e308 99999999999 [] {} null "x"'.split(), b"\xff\xfe", b"\0", b"")
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
    """An arm as a URDF, the Piper's, and in an MJCF file: a shoulder, an elbow and two fingers."""
    urdf = files("gvla2.robot") / "descriptions/piper.urdf"
    (folder / "arm.urdf").write_text(urdf.read_text("utf-8"))
    (folder / "arm.xml").write_text(
        """<mujoco><worldbody><camera name="c" pos="1 0 1"/><body name="l0"><geom type="box" size=".05 .05 .05"/>
        <body name="l1" pos="0 0 .15"><joint name="j1" axis="0 0 1" range="-2.8 2.8"/>
        <geom type="capsule" size=".02 .05" pos="0 0 .07"/>
        <body name="l2" pos="0 0 .15"><joint name="j2" axis="0 1 0" range="-2.8 2.8"/>
        <geom type="capsule" size=".02 .05" pos="0 0 .07"/>
        <body name="f1" pos="-.04 0 .1"><joint name="f1" type="slide" axis="1 0 0" range="0 .04"/>
        <geom type="box" size=".006 .01 .025"/></body>
        <body name="f2" pos=".04 0 .1"><joint name="f2" type="slide" axis="-1 0 0" range="0 .04"/>
        <geom type="box" size=".006 .01 .025"/></body></body></body></body></worldbody>
        <actuator><position joint="j1" kp="99" ctrlrange="-2.8 2.8"/><position joint="j2" kp="99" ctrlrange="-2.8 2.8"/>
        <position name="g1" joint="f1" kp="99" ctrlrange="0 .04"/>
        <position name="g2" joint="f2" kp="99" ctrlrange="0 .04"/>
        </actuator></mujoco>"""
    )

    def mujoco(path: Path) -> None:
        config = MjcfConfig(mjcf=str(path), base="l0", tool="l2", joints=["j1", "j2"], cameras=["c"])
        config.fingers, config.gripper_actuators = ["f1", "f2"], ["g1", "g2"]
        world = MjcfWorld(config)
        world.begin(0)
        world.measure()  # by the arm that the model has

    def sapien(path: Path) -> None:
        arm_from_urdf(SapienPiperConfig(urdf=str(path)))

    return {"urdf": (folder / "arm.urdf", [read_articulated, sapien]), "mjcf": (folder / "arm.xml", [mujoco])}


def runs(folder: Path) -> Targets:
    """What a run, a sweep and a memory leave, and what other programs make of a run's views."""
    run(folder, task="put_block", memory="none", **{"robot.image_size": 96, "robot.video_size": 32})
    pictures = read_views(folder)
    poses = np.array([view.camera.world_from_camera for view in pictures])
    depth = np.ones((len(pictures), *pictures[0].image.shape[:2]), np.float32)
    np.savez(folder / "prior.npz", depth=depth, world_from_camera=poses)
    np.savez(folder / "params.npz", scale=1.0, rotation=[1.0, 0, 0, 0], translation=[0.0, 0, 1])
    trimesh.creation.box((1, 1, 1)).export(folder / "result.glb")
    Calibration(pictures[0].camera, "1", 0.001).save(folder / "camera.json")
    lesson = {"query": "lift", "outcome": "verified_success", "quality": 0.9}
    lines = [
        json.dumps({"content": f"Lift slowly {n}.", "type": "procedural_hint", **lesson}) for n in range(3)
    ]
    (folder / "lessons.jsonl").write_text("\n".join(lines))
    (folder / "jobs" / "0").mkdir(parents=True)
    row = {"factors": {"seed": 0}, "measures": {"success": 1.0, "seconds": 1.0}, "notes": {"folder": "x"}}
    job = {"job": 0, "overrides": {"seed": "0"}, "status": "ok", "digest": "d", "value": 1.0, "rows": [row]}
    job |= {"results": f"sqlite:///{folder}/results.db"}
    (folder / "jobs" / "0" / "job.json").write_text(json.dumps(job))

    def seen(_: Path) -> None:
        read_views(folder)

    def exported(path: Path) -> None:
        shutil.rmtree(path.parent / "set", ignore_errors=True)
        export([path.parent], path.parent / "set")

    def imported(path: Path) -> None:
        with KnowledgeBank(path.with_name("memory.db")) as bank:
            import_jsonl(bank, path)

    def published(path: Path) -> None:
        if jobs := read_jobs(path.parent.parent):
            publish_jobs("run", path.parent.parent, jobs)

    def prior(path: Path) -> None:
        FilePrior(FilePriorConfig(path=str(path))).predict(pictures)

    episode = ("result.json", "motion.npz", "episode.mp4", "config.yaml")
    return {
        **{name: (folder / name, [exported]) for name in episode},
        "scene.json": (folder / "scene.json", [lambda path: read_scene(path.parent)]),
        "cameras.json": (folder / VIEWS / CAMERAS, [seen]),
        "png": (folder / VIEWS / "images" / "0.png", [seen]),
        "prior.npz": (folder / "prior.npz", [prior]),
        "params.npz": (folder / "params.npz", [lambda path: read_result(path.parent)]),
        "calibration": (folder / "camera.json", [Calibration.load]),
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
        os.chdir(place)  # a mutated address of a database may be a relative one
        os.environ["GVLA2_CACHE"] = f"{place}/cache"
        for made in (meshes, robots, runs):
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

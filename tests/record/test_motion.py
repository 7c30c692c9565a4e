"""The film of every frame and the arm's states, and the data set for training that they become."""

import json
import resource
import tracemalloc
from dataclasses import replace
from itertools import product
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from gvla2 import cli
from gvla2.errors import Gvla2Error, OutputError
from gvla2.record.motion import FILM, STATES, Motion
from gvla2.robot.backend import Moment

pq = pytest.importorskip("pyarrow.parquet", reason="pip install 'gvla2[export]'")

from gvla2.record.lerobot import Demonstration, VideoFile, write_dataset  # noqa: E402 - needs it

# imageio-ffmpeg leaves the pipe to its reading process to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")

FRAMES, FPS = 7, 5.0
VIDEO, WRIST = "observation.images.front", "observation.images.wrist"


def joints(k: int, dof: int = 3) -> np.ndarray:
    return np.full(dof, 0.1 * k)


def keep(folder: Path, frames: int = FRAMES, side: int = 34, dof: int = 3, states: bool = True) -> Path:
    """A film whose red rises from frame to frame, with its states, as a run leaves them."""
    folder.mkdir(parents=True, exist_ok=True)
    motion = Motion(folder)
    for k in range(frames):
        if states:
            motion.moment(Moment(2.0 + k / FPS, joints(k, dof), 0.08))
        image = np.zeros((side, 2 * side, 3), np.uint8)
        image[:, :side, 0] = 30 * k % 256
        motion.frame(image)
    motion.finish()
    motion.finish()
    return folder


def result(folder: Path, **changed: object) -> Path:
    content = {
        "episode": "e", "success": True, "verdict": "verified_success", "instruction": "lift it",
        "robot": "sapien_panda", "attempts": [{}], **changed,
    }  # fmt: skip
    (folder / "result.json").write_text(json.dumps(content))
    return folder


def demonstration(folder: Path, task: str = "lift it", **size: int) -> Demonstration:
    keep(folder, **size)
    with np.load(folder / STATES) as kept:
        states = np.column_stack([kept["joints"], kept["gripper_width"]]).astype(np.float32)
    film = VideoFile.read(folder / FILM, ("front", "wrist"))
    return Demonstration(states, FPS, film, task, "sapien_panda", commands=states + 1, labels={"seed": 3})


def test_memory_does_not_grow_with_the_frames(tmp_path: Path):
    peaks = []
    for number, frames in enumerate((20, 20, 200)):  # the first one imports
        one = demonstration(tmp_path / f"of{number}", frames=frames, side=64)
        tracemalloc.start()
        write_dataset(tmp_path / f"set{number}", [one] * 3)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # The pictures of the long ones are 14 MB.
    assert peaks[2] < peaks[1] + 500_000


def test_every_frame_has_its_state(tmp_path: Path):
    keep(tmp_path)
    with np.load(tmp_path / STATES) as kept:
        assert kept["fps"] == FPS
        assert kept["joints"].shape == (FRAMES, 3)
        np.testing.assert_allclose(kept["joints"][:, 0], 0.1 * np.arange(FRAMES))
    reader = imageio_ffmpeg.read_frames(str(tmp_path / FILM))
    header = next(reader)
    assert (header["size"], header["fps"]) == ((68, 34), FPS)
    reds = [np.frombuffer(frame, np.uint8).reshape(34, 68, 3)[:, :34, 0].mean() for frame in reader]
    np.testing.assert_allclose(reds, 30 * np.arange(FRAMES), atol=12)


def test_a_film_for_which_there_is_no_room_is_none(tmp_path: Path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OutputError, match="film"):
            keep(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_the_data_set_has_the_published_layout(tmp_path: Path):
    episodes = [
        demonstration(tmp_path / "a"),
        demonstration(tmp_path / "b", "push it", frames=5),
        demonstration(tmp_path / "c"),
    ]
    target = tmp_path / "set"
    write_dataset(target, episodes)
    info = json.loads((target / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 5, "sapien_panda")
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (3, 19, 2)
    assert info["features"][VIDEO]["shape"] == [34, 34, 3]
    assert info["features"]["action"]["names"][-1] == "gripper.width"
    data = pq.read_table(target / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.column_names) == set(info["features"]) - {VIDEO, WRIST}
    assert data["index"].to_pylist() == list(range(19))
    assert data["episode_index"].to_pylist() == [0] * 7 + [1] * 5 + [2] * 7
    assert data["task_index"].to_pylist() == [0] * 7 + [1] * 5 + [0] * 7
    state, action = (np.array(data[name].to_pylist()) for name in ("observation.state", "action"))
    np.testing.assert_allclose(action[:6], state[1:7] + 1, err_msg="what the robot was driven to")
    np.testing.assert_allclose(action[6], state[6] + 1, err_msg="the last repeats its own")
    np.testing.assert_allclose(data["timestamp"].to_numpy()[7:12], np.arange(5) / FPS, atol=1e-6)
    rows = pq.read_table(target / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(r["dataset_from_index"], r["dataset_to_index"]) for r in rows] == [(0, 7), (7, 12), (12, 19)]
    assert [r["seed"] for r in rows] == [3, 3, 3]
    for row, camera in product(rows, (VIDEO, WRIST)):
        place = {name: row[f"videos/{camera}/{name}"] for name in ("chunk_index", "file_index")}
        film = VideoFile.read(target / info["video_path"].format(video_key=camera, **place), ("one",))
        reds = film.colours[0, 0] @ np.arange(256) / film.colours[0, 0].sum()
        assert (film.frames, reds > 20) == (row["length"], camera == VIDEO)
    stats = json.loads((target / "meta/stats.json").read_text())
    reds = np.concatenate([30 * np.arange(n) for n in (7, 5, 7)]) / 255
    q90 = np.quantile(reds, 0.9, method="inverted_cdf")
    expected = {"min": reds.min(), "max": reds.max(), "mean": reds.mean(), "q90": q90}
    for name, value in expected.items():
        assert np.shape(stats[VIDEO][name]) == (3, 1, 1)
        assert stats[VIDEO][name][0][0][0] == pytest.approx(value, abs=0.05)
    assert stats["action"]["count"] == [19]


def test_the_tasks_are_a_frame_of_pandas_whose_index_is_the_sentence(tmp_path: Path):
    pandas = pytest.importorskip("pandas", reason="LeRobot reads tasks by pandas, which gvla2 does not need")
    write_dataset(tmp_path / "set", [demonstration(tmp_path / "a"), demonstration(tmp_path / "b", "push it")])
    tasks = pandas.read_parquet(tmp_path / "set/meta/tasks.parquet")
    assert list(tasks.index) == ["lift it", "push it"]
    assert list(tasks["task_index"]) == [0, 1]


def test_a_data_set_for_which_there_is_no_room_is_none(tmp_path: Path):
    one, limits = demonstration(tmp_path / "a"), resource.getrlimit(resource.RLIMIT_FSIZE)
    target = tmp_path / "sets" / "set"
    (target.parent / ".set.unfinished" / "of a killed export").mkdir(parents=True)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, limits[1]))
    try:
        with pytest.raises(OutputError, match="set"):
            write_dataset(target, [one])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(target.parent.iterdir())
    write_dataset(target, [one])
    assert (target / "meta" / "info.json").is_file()


def test_a_data_set_that_cannot_be_written_is_refused(tmp_path: Path):
    one = demonstration(tmp_path / "a")
    with pytest.raises(Gvla2Error, match="There is no episode"):
        write_dataset(tmp_path / "set", [])
    with pytest.raises(Gvla2Error, match="is not empty"):
        write_dataset(tmp_path / "a", [one])
    with pytest.raises(Gvla2Error, match=r"one of these: .*4 numbers.*8 numbers"):
        write_dataset(tmp_path / "set", [one, demonstration(tmp_path / "b", dof=7)])
    for source in ("urdf ur10.urdf, camera front", "urdf ur5.urdf, camera wrist"):
        one = replace(one, source="urdf ur5.urdf, camera front")
        other = replace(demonstration(tmp_path / source), source=source)
        with pytest.raises(Gvla2Error, match=f"one of these: .*{source}"):
            write_dataset(tmp_path / "set", [one, other])
    with pytest.raises(Gvla2Error, match="7 frames for 6 states"):
        write_dataset(tmp_path / "set", [replace(one, states=one.states[1:])])
    assert not (tmp_path / "set").exists()


def test_pictures_side_by_side_are_cropped_to_what_encoders_take(tmp_path: Path):
    write_dataset(tmp_path / "set", [demonstration(tmp_path / "a", side=33)])
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    films = sorted((tmp_path / "set/videos").rglob("*.mp4"))
    assert [info["features"][name]["shape"] for name in (VIDEO, WRIST)] == [[32, 32, 3]] * 2
    assert [next(imageio_ffmpeg.read_frames(str(film)))["size"] for film in films] == [(32, 32)] * 2


def test_one_export_writes_a_data_set_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    one, target, write = demonstration(tmp_path / "a"), tmp_path / "set", VideoFile.write

    def meanwhile(film: VideoFile, places: object, fps: float) -> None:
        with pytest.raises(Gvla2Error, match="Another export writes"):
            write_dataset(target, [one])
        write(film, places, fps)  # type: ignore[arg-type]

    monkeypatch.setattr(VideoFile, "write", meanwhile)
    write_dataset(target, [one])
    assert len(list(target.rglob("*.mp4"))) == 2
    assert not list(tmp_path.glob(".*"))


def test_the_command_takes_successes_below_any_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    runs = tmp_path / "runs"
    failed = {
        "success": False,
        "verdict": "verified_fail",
        "failure": {"stage": "execute", "kind": "slipped"},
    }
    outcomes = ({"seed": 9}, failed, {"success": None, "seed": 7}, {"attempts": [{}] * 2})
    for k, changed in enumerate(outcomes):
        result(keep(runs / "sweep" / str(k)), **changed)
    bare = runs / "bare"
    bare.mkdir()
    result(bare)
    (runs / "result.json").write_text(json.dumps({"rows": []}))  # a summary
    assert cli.main(["export", "lerobot", str(runs), f"to={tmp_path / 'set'}"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("2 episodes, 14 frames: ")
    assert "1 not succeeded" in printed
    assert "1 without a film" in printed
    assert "1 in several attempts" in printed
    rows = pq.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(one["seed"], one["run"], one["success"]) for one in rows] == [
        (7, "sweep/2", True),
        (9, "sweep/0", True),
    ]
    assert cli.main(["export", "lerobot", str(runs), f"to={tmp_path / 'all'}", "only=all"]) == 0
    assert capsys.readouterr().out.startswith("3 episodes")
    assert cli.main(["export", "lerobot", str(runs), f"to={tmp_path / 'failed'}", "only=failure"]) == 0
    (row,) = pq.read_table(tmp_path / "failed/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row[name] for name in ("verdict", "failure_stage", "failure")] == [
        "verified_fail",
        "execute",
        "slipped",
    ]


def test_what_cannot_be_read_is_left_out_by_name_and_no_episode_is_written_twice(tmp_path, capsys):
    runs = tmp_path / "runs"
    changes = {
        "gap": {"joints": np.full((FRAMES, 3), np.nan)},
        "rate": {"fps": 0.0},
        "short": {"command": [[0.0]]},
    }
    for name in ("good", "cut", "film", "foreign", "lacking", ".trash", *changes):
        result(keep(runs / name), instruction="lift \udcff")
    for name, change in changes.items():
        with np.load(runs / name / STATES) as kept:
            np.savez(runs / name / STATES, **{**kept, **change})
    result(keep(runs / "seed"), seed=2**70)
    (runs / "cut" / STATES).write_bytes((runs / "cut" / STATES).read_bytes()[:300])
    (runs / "film" / FILM).write_bytes(b"no film")
    (runs / "foreign" / "result.json").write_bytes(b"\xff\xfe{")
    (runs / "lacking" / "result.json").write_text('{"episode": "e", "success": true}')
    assert cli.main(["export", "lerobot", str(runs), str(runs / "good"), f"to={tmp_path / 'set'}"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("1 episode, 7 frames")
    assert "7 unreadable" in printed
    assert "1 with a seed of more than 64 bits" in printed
    assert all(str(runs / name) in printed for name in ("cut", "film", "foreign", "gap", "lacking"))

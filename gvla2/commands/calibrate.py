"""``gvla2 calibrate``: where a camera stands beside a robot, from recorded pose pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.plugins.registry import Registry


@dataclass
class CalibrateConfig:
    """``pairs`` is the file of recorded pose pairs; ``out`` where the calibration is written, "" for the run's folder.

    ``method`` takes that solver's answer instead of the best one's; ``serial`` must be the recording's camera, when
    given.
    """

    pairs: str = ""
    out: str = ""
    method: str = ""
    serial: str = ""


def job(config: CalibrateConfig, registry: Registry, folder: Path) -> float:
    """Calibrate; the RMSE in metres, for sweepers.

    ``folder`` gets ``residuals.svg`` in any case, ``hand_eye.json`` when the result is accepted. Raises
    :class:`ConfigurationError` for a wrong option, :class:`gvla2.errors.RobotError` for a recording that can't be read,
    is degenerate, or gives a result that is refused.
    """
    import numpy as np

    from gvla2.io.files import write_whole
    from gvla2.record.page import render
    from gvla2.robot.calibration import LARGEST_RMSE, Calibration, load_recording
    from gvla2.robot.hand_eye import solve

    if not config.pairs:
        raise ConfigurationError("Name the file of recorded pose pairs: gvla2 calibrate pairs=FILE.")
    recording = load_recording(Path(config.pairs))
    if config.serial and config.serial != recording.serial:
        raise ConfigurationError(
            f"The recording is from camera '{recording.serial}', but serial={config.serial} was given."
        )
    solutions = solve(recording.pairs, recording.mount)
    plot = folder / "residuals.svg"
    shifts = [(1e3 * solution.shifts).tolist() for solution in solutions]
    turns = [np.degrees(solution.turns).tolist() for solution in solutions]
    rms = [float(np.sqrt(np.mean(np.square(each)))) for each in turns]
    drawn = {"shifts": shifts, "turns": turns, "rms": rms, "limit": LARGEST_RMSE}
    write_whole(plot, render("residuals.svg.jinja", solutions=solutions, **drawn).strip().encode())
    for solution, turn in zip(solutions, rms, strict=True):
        print(f"{solution.method:<18} RMSE {1e3 * solution.rmse:7.3f} mm  {turn:7.4f} degrees")
    print(f"plot: {plot}")
    by_name = {solution.method: solution for solution in solutions}
    if config.method and config.method not in by_name:
        raise ConfigurationError(f"No solver '{config.method}'. There are: {', '.join(by_name)}.")
    chosen = by_name[config.method] if config.method else solutions[0]
    made = Calibration(
        transform=chosen.transform,
        intrinsics=recording.intrinsics,
        serial=recording.serial,
        n=len(recording.pairs),
        rmse=chosen.rmse,
        residuals=tuple(float(v) for v in chosen.shifts),
        method=chosen.method,
        mount=recording.mount,
    )
    path = Path(config.out) if config.out else folder / "hand_eye.json"
    made.save(path)
    print(f"calibration: {path}")
    return made.rmse


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 calibrate [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    return launch("calibrate", {"calibrate": CalibrateConfig}, job, argv)

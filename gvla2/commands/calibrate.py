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
    """``pairs`` is the file of recorded pose pairs; ``out`` where the result is written, "" for the run's folder."""

    pairs: str = ""
    out: str = ""


def job(config: CalibrateConfig, registry: Registry, folder: Path) -> float:
    """Calibrate; the RMSE in metres, for sweepers.

    Prints each pair's residuals. ``folder`` gets ``hand_eye.json`` when the result is accepted. Raises
    :class:`ConfigurationError` for a wrong option, :class:`gvla2.errors.RobotError` for a recording that can't be read,
    is degenerate, or gives a result that is refused.
    """
    import numpy as np

    from gvla2.robot.calibration import Calibration, load_recording, solve

    if not config.pairs:
        raise ConfigurationError("Name the file of recorded pose pairs: gvla2 calibrate pairs=FILE.")
    recording = load_recording(Path(config.pairs))
    transform, shifts, turns = solve(recording)
    for number, (shift, turn) in enumerate(zip(1e3 * shifts, np.degrees(turns), strict=True)):
        print(f"pair {number:<3} {shift:8.3f} mm  {turn:8.4f} degrees")
    rmse = float(np.sqrt(np.mean(shifts**2)))
    print(f"RMSE     {1e3 * rmse:8.3f} mm  {np.sqrt(np.mean(np.degrees(turns) ** 2)):8.4f} degrees")
    made = Calibration(transform, recording.intrinsics, recording.serial, rmse, recording.mount)
    path = Path(config.out) if config.out else folder / "hand_eye.json"
    made.save(path)
    print(f"calibration: {path}")
    return rmse


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 calibrate [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    return launch("calibrate", {"calibrate": CalibrateConfig}, job, argv)

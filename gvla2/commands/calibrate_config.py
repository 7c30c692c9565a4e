"""The schema of `gvla2 calibrate`: which recording, and where the calibration goes."""

from __future__ import annotations

from dataclasses import dataclass


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

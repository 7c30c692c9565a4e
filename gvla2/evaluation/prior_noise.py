"""Errors of a benchmark prior's depth: settings of ``prior=depth`` by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

_NONE: Mapping[str, float] = {
    "global_scale": 0.0, "view_scale": 0.0, "view_shift": 0.0, "low_frequency": 0.0, "slope": 0.0,
    "pose_degrees": 0.0, "pose_shift": 0.0, "edge_blur": 0.0, "outliers": 0.0, "confidence": 0.5,
}  # fmt: skip


def _learned(**parts: float) -> Mapping[str, Any]:
    return {"noise": "learned", "learned": {**_NONE, **parts}}


NOISES: Mapping[str, tuple[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "exact": ("exact depth", {"noise": "exact"}),
        "sensor": ("a sensor's noise (L515)", {"noise": "sensor"}),
        "low0.5": ("low-frequency error 0.5 %", _learned(low_frequency=0.005)),
        "low1": ("low-frequency error 1 %", _learned(low_frequency=0.01)),
        "low2": ("low-frequency error 2 %", _learned(low_frequency=0.02)),
        "low4": ("low-frequency error 4 %", _learned(low_frequency=0.04)),
        "view3": ("scale of each view ±3 %", _learned(view_scale=0.03)),
        "view10": ("scale of each view ±10 %", _learned(view_scale=0.10)),
        "slope20": ("slope of each view ±20 %", _learned(slope=0.20)),
        "vggt": (
            "as VGGT: free scale, poses 1° and 1 %, low-frequency 1 %, soft edges",
            {"noise": "learned"},
        ),
        "vggt_outliers": (
            "as VGGT, with 3 % outlier patches",
            _learned(
                global_scale=0.3,
                low_frequency=0.01,
                pose_degrees=1.0,
                pose_shift=0.01,
                edge_blur=1.0,
                outliers=0.03,
            ),
        ),
    }
)
"""By name: the caption, and the options of the ``depth`` prior."""

PER_CENT: Mapping[str, float] = MappingProxyType(
    {"exact": 0.0, "low0.5": 0.5, "low1": 1.0, "low2": 2.0, "low4": 4.0}
)
"""The settings along which a curve of gain against noise is drawn: per cent of low-frequency error."""

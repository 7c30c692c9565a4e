"""librealsense: loading it, and finding the connected camera or the reason why it is missing."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from typing import Any

from gvla2.errors import MissingDependencyError, RobotError

_INSTALL = "pip install 'gvla2[realsense]'"


def load() -> Any:
    """The module ``pyrealsense2``.

    Raises :class:`MissingDependencyError` when it, or its libusb, is missing.
    """
    _offer_libusb()
    try:
        import pyrealsense2
    except ModuleNotFoundError as error:
        raise MissingDependencyError("pyrealsense2", "camera=realsense", _INSTALL, "Apache-2.0") from error
    except ImportError as error:
        raise MissingDependencyError(
            f"a library that pyrealsense2 links to ({error})", "camera=realsense", _INSTALL
        ) from error
    return pyrealsense2


def _offer_libusb() -> None:
    """Load the libusb of the package ``libusb_package`` for all, so that pyrealsense2 finds its symbols there.

    Without such a package, or if it does not fit this system, the system's own libusb may still work.
    """
    if os.name != "posix":
        return  # elsewhere the wheel has what it needs
    try:
        import libusb_package

        path = libusb_package.get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    except (ImportError, OSError):
        return


_WEBCAM = "Platform Camera"
"""librealsense's name for a foreign camera."""

_RETIRED = (
    " L5xx and SR3xx cameras need pyrealsense2<2.55; or record with other software and use camera=replay."
)


def choose(rs: Any, devices: Sequence[Any], serial: str = "") -> Any:
    """The device of that serial, or the only one there is.

    Raises :class:`RobotError`, listing the connected ones.
    """
    found = {serial_of(rs, d): d for d in devices if name_of(rs, d) != _WEBCAM}
    if serial in found:
        return found[serial]
    listing = ", ".join(f"{name_of(rs, device)} '{key}'" for key, device in found.items())
    if serial and found:
        raise RobotError(f"No camera with the serial '{serial}' is plugged in; there is {listing}.{_RETIRED}")
    if not found:
        asked = f" '{serial}'" if serial else ""
        raise RobotError(
            f"librealsense finds no camera{asked}. Plug it into a USB 3 port; on Linux, librealsense's udev rules "
            f"give users access to it.{_RETIRED}"
        )
    if len(found) > 1:
        raise RobotError(f"Several cameras are plugged in: {listing}. Choose one with camera.serial=...")
    return next(iter(found.values()))


def serial_of(rs: Any, device: Any) -> str:
    """The device's serial number, "" for a device that has none."""
    return _info(device, rs.camera_info.serial_number)


def name_of(rs: Any, device: Any) -> str:
    """The maker's name for it."""
    return _info(device, rs.camera_info.name) or "a camera without a name"


def _info(device: Any, what: Any) -> str:
    return str(device.get_info(what)) if device.supports(what) else ""

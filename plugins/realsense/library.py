"""Loading librealsense: its Python wheel links to libusb without bundling it."""

from __future__ import annotations

import ctypes
import os
from importlib import metadata
from typing import Any

from gvla2.errors import MissingDependencyError

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


def version() -> tuple[int, int]:
    """Major and minor of the installed librealsense, (0, 0) when they can't be told."""
    try:
        major, minor = metadata.version("pyrealsense2").split(".")[:2]
        return int(major), int(minor)
    except (metadata.PackageNotFoundError, ValueError):
        return 0, 0


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

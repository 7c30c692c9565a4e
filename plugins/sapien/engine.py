"""Importing SAPIEN, with advice on what to install if it does not load."""

from __future__ import annotations

import warnings
from typing import Any

from gvla2.errors import MissingDependencyError
from gvla2_plugins.sapien.lazy_import import waiting


def import_sapien() -> Any:
    """The module ``sapien``; raises :class:`MissingDependencyError` naming the missing part."""
    try:
        with warnings.catch_warnings():
            # It looks for Vulkan, which CPU physics does not need.
            warnings.simplefilter("ignore")
            with waiting("requests"):  # for downloads that are not made here
                import sapien
                import sapien.physx
    except ModuleNotFoundError as error:
        if error.name != "sapien":
            raise
        raise MissingDependencyError(
            "the package 'sapien'",
            "A simulated arm (robot=sapien_panda and the like)",
            'pip install "gvla2[sim]" (on Linux)',
        ) from error
    except (ImportError, OSError) as error:
        raise MissingDependencyError(
            f"a system library that SAPIEN loads ({error})",
            "A simulated arm (robot=sapien_panda and the like)",
            "apt-get install libx11-6 libgl1 (Debian, Ubuntu), with the package from "
            'pip install "gvla2[sim]"',
        ) from error
    return sapien

"""The two pluggy markers: ``hookspec`` declares an extension point, ``hookimpl`` fills it."""

import pluggy

PROJECT = "gvla2"
"""Entry-point group and pluggy project name."""

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)

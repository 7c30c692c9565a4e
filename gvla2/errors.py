"""Errors: one root, and messages that say what was asked, what exists and what to do."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from pathlib import Path


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The sentence " Did you mean 'x'?" for the nearest known word, or ""."""
    close = get_close_matches(word, list(known), n=1)
    return f" Did you mean '{close[0]}'?" if close else ""


class Gvla2Error(Exception):
    """Root of every error that gvla2 raises on purpose; the command line prints it without a traceback."""


class ConfigurationError(Gvla2Error):
    """The configuration asks for something impossible."""


_MOST_LISTED = 60
"""Maximum number of names in an error message."""


class UnknownComponentError(ConfigurationError):
    """No plugin offers a component of the requested name."""

    def __init__(self, kind: str, asked: str, available: Iterable[str], note: str = "") -> None:
        names = sorted(available)
        hint = did_you_mean(asked, names)
        listing = ", ".join(names[:_MOST_LISTED]) if names else "none at all"
        if len(names) > _MOST_LISTED:
            listing += f", ... ({len(names)} in all)"
        super().__init__(
            f"No {kind} named '{asked}'.{hint} Available: {listing}.{' ' + note if note else ''}"
        )
        self.asked = asked


class PluginError(Gvla2Error):
    """A plugin broke a rule of its hook: a wrong type, a missing name, an error of its own."""


class ConformanceError(Gvla2Error, AssertionError):
    """A component breaks the contract of its kind; the message says which sentence, and what was found instead."""


@contextmanager
def kept_alive() -> Iterator[None]:
    """Raise RuntimeError instead of what would end the process (a plugin's ``sys.exit``), except Ctrl-C and SIGTERM.

    These are raised also where they came within compiled code, which makes a SystemError of them.
    """
    try:
        yield
    except SystemError as error:
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise error.__cause__ from None
        raise
    except (Exception, KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        raise RuntimeError(f"{error!r} would have ended the process").with_traceback(
            error.__traceback__
        ) from None


class MissingDependencyError(Gvla2Error):
    """An optional package, system library or weight file is needed and absent."""

    def __init__(self, what: str, needed_for: str, install: str, licence: str = "") -> None:
        text = f"{needed_for} needs {what}, which is not installed. Install it with: {install}"
        super().__init__(f"{text} (licence: {licence})" if licence else text)


class GeometryError(Gvla2Error, ValueError):
    """Geometric data is malformed: a wrong shape, a mirrored camera, a singular K, not-a-number."""


def _is_pointer(path: Path) -> bool:
    """Whether a file is what Git LFS leaves where it has not fetched the file itself."""
    mark = b"version https://git-lfs.github.com/"
    with suppress(OSError):
        if path.is_file():
            with path.open("rb") as file:
                return file.read(len(mark)) == mark
    return False


@contextmanager
def reading(
    what: str, path: str | os.PathLike[str], kind: type[Gvla2Error] = GeometryError, remedy: str = ""
) -> Iterator[None]:
    """Turn anything that goes wrong while a file of others is read into ``kind``, which names the file and the reason.

    Readers of foreign formats raise anything at all for a damaged file. Errors of ours that name the file keep their
    words; what must be installed or configured stays as it is. A pipe or a device is refused: reading it may never end.
    """
    try:
        if (place := Path(path)).exists() and not (place.is_file() or place.is_dir()):
            raise OSError(None, "it is a pipe or a device, not a file")
        yield
    except (MissingDependencyError, ConfigurationError):
        raise
    except Exception as error:
        reason, where = str(error), os.fspath(path)
        own = isinstance(error, Gvla2Error)
        if isinstance(error, OSError) and error.strerror:
            other = error.filename is not None and os.fspath(error.filename) != where
            reason = f"{error.strerror}: {error.filename}" if other else error.strerror
        elif isinstance(error, KeyError):
            reason = f"it lacks {reason}"
        elif not own:
            reason = f"{type(error).__name__}: {reason}"
        if _is_pointer(Path(path)):
            reason = "it is a Git LFS pointer, not the file itself: fetch it with `git lfs pull`"
        if not own or Path(where).name not in reason:
            reason = f"Cannot read {what} from {where}: {reason}"
        raise kind(f"{reason.rstrip('.')}.{' ' + remedy if remedy else ''}") from error


class PerceptionError(Gvla2Error):
    """The observation cannot be perceived: no valid depth, no view, no supporting plane."""


class PlanningError(Gvla2Error):
    """A planner returned something that is not a plan."""


class PlannerTimeoutError(PlanningError):
    """A planner gave no answer in time."""


class RobotError(Gvla2Error):
    """A robot backend could not carry out what it was asked to do."""


class SimulationError(RobotError):
    """A simulated world has blown up: its results are meaningless, and the next reset starts a clean one."""


class MemoryStoreError(Gvla2Error):
    """The memory's database is locked, corrupt, of a newer schema or not writable."""


class OutputError(Gvla2Error):
    """A result could not be written."""

"""Running a sub-command as a Hydra job: composing, sweeping, and errors in plain words."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from gvla2.commands.config_errors import explain, unreadable_choice
from gvla2.commands.primary import CONFIG_MODULE, PRIMARY, VERSION_BASE
from gvla2.errors import Gvla2Error, OutputError
from gvla2.plugins.hydra_config import register, register_resolvers
from gvla2.plugins.kinds import KINDS, SLOTS
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.record.text import printable

JobFunction = Callable[[Any, Registry, Path], object]
"""Gets the typed configuration (an instance of the command's dataclass), the catalog and the job's folder."""

log = logging.getLogger(__name__)
RAY_ADDRESS = "hydra.launcher.ray.init.address="
SLURM = "hydra/launcher=submitit_slurm"


class HydraTask:
    """A job function as Hydra calls it. It travels to worker processes by the function's name.

    There it loads the plugins again, and an error travels back only as its message: exceptions with constructors of
    their own do not survive pickling.
    """

    def __init__(self, function: JobFunction, registry: Registry | None = None) -> None:
        self.function = function
        self.registry = registry

    def __getstate__(self) -> dict[str, object]:
        return {"function": self.function}

    def __setstate__(self, state: dict[str, JobFunction]) -> None:
        self.function, self.registry = state["function"], None
        register_resolvers()

    def __call__(self, config: DictConfig, folder: Path | None = None) -> object:
        """Run the job in Hydra's folder or a given one; on an error the run's log gets the traceback, the terminal one
        line.
        """
        if self.registry is None:
            self.registry = load_plugins()
        registry = self.registry
        try:
            where = Path(HydraConfig.get().runtime.output_dir) if folder is None else folder
            return self.function(OmegaConf.to_object(config), registry, where)
        except Exception as error:
            log.info("The job failed.", exc_info=True)
            if not HydraConfig.initialized() or HydraConfig.get().mode != RunMode.MULTIRUN:
                raise JobFailedError(error) from error
            message = explain(error, registry)
            print(f"gvla2: job {HydraConfig.get().job.num}: {printable(message)}", file=sys.stderr)
            raise Gvla2Error(message) from error


class JobFailedError(BaseException):
    """Carries a job's error past Hydra, which would print a report of its own for an Exception."""

    def __init__(self, error: Exception) -> None:
        super().__init__(str(error))
        self.error = error


class Terminated(KeyboardInterrupt):
    """SIGTERM, from a batch system, say: it unwinds like Ctrl-C, so that the run's folder is complete."""


def launch(
    config_name: str, function: JobFunction, argv: Sequence[str], errors: list[str] | None = None
) -> int:
    """Run ``function`` as the Hydra application ``gvla2 <config_name>`` with overrides and Hydra's own flags.

    Returns the exit status: 0; 1 after an error, printed on stderr without a traceback if it is a :class:`Gvla2Error`
    or a wrong override; 2 for wrong usage; 130 when interrupted; 143 after SIGTERM. Error messages are added to
    ``errors`` too. ``GVLA2_DEBUG=1`` or ``HYDRA_FULL_ERROR=1`` keep the traceback.
    """
    wrong = _sweep_shown(argv) or dashed_option(argv) or _several_chosen(argv)
    for advice, status in ((wrong, 2), (_absent_cluster(argv), 1)):
        if advice:
            print(f"gvla2: {printable(advice)}", file=sys.stderr)
            return status
    argv = flags_last(argv)
    # Presets of runs and benches name any group; the other commands have none, and should start fast.
    schema = PRIMARY[config_name]
    own = None if config_name in ("run", "bench") else {f.name for f in fields(schema)} & {*KINDS, *SLOTS}
    registry = load_plugins(own)
    register(registry, {config_name: schema}, own)
    task = HydraTask(function, registry)
    whole = hydra.main(
        config_path=f"pkg://{CONFIG_MODULE}", config_name=config_name, version_base=VERSION_BASE
    )
    # Hydra itself composes twice, first to learn whether this is a sweep: without flags it is none.
    if any(word.lstrip("+~").startswith(("-", "hydra.mode")) for word in argv):
        main = whole(task)
    elif config_name == "memory" and not any(word.lstrip("+~").startswith("hydra") for word in argv):
        main = partial(_look, task, config_name, argv)
    else:
        main = partial(_once, task, config_name, argv, whole(task))

    def tell(error: Exception, known: Registry | None = None) -> int:
        if errors is not None:
            errors.append(explain(error, known))
        return report(error, known)

    try:
        with _terminable(), _command_line(config_name, argv):
            main()
    except JobFailedError as failed:
        return tell(failed.error, registry)
    except SystemExit as leaving:  # --help, --cfg, and argparse's complaints
        return leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
    except KeyboardInterrupt as stopped:
        print("gvla2: interrupted.", file=sys.stderr)
        return 143 if isinstance(stopped, Terminated) else 130
    except HydraException as error:  # some of them are an OSError too
        return tell(error, registry)
    except BrokenPipeError:  # `gvla2 run --help | head`
        raise
    except ConnectionError as error:  # also OSError, from a launcher whose cluster does not answer
        return tell(Gvla2Error(f"The sweep could not be launched: {error}"), registry)
    except OSError as error:  # the job's own errors come as JobFailedError: this one concerns Hydra's folder
        where = f" '{error.filename}'" if error.filename else ""
        reason = f"Cannot write the output folder{where}: {error.strerror or error}."
        return tell(OutputError(f"{reason} Choose another with hydra.run.dir=FOLDER."), registry)
    except ValueError as error:
        return tell(unreadable_choice(error, argv, registry) or error, registry)
    except Exception as error:
        return tell(error, registry)
    return 0


def _look(job: HydraTask, config_name: str, argv: Sequence[str]) -> None:
    """Compose one configuration and run the job with it: a read-only command needs no Hydra folder."""
    with hydra.initialize_config_module(CONFIG_MODULE, version_base=VERSION_BASE):
        config = hydra.compose(config_name, list(argv))
    job(config, Path())


def _once(job: HydraTask, config_name: str, argv: Sequence[str], whole: Callable[[], object]) -> None:
    """Run one job in Hydra's folder; ``whole`` is called where a preset turns out to ask for a sweep."""
    with hydra.initialize_config_module(CONFIG_MODULE, config_name, version_base=VERSION_BASE):
        try:
            GlobalHydra.instance().hydra.run(config_name, job, list(argv))  # type: ignore[union-attr]
            return
        # Hydra's answer to any other mode than that of one job; jobs raise JobFailedError.
        except AssertionError:
            pass
    whole()


def _sweep_shown(argv: Sequence[str]) -> str:
    """The message when a sweep is asked to show its configuration; "" otherwise."""
    showing = {"-c", "--cfg", "-i", "--info"} & {word.partition("=")[0] for word in argv}
    if showing and {"-m", "--multirun"} & set(argv):
        return "--cfg and --info show one job: omit -m, and give each option one value."
    return ""


def _several_chosen(argv: Sequence[str]) -> str:
    """The message for ``task=[a,b]``, of which Hydra would mix the options; "" otherwise."""
    for word in argv:
        kind, _, value = word.partition("=")
        if kind in (*KINDS, *SLOTS) and value.startswith("[") and "," in value:
            return f"{kind} takes one name, not a list; a sweep takes several: -m {kind}={value.strip('[]')}"
    return ""


def flags_last(argv: Sequence[str]) -> list[str]:
    """The arguments with Hydra's flags behind the overrides: argparse refuses overrides on both sides of a flag.

    ``a=1 -m b=1,2`` becomes ``a=1 b=1,2 -m``. A flag keeps its value.
    """
    if "--" in argv:
        return list(argv)
    overrides, flags = list[str](), list[str]()
    words = iter(pairwise([*argv, ""]))
    for word, following in words:
        if not word.startswith("-"):
            overrides.append(word)
            continue
        flags.append(word)
        wanted = _values_of(word)  # that of --info may be missing
        if following and (wanted is None or (wanted == "?" and "=" not in following and following[0] != "-")):
            flags.append(following)
            next(words)
    return [*overrides, *flags]


def _values_of(flag: str) -> str | int | None:
    """As argparse's ``nargs``, of Hydra's flag, which may be abbreviated (``--conf``): None is one, 0 none."""
    for action in get_args_parser()._actions:
        spelt = flag in action.option_strings
        if spelt or (flag.startswith("--") and any(name.startswith(flag) for name in action.option_strings)):
            return action.nargs
    return 0


def dashed_option(argv: Sequence[str]) -> str:
    """The correction of the first ``--option value`` that is not a Hydra flag; "" when there is none."""
    flags = [flag for action in get_args_parser()._actions for flag in action.option_strings]
    for word, following in zip(argv, [*argv[1:], ""], strict=False):
        name, equals, value = word.removeprefix("--").partition("=")
        if not word.startswith("--") or not name or any(flag.startswith(f"--{name}") for flag in flags):
            continue
        if not equals:
            value = "true" if not following or following.startswith("-") or "=" in following else following
        asked = word if equals or value != following else f"{word} {value}"
        return f"options have no dashes: instead of `{asked}` write {name.replace('-', '_')}={value}"
    return ""


def report(error: Exception, registry: Registry | None = None) -> int:
    """Print an error on stderr: as a message if it was expected, with its traceback if not. Returns the exit status."""
    debug = any(os.environ.get(name, "0") not in ("", "0") for name in ("GVLA2_DEBUG", "HYDRA_FULL_ERROR"))
    if debug or not isinstance(error, Gvla2Error | HydraException | OmegaConfBaseException):
        traceback.print_exception(error)
    print(f"gvla2: {printable(explain(error, registry))}", file=sys.stderr)
    return 1


def _absent_cluster(argv: Sequence[str]) -> str:
    """The message when a Ray cluster does not answer at its address, or Slurm is not there; "" otherwise.

    Ray itself waits for minutes, and submitit ends in a traceback.
    """
    if SLURM in argv and shutil.which("srun") is None:
        return (
            f"{SLURM} needs Slurm's `srun`, which this machine has not: start it on a node of the cluster, or try the "
            "sweep with hydra/launcher=submitit_local."
        )
    given = next((word for word in reversed(argv) if word.startswith(RAY_ADDRESS)), "")
    host, _, port = given.removeprefix(RAY_ADDRESS).rpartition(":")
    if not host or not port.isdigit():  # "auto", "ray://...", nothing
        return ""
    try:
        socket.create_connection((host, int(port)), timeout=5).close()
    except (OSError, OverflowError) as error:
        cause = getattr(error, "strerror", None) or error
        return (
            f"No Ray cluster answers at {host}:{port} ({cause}). "
            "`ray start --head` starts one there and prints its address; `ray status` tells whether it runs."
        )
    return ""


@contextmanager
def _terminable() -> Iterator[None]:
    """SIGTERM raises :class:`Terminated` for a while; outside the main thread this does nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(_signal: int, _frame: object) -> None:
        raise Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _command_line(config_name: str, argv: Sequence[str]) -> Iterator[None]:
    """Set sys.argv for Hydra, and make it raise full errors, for the duration of the block."""
    arguments, full_error = sys.argv, os.environ.get("HYDRA_FULL_ERROR")
    sys.argv = [f"gvla2 {config_name}", *argv]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        yield
    finally:
        sys.argv = arguments
        if full_error is None:
            del os.environ["HYDRA_FULL_ERROR"]
        else:
            os.environ["HYDRA_FULL_ERROR"] = full_error

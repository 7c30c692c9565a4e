"""Running a sub-command as a Hydra job: composing, sweeping, and errors in one line."""

from __future__ import annotations

import logging
import os
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from numbers import Real
from pathlib import Path
from typing import Any

import hydra
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException
from yaml import YAMLError

from gvla2.errors import ConfigurationError, Gvla2Error, UnknownComponentError, did_you_mean, kept_alive
from gvla2.io.secrets import refuse_secrets
from gvla2.plugins.discovery import describe
from gvla2.plugins.hydra_config import EveryKind, register, register_resolvers
from gvla2.plugins.kinds import KINDS, SLOTS
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.record.text import printable

CONFIG_MODULE = "gvla2.conf"
VERSION_BASE = "1.3"

JobFunction = Callable[[Any, Registry, Path], object]
"""Gets the typed configuration (an instance of the command's dataclass), the catalog and the job's folder."""

log = logging.getLogger(__name__)
_MAY_SWEEP = ("+", "experiment=", "hydra.mode=")


def schemas() -> dict[str, type]:
    """The dataclass of each command that Hydra configures, by the command's name."""
    from gvla2.commands.reconstruct import ReconstructConfig
    from gvla2.commands.report import ReportConfig
    from gvla2.commands.run import RunConfig
    from gvla2.evaluation.config import BenchConfig

    return {
        "run": RunConfig,
        "reconstruct": ReconstructConfig,
        "bench": BenchConfig,
        "report": ReportConfig,
    }


def suite_schemas() -> dict[str, type]:
    """The dataclasses of the bench's suites, by their place in Hydra's store."""
    from gvla2.evaluation.config import SUITES

    return {f"bench_suite_schema/{name}": schema for name, schema in SUITES.items()}


class HydraTask:
    """A job function as Hydra calls it. It is pickled to worker processes by the function's name.

    There it loads the plugins again, and an error travels back as its message only: exceptions with constructors of
    their own do not survive pickling.
    """

    def __init__(self, function: JobFunction, registry: Registry | None = None) -> None:
        self.function = function
        self.registry = registry
        self.error: Exception | None = None
        """The error of a single job: raised again after Hydra, which would print a line of its own about it."""

    def __getstate__(self) -> dict[str, object]:
        return {"function": self.function, "registry": None, "error": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        register_resolvers()

    def __call__(self, config: DictConfig) -> object:
        """Run the job in Hydra's folder; the run's log gets the traceback of an error."""
        if self.registry is None:  # in a worker process of a launcher
            from gvla2.evaluation.engine import end_with_parent

            end_with_parent()
            self.registry = load_plugins()
        job = HydraConfig.get()
        try:
            with kept_alive():
                return self.function(typed(config), self.registry, Path(job.runtime.output_dir))
        except Exception as error:
            log.info("The job failed.", exc_info=True)
            if job.mode != RunMode.MULTIRUN:
                self.error = error
                return None
            message = explain(error, self.registry)
            print(f"gvla2: job {job.job.num}: {printable(message)}", file=sys.stderr)
            raise Gvla2Error(message) from error


class Terminated(KeyboardInterrupt):
    """SIGTERM, from a batch system, say: it unwinds like Ctrl-C, so that the run's folder is complete."""


def launch(command: str, configs: Mapping[str, type], function: JobFunction, argv: Sequence[str]) -> int:
    """Run ``function`` as the Hydra application ``gvla2 <command>`` with overrides and Hydra's own flags.

    ``configs`` has the command's dataclass by its name, and those of its groups. Returns the exit status: 0; 1 after an
    error; 2 for wrong usage; 130 when interrupted; 143 after SIGTERM.
    """
    names = {each.name for each in fields(configs[command])}
    argv = [at_home(word) for word in argv]
    for word, after in zip(argv, (*argv[1:], "VALUE"), strict=False):
        kind, _, value = word.partition("=")
        flag = kind.removeprefix("--")
        if flag != kind and flag != "instruction" and flag.partition(".")[0] in {*names, *KINDS, *SLOTS}:
            print(f"gvla2: an option has no dashes: {flag}={value or after}", file=sys.stderr)
            return 2
        # Hydra would merge the options of several components into one
        if kind in (*KINDS, *SLOTS) and value.startswith("[") and "," in value:
            print(f"gvla2: {kind} takes one name; a sweep: -m {kind}={value.strip('[]')}", file=sys.stderr)
            return 2
    registry = _register(configs, configs[command])
    task = HydraTask(function, registry)
    try:
        argv = named_policy(argv)
        if "instruction" in names:
            argv = quoted_instruction(argv)
        argv = sorted(argv, key=_is_override)  # argparse refuses overrides on both sides of a flag
        for word in argv:  # Hydra writes them into files before a job begins
            option, _, value = word.lstrip("+~").partition("=")
            refuse_secrets(option, value)
        with _terminable(), _command_line(f"gvla2 {command}", argv):
            # Only flags and presets ask for a sweep, to learn which Hydra composes a configuration more.
            if any(not _is_override(word) or word.startswith(_MAY_SWEEP) for word in argv):
                path = f"pkg://{CONFIG_MODULE}"
                hydra.main(config_path=path, config_name=command, version_base=VERSION_BASE)(task)()
            else:
                _run_once(command, task, argv)
        if task.error is not None:
            raise task.error
    except SystemExit as leaving:  # --help, --cfg, and argparse's complaints
        return leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
    except KeyboardInterrupt as stopped:
        print("gvla2: interrupted.", file=sys.stderr)
        return 143 if isinstance(stopped, Terminated) else 130
    except BrokenPipeError:  # `gvla2 run --help | head`
        raise
    except Exception as error:
        return report(error, registry)
    return 0


def composed(
    command: str, overrides: Sequence[str] = (), registry: Registry | None = None
) -> tuple[Any, Registry]:
    """A command's typed configuration, without Hydra's folders and logs, and the plugins."""
    schema = schemas()[command]
    registry = _register({command: schema}, schema, registry)
    with hydra.initialize_config_module(CONFIG_MODULE, version_base=VERSION_BASE):
        return typed(hydra.compose(command, quoted_instruction(named_policy(overrides)))), registry


def typed(config: DictConfig) -> Any:
    """The configuration as its dataclass.

    Raises :class:`ConfigurationError` for options that no component has: Hydra lets ``+name=`` and ``++name=`` add any;
    and for a password or an access key in one.
    """
    refuse_secrets("", OmegaConf.to_container(config, resolve=True, enum_to_str=True))
    made = OmegaConf.to_object(config)
    there = list(_options(made))
    for path in _unknown(made):
        own = path.rpartition(".")[2]
        same = [other for other in there if other.rpartition(".")[2] == own]
        hint = f" Did you mean '{same[0]}'?" if same else did_you_mean(path, there)
        raise ConfigurationError(f"There is no option '{path}'.{hint} --help lists what there is.")
    return made


def _options(made: Any, path: str = "") -> Iterator[str]:
    """The dotted names of all options of a dataclass and of those within it."""
    for each in fields(made):
        name, value = f"{path}{each.name}", getattr(made, each.name)
        if is_dataclass(value):
            yield from _options(value, f"{name}.")
        else:
            yield name


def _unknown(made: Any, path: str = "") -> Iterator[str]:
    """The dotted names of what the dataclass, or one within it, holds beside its fields."""
    known = {each.name for each in fields(made)}
    for name, value in vars(made).items():
        if name not in known:
            yield f"{path}{name}"
        elif is_dataclass(value):
            yield from _unknown(value, f"{path}{name}.")


def _register(configs: Mapping[str, type], schema: type, registry: Registry | None = None) -> Registry:
    """Load the plugins that a command may choose from, and offer them to Hydra."""
    # Presets of runs and benches name any group; the other commands have none, and should start fast.
    everything = issubclass(schema, EveryKind) or "bench" in configs
    groups = None if everything else {field.name for field in fields(schema)} & {*KINDS, *SLOTS}
    registry = registry or load_plugins(groups)
    register(registry, configs, groups)
    return registry


def _run_once(command: str, task: HydraTask, argv: Sequence[str]) -> None:
    """Run one job, which composes its configuration once."""
    with hydra.initialize_config_module(CONFIG_MODULE, command, version_base=VERSION_BASE):
        application = GlobalHydra.instance().hydra
        assert application is not None
        application.run(command, task, list(argv))


def at_home(word: str) -> str:
    """The argument with a value that begins with ``~/``, which shells leave as it is, at the user's home."""
    option, is_, value = word.partition("=")
    return f"{option}={Path(value).expanduser()}" if is_ and value.startswith("~/") else word


def named_policy(argv: Sequence[str]) -> list[str]:
    """The arguments with ``policy=PATH``, of a checkpoint, as the policy that reads it and its option."""
    made: list[str] = []
    for word in argv:
        option, _, path = word.partition("=")
        is_path = option == "policy" and "," not in path and (os.sep in path or Path(path).is_dir())
        made += ["policy=lerobot", f"policy.path={_text(path)}"] if is_path else [word]
    return made


def quoted_instruction(argv: Sequence[str]) -> list[str]:
    """The arguments with ``-i TEXT``, ``--instruction TEXT`` and, outside of sweeps, ``instruction=TEXT`` quoted.

    Hydra's grammar would otherwise take a sentence's commas, apostrophes and brackets for its own. Raises
    :class:`ConfigurationError` for an ``-i`` without a text.
    """
    sweeps = any(word in ("-m", "--multirun") or word.startswith(_MAY_SWEEP) for word in argv)
    words, made = iter(argv), []
    for word in words:
        option, _, text = word.partition("=")
        plain = not sweeps and text not in ("", "null") and text[0] not in "'\""
        if word in ("-i", "--instruction"):
            if not (sentence := next(words, "")):
                raise ConfigurationError(f"{word} needs a sentence: {word} 'lift the red cube, please'.")
            made.append(f"instruction={_text(sentence)}")
        elif option == "--instruction" or (option == "instruction" and plain):
            made.append(f"instruction={_text(text)}")
        else:
            made.append(word)
    return made


def as_overrides(options: Mapping[str, Any]) -> list[str]:
    """Hydra's overrides that set options, by their dotted names, to Python values; a component of None is ``none``."""
    groups = (*KINDS, *SLOTS)
    return [
        f"{name}={'none' if value is None and name in groups else _written(value)}"
        for name, value in options.items()
    ]


def _written(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{key}:{_written(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(_written, value)) + "]"
    if value is None or isinstance(value, bool):  # before numbers, which they equal
        return "null" if value is None else str(value).lower()
    return str(value) if isinstance(value, Real) else _text(str(value))


def _text(text: str) -> str:
    """A text in Hydra's quotes; both Hydra and OmegaConf read a backslash before what it escapes."""
    escaped = re.sub(r"(\\*)('|\$\{)", r"\1\1\\\2", text)
    whole = re.sub(r"(\\+)$", r"\1\1", escaped)
    return f"'{whole}'"


def _is_override(word: str) -> bool:
    return ("=" in word and not word.startswith("-")) or word.startswith("~")


def explain(error: BaseException, registry: Registry | None = None) -> str:
    """One message for a person: Hydra's or OmegaConf's, with the nearest name; ``registry`` names broken plugins."""
    if isinstance(error, Gvla2Error):
        return str(error)
    if isinstance(error, UnicodeDecodeError):
        around = error.object[max(error.start - 30, 0) : error.end + 30]
        return f"A file is not UTF-8 near {around!r}: save it as UTF-8."
    if isinstance(error, MissingConfigException) and "/" in (error.missing_cfg_file or ""):
        group, _, name = str(error.missing_cfg_file).rpartition("/")
        options, note = error.options or (), ""
        if registry is not None and group in registry.groups:  # of a list of choices Hydra gives none
            options, note = list(registry.components(group)), registry.broken_note(group)
        if group == "policy":
            note = f"There is no folder of a checkpoint of that name either. {note}".strip()
        return str(UnknownComponentError(group, name.removesuffix(".yaml"), options, note))
    if isinstance(error, OverrideParseException):
        why = " ".join(str(error).partition("See https:")[0].split())
        return f"{why}. Options are KEY=VALUE, such as task=push_block, and a sentence needs quotes: -i 'lift the cup'."
    if not isinstance(error, HydraException | OmegaConfBaseException):
        return ". ".join([describe(error).rstrip("."), *getattr(error, "__notes__", ())])
    cause = error.__cause__ if isinstance(error.__cause__, OmegaConfBaseException) else error
    if not isinstance(cause, OmegaConfBaseException):
        said, appended, preset = " ".join(str(error).split()).partition(
            "To append to your default list use +"
        )
        if appended and not preset.startswith("experiment="):  # which would not help
            return f"{said}This command has no such choice; --help lists what there is (of a bench: tasks=[NAME])."
        return said + appended + preset
    lines = [str(each).splitlines()[0].rstrip(".") for each in dict.fromkeys((error, cause))]
    known = cause.parent_node if isinstance(cause, ConfigKeyError | ConfigAttributeError) else None
    hint = did_you_mean(str(cause.key), map(str, known)) if isinstance(known, DictConfig) else ""
    if "is not a ListConfig" in str(cause) and (given := re.search(r"override (\S+)=(.*)", lines[0])):
        return f"{given[1]} is a list: {given[1]}=[{given[2]}]."
    return f"{'. '.join(lines)}.{hint}"


def report(error: Exception, registry: Registry | None = None) -> int:
    """Print an error on stderr, with its traceback if it is unexpected or ``GVLA2_DEBUG=1``; the exit status 1."""
    foreign = (HydraException, OmegaConfBaseException, OSError, YAMLError, UnicodeDecodeError, BrokenExecutor)
    expected = isinstance(error, (Gvla2Error, *foreign))
    if not expected or os.environ.get("GVLA2_DEBUG", "0") not in ("", "0"):
        print(printable("".join(traceback.format_exception(error))), file=sys.stderr)
    print(f"gvla2: {printable(explain(error, registry))}", file=sys.stderr)
    return 1


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
def _command_line(name: str, argv: Sequence[str]) -> Iterator[None]:
    """Set sys.argv for Hydra, and make it raise errors instead of printing them, for the duration of the block."""
    arguments, full_error = sys.argv, os.environ.get("HYDRA_FULL_ERROR")
    sys.argv = [name, *argv]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        yield
    finally:
        sys.argv = arguments
        if full_error is None:
            del os.environ["HYDRA_FULL_ERROR"]
        else:
            os.environ["HYDRA_FULL_ERROR"] = full_error

"""STAR's own commands, as a plugin: ``run``, ``check``, ``missions``, ``plugins`` and so on."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

from star_core.hookspecs import hookimpl
from star_core.plugin_support.specs import CommandSpec

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from star_core.registry import Registry


@hookimpl
def star_commands(registry: Registry) -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="run",
        summary="Fly a mission (= star-run).",
        configure=partial(_configure_run, registry),
        run=_run,
        group="Fly",
    )
    yield CommandSpec(
        name="stop",
        summary="Land all agents of the running flights.",
        configure=_configure_stop,
        run=_stop,
        group="Fly",
    )
    yield CommandSpec(
        name="check",
        summary="Check a mission, or steps, a world, a camera or faults.",
        configure=_configure_check,
        run=_check,
        group="Author",
    )
    yield CommandSpec(
        name="missions",
        summary="List the missions that come with STAR.",
        configure=lambda _line: None,
        run=_missions,
        group="Author",
    )
    yield CommandSpec(
        name="errors",
        summary="Explain the code of an error.",
        configure=_configure_errors,
        run=_errors,
        group="Author",
    )
    yield CommandSpec(
        name="schema",
        summary="Write a schema for an editor.",
        configure=_configure_schema,
        run=_schema,
        group="Author",
    )
    yield CommandSpec(
        name="plugins",
        summary="List plugins, or describe one.",
        configure=_configure_plugins,
        run=_plugins,
        group="Plugins",
    )


def _configure_run(registry: Registry, line: ArgumentParser) -> None:
    _add_mission(line)
    line.add_argument("--out", metavar="DIR", help="record into DIR (runs/TIME-MISSION)")
    line.add_argument("--no-record", action="store_true", help="leave nothing behind")
    line.add_argument("--save-frames", action="store_true", help="keep the cameras' images too")
    line.add_argument("--json", action="store_true", help="print the summary as JSON, only")
    line.add_argument("--verbose", action="store_true", help="show the tracebacks of plugins")
    for name, spec in registry.offers()["run_option"].items():
        flag, what = f"--{name}", spec.summary
        if spec.metavar is None:
            line.add_argument(flag, dest=flag, action="store_const", const=(), help=what)
        else:
            line.add_argument(flag, dest=flag, nargs=1, metavar=spec.metavar, help=what)


def _add_mission(line: ArgumentParser, others: str = "") -> None:
    from star_core.commands.output import add_set_option

    what = f"mission file (YAML), or a name of `star missions`{others}"
    line.add_argument("mission", help=what)
    add_set_option(line)
    line.add_argument("--seed", help="seed of every random number")
    line.add_argument(
        "--speed", help="times real time, in simulation: 1; as fast as it can if not given"
    )


def _run(options: Namespace, registry: Registry) -> int:
    from contextlib import nullcontext, redirect_stdout, suppress

    from star_core.toolkit.progress import Progress

    with Progress("loading plugins"):
        from star_core.commands.run import log_to_stderr, run_mission
        from star_core.operator import Operator

        answer, operator = sys.stdout, Operator()
    log_to_stderr(verbose=options.verbose)
    # What plugins print must not be in the JSON.
    with redirect_stdout(sys.stderr) if options.json else nullcontext():
        status, text = run_mission(
            options.mission,
            _assignments(options),
            registry,
            out=options.out,
            keep=not options.no_record,
            save_frames=options.save_frames,
            observers={
                key.removeprefix("--"): values
                for key, values in vars(options).items()
                if key.startswith("--") and values is not None
            },
            as_json=options.json,
            operator=operator,
        )
        print(text, file=answer, flush=True)
        with suppress(KeyboardInterrupt):
            operator.await_landings()
    return status


def _configure_stop(line: ArgumentParser) -> None:
    line.description = (
        "Land all agents of every running flight of this user on this computer, simulated flights "
        "too. The motors are not stopped."
    )
    line.add_argument(
        "name", nargs="?", help="mission, or number of a process: land only its agents"
    )
    line.add_argument("--list", action="store_true", help="list the flights; none lands")


def _stop(options: Namespace, _registry: Registry) -> int:
    from star_core.commands.stop_flights import stop_flights

    status, lines = stop_flights(options.name, list_only=options.list)
    print(*lines, sep="\n", file=sys.stderr if status else sys.stdout)
    return status


def _configure_check(line: ArgumentParser) -> None:
    _add_mission(line, "; or steps, a world, a camera, faults")


def _check(options: Namespace, registry: Registry) -> int:
    from pathlib import Path

    from star_core.commands.check import check_file
    from star_core.toolkit.progress import Progress, log

    with Progress(f"checking {options.mission}"):
        text, warnings = check_file(Path(options.mission), _assignments(options), registry)
    for warning in warnings:
        log(warning)
    print(text)
    return 0


def _configure_errors(line: ArgumentParser) -> None:
    line.add_argument("code", nargs="?", help="the code in brackets; all codes if not given")


def _errors(options: Namespace, _registry: Registry) -> int:
    from star_core.commands import error_codes

    print(error_codes.explain(options.code) if options.code else error_codes.page())
    return 0


def _missions(_options: Namespace, _registry: Registry) -> int:
    from star_core.commands.list_missions import as_text

    print(as_text())
    return 0


def _configure_plugins(line: ArgumentParser) -> None:
    line.add_argument(
        "name", nargs="?", help="plugin, distribution or kind to describe; all if not given"
    )
    line.add_argument("--json", action="store_true", help="as JSON, with option schemas")


def _plugins(options: Namespace, registry: Registry) -> int:
    from star_core.commands.list_plugins import as_json, as_text, chosen

    found = chosen(registry, options.name)
    if options.json:
        print(as_json(found, registry.broken))
    elif options.name is None:
        print(as_text(found, registry.broken))
    else:
        from star_core.commands.describe_plugin import describe

        print("\n\n".join(describe(kind, one) for kind, one in found))
    return 0


def _configure_schema(line: ArgumentParser) -> None:
    line.add_argument(
        "of",
        nargs="?",
        default="mission",
        choices=["mission", "steps", "world", "camera", "study", "faults"],
        help="kind of file: %(default)s",
    )
    line.add_argument("--out", metavar="FILE", help="write to FILE instead of printing")


def _schema(options: Namespace, registry: Registry) -> int:
    import json
    from pathlib import Path

    from star_core.commands.output import writing
    from star_core.mission_file import schema
    from star_core.mission_file.editor_schema import for_editors

    if options.of == "mission":
        content = for_editors(schema.compose(registry.offers()))
    elif options.of == "steps":
        content = for_editors(schema.compose_steps(registry.offers()), parameters=True)
    else:
        content = for_editors(schema.load(options.of))
    text = json.dumps(content, indent=2)
    if options.out:
        with writing(options.out):
            Path(options.out).write_text(text + "\n", encoding="utf-8")
    else:
        print(text)
    return 0


def _assignments(options: Namespace) -> list[str]:
    assignments = list(options.set)
    if options.seed is not None:
        assignments.append(f"seed={options.seed}")
    if options.speed is not None:
        assignments.append(f"transport.speed={options.speed}")
    return assignments

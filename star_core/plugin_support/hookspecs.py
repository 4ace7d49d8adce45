"""The hooks: some offer plugins, some are called by commands, others observe flights.

Offering hooks are called before the mission is read: import what is heavy inside ``make``. Their
`registry` has the records of the kinds that plugins add already, and may be kept.
Observing hooks are called in the tick: return in well under a period. An observer that raises is
named in the log and dropped for the rest of the flight.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from pathlib import Path

    from star_core import Mission, Registry, Run
    from star_core.errors import Problem
    from star_core.messages.events import Event, Flight, Tick
    from star_core.operator import Operator
    from star_core.plugin_support.specs import (
        AvoiderSpec,
        CommandSpec,
        FileKindSpec,
        FormatSpec,
        KindSpec,
        LocalizerSpec,
        MonitorSpec,
        PlannerSpec,
        RunOptionSpec,
        TaskSpec,
        TransportSpec,
    )
    from star_core.toolkit import Rehearsal, StudyResults, WrittenReport

PROJECT = "star"

OBSERVING = (
    *("star_mission_started", "star_ticked", "star_phase_changed", "star_event"),
    *("star_summary", "star_mission_ended"),
)
"""Hooks that are called during a flight."""

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def star_kinds() -> Iterable[KindSpec]:  # type: ignore[empty-body]
    """Add kinds of plugins that this plugin uses; each has a hook ``star_NAMEs(registry)`` then.

    Example:
        >>> from star_core import hookimpl
        >>> from star_core.toolkit import KindSpec, Spec
        >>> @hookimpl
        ... def star_kinds():
        ...     yield KindSpec(name="gripper", record=Spec)  # by star_grippers(registry)
    """


@hookspec
def star_transports(registry: Registry) -> Iterable[TransportSpec]:  # type: ignore[empty-body]
    """Offer transports: links to a swarm, real or simulated.

    Example:
        >>> from star_core import TransportSpec, hookimpl
        >>> @hookimpl
        ... def star_transports():
        ...     yield TransportSpec(name="mine", summary="My own link.", make=object)
    """


@hookspec
def star_localizers(registry: Registry) -> Iterable[LocalizerSpec]:  # type: ignore[empty-body]
    """Offer localizers: from telemetry to estimates."""


@hookspec
def star_planners(registry: Registry) -> Iterable[PlannerSpec]:  # type: ignore[empty-body]
    """Offer planners: from goals to setpoints and paths, for each agent as if alone."""


@hookspec
def star_avoiders(registry: Registry) -> Iterable[AvoiderSpec]:  # type: ignore[empty-body]
    """Offer avoiders: from planned setpoints to ones that keep the agents apart."""


@hookspec
def star_tasks(registry: Registry) -> Iterable[TaskSpec]:  # type: ignore[empty-body]
    """Offer tasks: verbs of the mission language, each under its own name."""


@hookspec
def star_monitors(registry: Registry) -> Iterable[MonitorSpec]:  # type: ignore[empty-body]
    """Offer monitors: safety checks after the stages of each tick, in every flight.

    Example:
        >>> from star_core import hookimpl
        >>> from star_core.toolkit import MonitorSpec, Report, Stage
        >>> class Ceiling:
        ...     after = Stage.LOCATED
        ...     def __init__(self, scene):
        ...         self._names = scene.names
        ...     def check(self, state):
        ...         for row in (state.estimate.position[:, 2] > 2.0).nonzero()[0]:
        ...             yield Report("safety", "it flies above 2 m", self._names[row])
        >>> @hookimpl
        ... def star_monitors():
        ...     yield MonitorSpec(name="ceiling", summary="Reports high agents.", make=Ceiling)
    """


@hookspec
def star_commands(registry: Registry) -> Iterable[CommandSpec]:  # type: ignore[empty-body]
    """Offer ``star`` commands; those of STAR itself are offered by this hook too."""


@hookspec
def star_run_options(registry: Registry) -> Iterable[RunOptionSpec]:  # type: ignore[empty-body]
    """Offer switches of ``star run``, each of which adds an observer to the flight."""


@hookspec
def star_formats(registry: Registry) -> Iterable[FormatSpec]:  # type: ignore[empty-body]
    """Offer formats of missions: from a file to a checked `Mission`.

    Example:
        >>> from star_core import hookimpl
        >>> from star_core.formats import FormatSpec
        >>> def load(path, registry, assignments):
        ...     raise NotImplementedError  # return a Mission
        >>> @hookimpl
        ... def star_formats():
        ...     yield FormatSpec(
        ...         name="toml",
        ...         summary="Missions in TOML.",
        ...         recognizes=lambda path: path.suffix == ".toml",
        ...         load=load,
        ...         check=lambda *file: (f"{load(*file).name!r} can be flown", ()),
        ...     )
    """


@hookspec
def star_file_kinds(registry: Registry) -> Iterable[FileKindSpec]:  # type: ignore[empty-body]
    """Offer kinds of files, for ``star check`` and ``star schema``.

    Example:
        >>> from star_core import hookimpl
        >>> from star_core.formats import FileKindSpec
        >>> @hookimpl
        ... def star_file_kinds():
        ...     yield FileKindSpec(
        ...         name="gripper",
        ...         summary="A gripper: its fingers.",
        ...         noun="a gripper",
        ...         keys=("fingers",),
        ...         schema=lambda registry: {"properties": {"fingers": {"type": "integer"}}},
        ...         check=lambda file, registry: f"a gripper of {file.data['fingers']} fingers",
        ...     )
    """


@hookspec(firstresult=True)
def star_rehearse(mission: Mission, registry: Registry) -> Rehearsal | None:
    """Return a rehearsal of a mission: when its steps begin and end, and where its agents are.

    Call it as ``registry.manager.hook.star_rehearse(mission=mission, registry=registry)``; None if
    no plugin rehearses missions. It takes a fraction of a second for each minute of the mission.

    Example:
        >>> from star_core import Registry, load
        >>> registry = Registry()
        >>> mission = load("missions/first_flight.yaml", registry)
        >>> rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
        >>> [step.action.verb for step in rehearsal.steps][:2], rehearsal.position.shape[1:]
        (['takeoff', 'goto'], (3, 3))
    """


@hookspec
def star_check(mission: Mission, registry: Registry) -> Iterable[Problem]:  # type: ignore[empty-body]
    """Check a mission in which ``star check`` has found no other problem.

    Unlike the `check` of a plugin, it may import what is heavy. The paths of its problems begin at
    the top of the mission.
    """


@hookspec(firstresult=True)
def star_report(folder: Path, registry: Registry) -> WrittenReport | None:
    """Write the report of a recorded flight or a study; None leaves that to another plugin.

    What is returned names its page and has the tables of a study, which `star ablate` prints.

    It may raise `InputError`: the folder holds no record, or a package is not installed.
    """


@hookspec(firstresult=True)
def star_read_run(folder: Path, registry: Registry) -> Run | None:
    """Return the flight that is recorded in a folder; None to leave it to another plugin.

    `star_core.read_run` calls it. It may raise `InputError`: the folder holds no complete record.
    """


@hookspec(firstresult=True)
def star_fly_study(
    study: Path, folder: Path, workers: int | None, registry: Registry
) -> StudyResults | None:
    """Fly the flights of a study file that are missing in a folder, and return the results of all.

    `workers` is the number of flights at a time; None is for all cores. It may raise `InputError`:
    a mission cannot be flown at some level, or the folder cannot be written.
    """


@hookspec
def star_measures() -> Iterable[str]:  # type: ignore[empty-body]
    """Offer what `star_summary` measures: paths in the summary, keys joined by dots.

    A path that ends with ``.*`` stands for all paths below. Studies refuse a misspelt measure
    before the first flight, if each plugin that observes flights offers its measures.

    Example:
        >>> from star_core import hookimpl
        >>> @hookimpl
        ... def star_measures():
        ...     yield "heights_m.mean"
        ...     yield "heights_m.per_agent.*"
    """


@hookspec
def star_mission_started(flight: Flight, operator: Operator) -> object | None:
    """Observe the start: the links are open and nothing has moved yet.

    An observer for the operator keeps `operator`, to land the agents when it is asked to. An object
    that is returned observes this flight in the plugin's place, so that flights share no state.

    Example:
        >>> from star_core import hookimpl
        >>> class Ticks:
        ...     count = 0
        ...     @hookimpl
        ...     def star_ticked(self):
        ...         self.count += 1
        ...     @hookimpl
        ...     def star_summary(self):
        ...         return {"ticks": self.count}
        >>> @hookimpl
        ... def star_mission_started():
        ...     return Ticks()
    """


@hookspec
def star_ticked(tick: Tick) -> None:
    """Observe the end of each tick."""


@hookspec
def star_phase_changed(time: float, agent: str | None, phase: str) -> None:
    """Observe a change of phase of an agent or, if `agent` is None, of the mission."""


@hookspec
def star_event(event: Event) -> None:
    """Observe an event of the record."""


@hookspec
def star_summary() -> Mapping[str, Any]:  # type: ignore[empty-body]
    """Return what was measured, as JSON, by keys that the summary does not have yet.

    It is called at the end of a flight. The plugin is named in the log if a key is taken.
    """


@hookspec
def star_mission_ended(summary: Mapping[str, Any]) -> None:
    """Observe the end, however it came: the links are closed; ``reason`` names agents in the air.

    The summary is that of ``summary.json``.
    """

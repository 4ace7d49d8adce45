"""The records that announce plugins, and what their checks yield.

This module imports no numpy, so that plugins can be listed and missions checked quickly.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from star_core.errors import Problem, SourceFile

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace

    from star_core import Agent, Mission, Registry, Scene, World
    from star_core.contracts import Avoider, Localizer, Planner, Task, Transport
    from star_core.messages.arrays import Array, Mask
    from star_core.toolkit import Monitor


class StepGoal(NamedTuple):
    """A position that a step sends an agent to, as far as it is known before the flight.

    Attributes:
        path: Keys and indices from the task's options to the value that it follows from.
        position: In the map, m.
        label: What it is, for messages, as ``"position 2 of 3"``; empty if there is only one.
    """

    path: tuple[str | int, ...]
    position: tuple[float, float, float]
    label: str = ""


def deferred(target: str) -> Callable[..., Any]:
    """Return a function that imports another when it is called, and calls that.

    As `Spec.make` it announces a plugin without the imports that the plugin itself needs.

    Args:
        target: ``module:name``, as for entry points.

    Example:
        >>> deferred("math:hypot")(3, 4)
        5.0
    """
    module, _, name = target.partition(":")

    def call(*arguments: Any, **options: Any) -> Any:
        return getattr(import_module(module), name)(*arguments, **options)

    return call


NO_OPTIONS: Mapping[str, Any] = {"type": "object", "properties": {}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """A record that announces a plugin.

    Attributes:
        name: In missions, or on the command line. Lower case, unique within its kind.
        summary: One line, for ``star plugins``, ``star --help`` and editors.
    """

    name: str
    summary: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSpec(Spec):
    """Announces a plugin that a mission names, with options.

    What a plugin is able to do has the cautious default: a spec that omits it makes ``star check``
    report more, never less.

    Attributes:
        make: ``make(scene, **options)`` returns the plugin. Import heavy packages in it; `deferred`
            does.
        options: JSON Schema of those options: an object with ``properties``. Other options are
            refused. Those that are not given have the ``default`` of the schema.
        check: ``check(scene, **options)`` yields a `Problem` for each mistake that a schema cannot
            detect. It runs in ``star check``: import nothing heavy.
    """

    make: Callable[..., Any]
    options: Mapping[str, Any] = field(default_factory=lambda: NO_OPTIONS)
    check: Callable[..., Iterable[Problem]] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TransportSpec(MissionSpec):
    """Announces a transport.

    Attributes:
        realtime: Whether mission time advances by itself, as on hardware; a simulation whose time
            advances in ``wait`` only is not. Plugins read it in `Scene.realtime`.
        heights_above_surface: ``heights_above_surface(**options)`` returns whether the on-board
            estimators take what is below for the floor, as they do with a Flow deck; None if they
            always do. Localizers read it in `Scene.heights_above_surface`.
        flow_deck: ``flow_deck(**options)`` returns whether the drones carry Flow decks; None if
            they always do. Localizers and monitors read it in `Scene.flow_deck`.
        exact_odometry: ``exact_odometry(**options)`` returns whether odometry has no error, as in a
            simulation without noise; None if it never is exact. Localizers read it in
            `Scene.exact_odometry`.
        exact_control: ``exact_control(**options)`` returns whether drones fly setpoints exactly, as
            in a simulation without their dynamics; None if they never do. Rehearsals read it.
        detects_tags: ``detects_tags(**options)`` returns whether cameras send the corners of the
            tags that they detect, `Detections`, instead of images; None if they send images.
            Localizers read it in `Scene.detects_tags`.
        measures_positions: ``measures_positions(**options)`` returns whether a positioning system
            measures positions, for `Telemetry.fixes`; None if none does. Localizers read it in
            `Scene.measures_positions`.
        measurement_errors: ``measurement_errors(**options)`` returns the standard deviation of
            these positions along each axis, m, and the longest time without one of an agent, s;
            None if they are not known. Localizers read it in `Scene.measurement_errors`.
        onboard_system: ``onboard_system(**options)`` returns the positioning system by which the
            on-board estimators know the map, ``lighthouse``, ``loco`` or ``poses``, so that
            reports are in the map frame; None, like its result, if they start at the origin of
            their odometry. Localizers read it in `Scene.onboard_system`.
        hover_voltage: ``hover_voltage(flown, **options)`` returns the battery voltages, (N,) V, of
            agents that hover after so much time in the air, (N,) s; None if they are not known.
            Rehearsals read it.
    """

    make: Callable[..., Transport]
    realtime: bool = True
    heights_above_surface: Callable[..., bool] | None = None
    flow_deck: Callable[..., bool] | None = None
    exact_odometry: Callable[..., bool] | None = None
    exact_control: Callable[..., bool] | None = None
    detects_tags: Callable[..., bool] | None = None
    measures_positions: Callable[..., bool] | None = None
    measurement_errors: Callable[..., tuple[float, float] | None] | None = None
    onboard_system: Callable[..., str | None] | None = None
    hover_voltage: Callable[..., Array] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizerSpec(MissionSpec):
    """Announces a localizer.

    Attributes:
        corrects_heights: Whether its heights are right over obstacles too if those of the on-board
            estimators are not; if not, ``star check`` warns of agents that fly over obstacles.
        edge_clearance: Height over an obstacle, as a ratio of the step at its edge, below which
            ``star check`` warns of agents that cross the edge all the same: there drones sink.
        drift: ``drift(scene, time, position, yaw, **options)`` returns the expected standard
            deviation, (T, N) m, of the horizontal error of agents that fly along paths: at times
            (T,), s, with positions (T, N, 3), m, and headings (T, N), rad. It is for localizers
            whose errors grow in flight, and runs in ``star check``; None for others.
        covered: ``covered(scene, position, **options)`` returns where agents can be located, (T,),
            out of positions (T, 3), m; ``star check`` warns of paths that lead elsewhere. None if
            that is everywhere.
        reports_in_map: Whether it takes reports of on-board estimators that know the map.
            Transports read it in `Scene.reports_in_map`.
    """

    make: Callable[..., Localizer]
    corrects_heights: bool = False
    edge_clearance: float = 0.0
    drift: Callable[..., Array] | None = None
    covered: Callable[..., Mask] | None = None
    reports_in_map: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerSpec(MissionSpec):
    """Announces a planner.

    Attributes:
        check_goals: ``check_goals(scene, goals, **options)`` yields a `Problem` for every goal that
            the planner would refuse, out of a list of (x, y, z) in the map, m. The problem's path
            is the goal's index, ``(i,)``; its message follows "goal [x, y, z]". It runs in
            ``star check``: import nothing heavy. In flight the planner should decide by the same
            function.
        avoids_obstacles: Whether it plans around obstacles; if not, ``star check`` reports those
            in the straight way of an agent.
    """

    make: Callable[..., Planner]
    avoids_obstacles: bool = False
    check_goals: Callable[..., Iterable[Problem]] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AvoiderSpec(MissionSpec):
    """Announces an avoider.

    Attributes:
        avoids_obstacles: Whether it keeps agents from obstacles too.
        uncertain_positions: Whether traffic still flows through narrow places when distances are
            enlarged for uncertain positions; if not, ``star check`` warns where they are.
        leads_around: Whether it leads agents around others that hover, to goals that these do not
            enclose; without this and `uncertain_positions` ``star check`` warns of such others.
    """

    make: Callable[..., Avoider]
    avoids_obstacles: bool = False
    uncertain_positions: bool = False
    leads_around: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Exclusive:
    """A resource outside of STAR that a task holds while it exists, such as a port.

    Parallel steps cannot hold the same. ``star explain`` rehearses no step that holds one.

    Attributes:
        options: Names of the options that identify the resource.
        unless: Name of the option with which a step holds no resource, if there is one.
        timeout: Duration after which a step that waits for the resource fails, s.
    """

    options: tuple[str, ...]
    unless: str | None = None
    timeout: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSpec(MissionSpec):
    """Announces a task: a verb of the mission language.

    Attributes:
        make: ``make(scene, rows, **options)`` with the rows (a tuple) of its agents.
        check: ``check(scene, rows, **options)``.
        goals: ``goals(scene, rows, **options)`` yields a `StepGoal` for each goal that agents fly
            to by the planner; of a line, positions no more than 0.05 m apart. It is called if
            `check` found no problem. Import nothing heavy.
        before: Where its agents must be when it begins; None if that does not matter.
        after: Where they are when it has succeeded; None if that is unknown.
        exclusive: The resource that it holds, if any.
        expects: ``expects(scene, rows, **options)`` yields what is to be expected of a step that
            has no problem, such as its precision, in a few words for ``star check``.
    """

    make: Callable[..., Task]
    goals: Callable[..., Iterable[StepGoal]] | None = None
    before: Literal["ground", "air"] | None = None
    after: Literal["ground", "air", "same"] | None = None
    exclusive: Exclusive | None = None
    expects: Callable[..., Iterable[str]] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MonitorSpec(Spec):
    """Announces a monitor: it checks every flight, whatever the mission.

    Attributes:
        make: ``make(scene)`` returns it. Import heavy packages in it; `deferred` does.
    """

    make: Callable[[Scene], Monitor]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandSpec(Spec):
    """Announces a command.

    Attributes:
        configure: ``configure(line)`` adds its options to an `argparse.ArgumentParser`; the
            description is the summary unless it sets another.
        run: ``run(options, registry)`` runs it with the parsed options and returns its exit status.
            Import heavy packages in both; `deferred` does.
        group: Heading in ``star --help``: Fly, Review, Author, Study, Hardware, Plugins or another.
    """

    configure: Callable[[ArgumentParser], object]
    run: Callable[[Namespace, Registry], int]
    group: str = "Other"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptionSpec(Spec):
    """Announces an option of ``star run``, ``--NAME``, that adds an observer to the flight.

    Attributes:
        make: ``make(mission, registry)`` returns the observer, an object with hooks, or raises
            `InputError`. It is called before the plugins of the mission are made. With a `metavar`
            it is ``make(mission, registry, value)``.
        metavar: What the option's value is called in ``star run --help``; None if it has no value.
    """

    make: Callable[..., object]
    metavar: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FormatSpec(Spec):
    """Announces a format of missions and of the files beside them.

    Attributes:
        load: ``load(path, registry, assignments)`` returns the `Mission` of a file, in which the
            ``assignments``, ``path=value`` each, are set first. It raises `InputError` with every
            reason for which the mission cannot be flown.
        check: ``check(path, registry, assignments)`` returns in words what a file of any kind is
            good for, and its warnings, one line each. It raises `InputError` as ``load`` does.
        recognizes: ``recognizes(path)`` returns whether a file or folder is in this format; None
            for a format that reads whatever no other format recognizes.
        resembles: ``resembles(path, registry)`` returns whether a file is clearly meant for a
            format without ``recognizes``, valid or not: ``star check FOLDER`` checks such files.
        read: ``read(path, kind, registry)`` returns a file of a kind (`FileKindSpec`) as a
            `SourceFile` that fits the schema of the kind.
        values: ``values(path)`` returns the content of any file as a `star_core.formats.Value`.
        schema: ``schema(kind, registry)`` returns the JSON Schema of a kind of file for editors.
        missions: ``missions()`` returns by name the paths and the descriptions of the files that
            come with the format.
        check_choice: ``check_choice(kind, choice, registry)`` yields a `Problem` for each mistake
            in the choice of a plugin, a name or ``{"use": name, option: value}``.
        restore: ``restore(manifest, file)`` returns the agents and the world of a record, whose
            manifest, read from a file, has the contents of the mission's files.
    """

    load: Callable[[Path, Registry, Sequence[str]], Mission]
    check: Callable[[Path, Registry, Sequence[str]], tuple[str, Sequence[str]]]
    recognizes: Callable[[Path], bool] | None = None
    resembles: Callable[[Path, Registry], bool] | None = None
    read: Callable[[Path, str, Registry], SourceFile] | None = None
    values: Callable[[Path], Any] | None = None
    schema: Callable[[str, Registry], dict[str, Any]] | None = None
    missions: Callable[[], Mapping[str, tuple[Path, str]]] | None = None
    check_choice: Callable[..., Iterable[Problem]] | None = None
    restore: Callable[[Mapping[str, Any], Path], tuple[tuple[Agent, ...], World]] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FileKindSpec(Spec):
    """Announces a kind of file, which ``star check`` and ``star schema`` then accept.

    Attributes:
        noun: For messages: ``a study``.
        keys: Keys at the top by which it is recognized: a file is of the kind with most of them.
        schema: ``schema(registry)`` returns its JSON Schema; None if it has none.
        check: ``check(file, registry)`` returns in words what a file that fits the schema is good
            for; it raises `InputError` with every mistake that the schema cannot detect. None if
            ``star check`` does not accept such files. Import heavy packages in both; `deferred`
            does.
        hints: What to do with such a file where one of another kind is expected, by that kind.
    """

    noun: str
    keys: Collection[str]
    schema: Callable[[Registry], dict[str, Any]] | None = None
    check: Callable[[SourceFile, Registry], str] | None = None
    hints: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class KindSpec:
    """Adds a kind of plugins, which others offer by the hook ``star_NAMEs``.

    Attributes:
        name: Lower case, words joined by ``_``.
        record: Class of the records that the hook yields.
    """

    name: str
    record: type[Spec]


SPECS: Mapping[str, type[Spec]] = {
    "transport": TransportSpec,
    "localizer": LocalizerSpec,
    "planner": PlannerSpec,
    "avoider": AvoiderSpec,
    "task": TaskSpec,
    "monitor": MonitorSpec,
    "command": CommandSpec,
    "run_option": RunOptionSpec,
    "format": FormatSpec,
    "file_kind": FileKindSpec,
}

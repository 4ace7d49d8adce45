"""Command line of ``star script``."""

from __future__ import annotations

import json
from argparse import SUPPRESS, ArgumentError, ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from star_core import Fence, InputError, Mission, Operator, Registry, load
from star_core.commands import add_set_option, guarded, land_on_signals, reserving
from star_core.formats import recognized_as
from star_core.toolkit import Progress, log

IMPORTED: Final = "original-star"  # format of robots that have neither a world nor limits
ROOM: Final = 3.0  # m around the starts, and above them, in a world that no file describes
SPEED, ACCELERATION = 2.0, 5.0  # limits for swarms of which no file has any


def configure(registry: Registry, line: ArgumentParser) -> None:
    """Add the options of the command, then those of plugins for flights."""
    line.description = (
        "Run a script written for Crazyswarm2's crazyflie_py or Crazyswarm's pycrazyswarm, "
        "unchanged: in simulation in lock-step, over star fleet, or by radio. Its commands pass "
        "through avoider, safety filter and geofence."
    )
    line.add_argument("script", type=Path, help="the script (Python)")
    line.add_argument(
        "--swarm",
        required=True,
        metavar="FILE",
        help="crazyflies.yaml, or a mission, whose steps are not flown",
    )
    add_set_option(line)
    line.add_argument("--seed", help="seed of every random number")
    line.add_argument(
        "--speed", help="times real time, in simulation; as fast as it can by default"
    )
    line.add_argument(
        "--button",
        type=float,
        default=2.0,
        metavar="S",
        help="mission time after which a button is pressed that the script waits for (2)",
    )
    line.add_argument("--out", metavar="DIR", help="record into DIR (runs/TIME-SCRIPT)")
    line.add_argument("--no-record", action="store_true", help="leave nothing behind")
    line.add_argument("--json", action="store_true", help="print the summary as JSON, only")
    for name, spec in registry.offers()["run_option"].items():
        value: dict[str, Any] = {"action": "store_const", "const": ()}
        if spec.metavar is not None:
            value = {"nargs": 1, "metavar": spec.metavar}
        try:
            line.add_argument(f"--{name}", dest=f"--{name}", help=spec.summary, **value)
        except ArgumentError:
            log(f"star: --{name} is left out: star script has an option of that name itself")
    line.add_argument("arguments", nargs="*", help=SUPPRESS)


def run(options: Namespace, registry: Registry) -> int:
    """Run the script, print a summary and return the exit status.

    Raises:
        InputError: The script or the swarm cannot be used.
    """
    script: Path = options.script
    if not script.is_file():
        raise InputError(f"{script}: no such file", "file-not-found")
    with Progress("loading plugins"):
        from star_script.run_script import run_script
    mission = _mission(options, registry, script.stem)
    for warning in mission.warnings:
        log(warning)
    record: AbstractContextManager[Path | None] = nullcontext()
    if options.out is not None and not options.no_record:
        record = nullcontext(Path(options.out))
        if Path(options.out, "manifest.json").exists():
            text = f"--out {options.out}: holds the record of a run already; name another folder"
            raise InputError(text, "unwritable-file")
    elif not options.no_record:
        record = reserving(script.stem)
    for key, values in vars(options).items():
        if key.startswith("--") and values is not None:
            option = registry.find("run_option", key.removeprefix("--"))
            observer = guarded("option", option, option.offer.make, mission, registry, *values)
            plugin = f"{option.source.plugin}:{key.removeprefix('--')}"
            registry.add(observer, replace(option.source, plugin=plugin))
    operator = Operator()
    with record as folder, land_on_signals(operator):
        summary, failed = run_script(
            script,
            options.arguments,
            mission,
            registry,
            operator,
            folder=folder,
            button=options.button,
        )
    if options.json:
        print(json.dumps(summary, indent=2))
    else:
        print(_text(summary, folder))
    operator.await_landings()
    return int(failed or summary["outcome"] != "completed")


def _mission(options: Namespace, registry: Registry, name: str) -> Mission:
    """Return what to fly: the swarm's, with room and limits where its file has none."""
    path = Path(options.swarm)
    assignments: list[str] = list(options.set)
    if options.seed is not None:
        assignments.append(f"seed={options.seed}")
    if options.speed is not None:
        assignments.append(f"transport.speed={options.speed}")
    mission = load(path, registry, assignments)
    if recognized_as(path, registry) != IMPORTED:
        return replace(mission, name=name)
    if not (mission.scene.measures_positions or _names(assignments, "transport", "localizer")):
        located = ["transport.positioning={std: 0.005}", "localizer=mocap"]
        mission = load(path, registry, [*assignments, *located])
    return _widened(replace(mission, name=name), assignments)


def _names(assignments: Sequence[str], *keys: str) -> bool:
    """Return whether assignments set something of these."""
    return any(text.partition("=")[0].split(".")[0] in keys for text in assignments)


def _widened(mission: Mission, assignments: Sequence[str]) -> Mission:
    """Return a mission with room around its starts and limits that scripts of Crazyswarm need."""
    scene, limits = mission.scene, mission.scene.limits
    xs, ys, zs = zip(*(agent.start for agent in scene.agents), strict=True)
    low, high = scene.world.fence.low, scene.world.fence.high
    fence = Fence(
        (min(low[0], min(xs) - ROOM), min(low[1], min(ys) - ROOM), low[2]),
        (max(high[0], max(xs) + ROOM), max(high[1], max(ys) + ROOM), max(high[2], max(zs) + ROOM)),
    )
    if not _names(assignments, "limits"):
        height = (min(limits.height[0], 0.1), fence.high[2] - 0.2)
        limits = replace(limits, speed=SPEED, acceleration=ACCELERATION, height=height)
    world = replace(scene.world, fence=fence)
    return replace(mission, scene=replace(scene, world=world, limits=limits))


def _text(summary: Mapping[str, Any], folder: Path | None) -> str:
    """Return the lines that end a flight."""
    reason = f": {summary['reason']}" if summary["reason"] else ""
    agents = len(summary["agents"])
    lines = [
        f"{summary['mission']}: {summary['outcome']}{reason}",
        f"  flight            {summary['flight_time_s']:.1f} s with {agents} "
        f"agent{'s' * (agents != 1)}, {summary['realtime_factor']:.0f} times real time",
    ]
    if summary.get("min_separation_m") is not None:
        lines.append(f"  closest approach  {summary['min_separation_m']:.2f} m")
    if folder is not None:
        lines.append(f"  record            {folder}; star view {folder}")
    return "\n".join(lines)

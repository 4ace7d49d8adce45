"""Crazyswarm2's polynomial trajectories in an import: which agents fly them, gaps, and pieces."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from star_core import InputError
from star_core.toolkit import shortlist
from star_import.import_log import ImportLog, show
from star_import.robots import Robot
from star_import.sources import Sources
from star_import.text import Line, word

if TYPE_CHECKING:
    from star_core import Array

HEIGHT: Final = 1.0  # m, take-off height of Crazyswarm2's examples
SPEED: Final = 0.5  # m/s, of the pieces that bridge gaps, on average at most 0.4 times this
SHORTEST: Final = 0.5  # s, of a piece that bridges a gap
MAX_GAP: Final = 0.05  # m, between pieces, which needs no bridge: files have few decimals
MOST_ON_BOARD: Final = 31  # pieces that a Crazyflie holds
COLUMNS: Final = 33  # a duration, and eight coefficients for each of x, y, z and yaw


@dataclass(frozen=True, slots=True)
class Flown:
    """Trajectories as they are written.

    Attributes:
        copies: Files to be copied, by their path in the folder of the mission.
        lines: Files with bridges over their gaps, by the same.
        agents: Path in that folder, and the agents that fly it; none for all, one after the other.
    """

    copies: Mapping[str, Path] = field(default_factory=dict)
    lines: Mapping[str, Sequence[Line]] = field(default_factory=dict)
    agents: Sequence[tuple[str, str]] = ()


@dataclass(frozen=True, slots=True)
class Trajectories:
    """How trajectories are flown.

    Attributes:
        timescale: Factor by which they are stretched.
        bridge: Whether gaps between pieces are bridged.
        on_board: Whether the drones' own commanders fly them.
        assigned: Trajectories of agents, all flown at once, by the agents' names.
        speed: Speed limit, m/s; None for the default.
    """

    timescale: float = 1.0
    bridge: bool = False
    on_board: bool = False
    assigned: Mapping[str, Path] = field(default_factory=dict)
    speed: float | None = None

    def flown(
        self, sources: Sources, swarm: Sequence[Robot], log: ImportLog, *, direct: bool
    ) -> Flown:
        """Return the trajectories; what is wrong with them is added to the problems of `log`.

        Args:
            sources: With those that all agents fly.
            swarm: The agents.
            log: Log of changes.
            direct: Whether they stay where they are.
        """
        names = [robot.name for robot in swarm]
        for name in self.assigned:
            if name not in names:
                text = f"--trajectory {name}: no agent {name!r} among {shortlist(names)}"
                log.problems.append(f"{text} [unknown-agent]")
        copies: dict[str, Path] = {}
        lines: dict[str, Sequence[Line]] = {}
        agents: list[tuple[str, str]] = []
        pairs = [("", path) for path in sources.trajectories]
        for agent, path in [*pairs, *self.assigned.items()]:
            name = path.name if direct else f"paths/{path.name}"
            agents.append((name, agent))
            with log.collected():
                pieces = _pieces(path)
                bridged = _bridged(pieces, self.speed or SPEED) if self.bridge else pieces
                if len(bridged) > len(pieces):
                    count = len(bridged) - len(pieces)
                    log.changed(str(path), f"gaps are bridged by {count} pieces more")
                    lines[name] = [Line(text, str(path)) for text in _written(path, bridged)]
                else:
                    copies[name] = path
                if self.on_board and len(bridged) > MOST_ON_BOARD:
                    raise InputError(
                        f"{path}: has {len(bridged)} pieces, and a Crazyflie holds "
                        f"{MOST_ON_BOARD}; leave out --on-board",
                        "invalid-trajectory",
                    )
        return Flown(copies, lines, agents)

    def steps(self, flown: Flown, sources: Sources, log: ImportLog) -> Iterator[Line]:
        """Yield the steps of trajectories, with a take-off and a landing."""
        if sources.mission:
            log.assumed(sources.mission.mark.source, "trajectories are flown after its commands")
        text = f"a take-off to {HEIGHT:g} m and a landing, which are not in the files, are added"
        log.assumed("mission", text)
        yield Line(f"  - takeoff: {{height: {HEIGHT:g}}}")
        more = f", timescale: {show(self.timescale)}" if self.timescale != 1.0 else ""
        more += ", on_board: true" if self.on_board else ""
        if flown.agents:
            log.assumed(
                "paths",
                "durations are in s, positions in m, yaw in rad; relative to where an agent is",
            )
        for name, agent in flown.agents:
            if not agent:
                yield Line(f"  - follow: {{file: {word(name)}, format: poly7{more}}}", name)
        if any(agent for _, agent in flown.agents):
            yield Line("  - parallel:")
        for name, agent in flown.agents:
            if agent:
                text = f"agents: {agent}, file: {word(name)}, format: poly7{more}"
                yield Line(f"      - follow: {{{text}}}", name)
        yield Line("  - land: {}")


def _pieces(path: Path) -> list[list[float]]:
    """Return the numbers of the pieces of a file; none if it is not one, which its check reports.

    Raises:
        InputError: It cannot be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = [row[:COLUMNS] for row in csv.reader(stream) if any(map(str.strip, row))]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read: {error}", "unreadable-file") from error
    try:
        pieces = [[float(cell) for cell in row] for row in rows[1:]]
    except ValueError:
        return []
    return pieces if all(len(piece) == COLUMNS for piece in pieces) else []


def _bridged(pieces: Sequence[Sequence[float]], speed: float) -> list[Sequence[float]]:
    """Return pieces with one more in each gap, which ends and begins as its neighbors do."""
    import numpy as np

    result: list[Sequence[float]] = []
    table = np.array(pieces, float).reshape(len(pieces), COLUMNS)
    coefficients = table[:, 1:].reshape(-1, 4, 8)
    for i, piece in enumerate(pieces):
        if i:
            end = _state(coefficients[i - 1], table[i - 1, 0], np)
            begin = _state(coefficients[i], 0.0, np)
            gap = math.dist(end[0, :3], begin[0, :3])
            if gap > MAX_GAP:
                time = max(SHORTEST, 2.5 * gap / speed)
                result.append([time, *_bridge(end, begin, time, np).ravel().tolist()])
        result.append(piece)
    return result


def _state(coefficients: Array, time: float, np: Any) -> Array:
    """Return a piece's value and its first three derivatives at a time: (4, 4)."""
    rows = []
    for order in range(4):
        powers = np.arange(order, 8)
        factor = np.array([math.perm(power, order) for power in powers])
        rows.append(coefficients[:, order:] @ (factor * time ** (powers - order)))
    state: Array = np.array(rows)
    return state


def _bridge(end: Array, begin: Array, time: float, np: Any) -> Array:
    """Return the coefficients, (4, 8), of a piece from one state to another within a time, s."""
    low = np.array([end[order] / math.factorial(order) for order in range(4)])  # (4, axes)
    powers = np.arange(8)
    matrix = np.array(
        [
            [math.perm(power, order) * time ** max(power - order, 0) * (power >= order)
             for power in powers]
            for order in range(4)
        ]
    )  # fmt: skip
    high = np.linalg.solve(matrix[:, 4:], begin - matrix[:, :4] @ low)
    coefficients: Array = np.concatenate([low, high]).T
    return coefficients


def _written(path: Path, pieces: Sequence[Sequence[float]]) -> list[str]:
    with path.open(encoding="utf-8-sig") as stream:
        header = stream.readline().rstrip("\r\n")
    return [header, *(",".join(f"{number:.9g}" for number in piece) for piece in pieces)]

"""Draws the steps of valid missions.

Where every agent hovers after each of them is kept, so that goals are free, apart from each other,
and not above an agent on the ground.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise, product
from typing import Any, Final, TypeAlias

import numpy as np

from star_verbs.formation.shapes import shape
from star_verbs.positions import points_between, spread
from star_verbs.step_agents import assign
from tests.fuzz.harness import Draw
from tests.fuzz.random_worlds import OBSTACLE_GAP, Data, Room

Point: TypeAlias = tuple[float, float, float]

TRIES: Final = 40
POLY: Final = ("x", "y", "z", "yaw")
MINIMUM_JERK: Final = (0, 0, 0, 10, -15, 6, 0, 0)  # of a displacement, over normalized time


class Infeasible(Exception):  # noqa: N818 -- not an error: another step is drawn
    """A step that was drawn has no room."""


class Author:
    """Writes steps.

    Args:
        draw: Source of all that is random.
        room: The world.
        agents: Number of agents.

    Attributes:
        names: Of the agents.
        start: Of each agent.
        reserve: Names of those that join later.
        cameras: Whether agents need cameras.
        files: Text of other files that steps name, by name.
    """

    def __init__(self, draw: Draw, room: Room, agents: int) -> None:
        self._draw, self._room = draw, room
        self.names = [f"cf{i + 1}" for i in range(agents)]
        self.files: dict[str, str] = {}
        self.cameras = False
        self.start: dict[str, Point] = {}
        self._position: dict[str, Point | None] = {}  # None: not known
        for name in self.names:
            x, y, _ = self._free_point(height=0.0)
            while not room.clear((x, y, 0.8), OBSTACLE_GAP):  # it climbs there
                x, y, _ = self._free_point(height=0.0)
            self.start[name] = self._position[name] = (x, y, 0.0)
        joins = agents > 2 and draw.random() < 0.15
        self.reserve = self.names[-1:] if joins else []
        self._flying: list[str] = []

    def body(self, steps: int) -> list[Data]:
        """Return the steps of a mission."""
        height = self._height(0.5, 1.0)
        team = [name for name in self.names if name not in self.reserve]
        written = [self._takeoff(team, height)]
        while len(written) <= steps:
            written += self._step()
        if self.reserve and self._clear_of(self.start[self.reserve[0]], self._flying):
            name = self.reserve[0]
            written.append({"join": {"agents": name, "height": height}})
            self._rise([name], height)
            written += self._written(self._goto_each, self._flying)
        written.append({"land": self._some({"speed": 0.3}) | {"agents": list(self._flying)}})
        return written

    def reaction(self) -> Data:
        """Return a reaction: agents stop where they are, and land."""
        name = self._draw.choice([name for name in self.names if name not in self.reserve])
        when = self._draw.choice([{"time": 9.0}, {"battery_below": 3.2}, {"event": "landing"}])
        stop = {"hold": {"agents": name, "for": 1.0}}
        return {"when": when, "then": [stop, {"land": {"agents": name}}]}

    def _step(self) -> list[Data]:
        """Return a step, or several that belong together."""
        lost = [name for name in self._flying if self._position[name] is None]
        if lost:  # so that it is known again where they are
            return self._written(self._goto_each, self._flying)
        kinds = [self._goto_each] * 3 + [self._formation] * 2 + [
            self._goto_group, self._goto_by, self._beside, self._hold, self._wait,
            self._follow_path, self._follow_file, self._follow_polynomials, self._search,
            self._parallel, self._parallel, self._repeat, self._each, self._if, self._include,
            self._land_again, self._leave,
        ]  # fmt: skip
        return self._written(self._draw.choice(kinds), self._some_of(self._flying))

    def _written(self, kind: Any, movers: Sequence[str]) -> list[Data]:
        """Return the steps of a kind; none, and nothing moved, if there is no room."""
        before, flying = dict(self._position), list(self._flying)
        try:
            return list(kind(list(movers)))
        except Infeasible:
            self._position, self._flying = before, flying
            return []

    # what is drawn

    def _some_of(self, names: Sequence[str]) -> list[str]:
        if self._draw.random() < 0.5:
            return list(names)
        return sorted(self._draw.sample(names, self._draw.randint(1, len(names))))

    def _height(self, low: float = 0.4, high: float = 1.5) -> float:
        return round(self._draw.uniform(low, high), 2)

    def _some(self, options: Data, share: float = 0.3) -> Data:
        """Return some of the options."""
        return {key: option for key, option in options.items() if self._draw.random() < share}

    def _travel(self) -> Data:
        draw = self._draw
        return self._some({
            "speed": round(draw.uniform(0.2, 0.5), 2), "yaw_deg": draw.randrange(-180, 180, 15)
        })  # fmt: skip

    def _until(self, movers: Sequence[str]) -> Data:
        """Return a condition that may end a step early."""
        draw = self._draw
        at: Data = {"point": list(self._free_point([]))}
        if others := [name for name in self.names if name not in movers]:
            at = draw.choice([at, {"agent": draw.choice(others)}])
        kinds: list[Data] = [
            {"elapsed": round(draw.uniform(1, 8), 1)},
            {"near": {**at, "within": 0.6}},
            {"battery_below": 3.1},
            {"time": round(draw.uniform(1, 60), 1)},
            {"event": "landing", "agents": draw.choice(self.names)},
            {"battery_below": 3.2, "agents": {draw.choice(["any", "all"]): self.names[:2]}},
        ]
        condition = draw.choice(kinds)
        return draw.choice([condition, {"any": [condition, kinds[0]]}, {"all": [condition]}])

    def _maybe_until(self, movers: Sequence[str]) -> Data:
        return {"until": self._until(movers)} if self._draw.random() < 0.1 else {}

    def _agents(self, names: Sequence[str]) -> Any:
        if [*names] == self.names and not self.reserve:
            return self._draw.choice(["all", [*names]])
        return [*names]

    # what is free

    def _free_point(
        self, others: Iterable[str] | None = None, height: float | None = None
    ) -> Point:
        """Draw a point that is free, and apart from the positions of others.

        Raises:
            Infeasible: There is none.
        """
        names = [*self._position] if others is None else [*others]
        for _ in range(TRIES):
            x, y = (round(self._draw.uniform(-h, h), 2) for h in self._room.half)
            z = self._height() if height is None else height
            if self._room.free((x, y, z)) and self._clear_of((x, y, z), names):
                return x, y, z
        raise Infeasible

    def _clear_of(self, point: Sequence[float], names: Iterable[str]) -> bool:
        at = [self._position[name] for name in names]
        return all(
            place is not None and math.dist(point[:2], place[:2]) > self._room.apart for place in at
        )

    def _send(
        self, movers: Sequence[str], goals: Sequence[Point], passed: Sequence[Point] = ()
    ) -> None:
        """Assign goals to movers as a step does; with points that they pass on the way.

        Raises:
            Infeasible: A goal is not free, or too near to another agent.
        """
        others = [name for name in self._position if name not in movers]
        free = all(
            self._room.free(point) and self._clear_of(point, others) for point in (*goals, *passed)
        )
        apart = all(
            math.dist(a[:2], b[:2]) > self._room.apart - 0.06
            for i, a in enumerate(goals)
            for b in goals[:i]
        )
        if not (free and apart):
            raise Infeasible
        position = np.array([self._position[name] for name in movers])
        for name, k in zip(movers, assign(position, np.array(goals)).tolist(), strict=True):
            self._position[name] = goals[k]

    def _tried(self, make: Any) -> Data:
        """Return what a function makes, of the first of several tries that has room."""
        for _ in range(TRIES):
            try:
                made: Data = make()
            except Infeasible:
                continue
            return made
        raise Infeasible

    def _rise(self, names: Sequence[str], height: float) -> None:
        for name in names:
            x, y, _ = self._position[name] or self.start[name]
            self._position[name] = (x, y, height)
        self._flying = sorted({*self._flying, *names}, key=self.names.index)

    # the verbs

    def _takeoff(self, names: Sequence[str], height: float) -> Data:
        self._rise(names, height)
        return {"takeoff": {"agents": [*names], "height": height}}

    def _goto_each(self, movers: list[str]) -> list[Data]:
        goals: dict[str, Point] = {}
        stay = [name for name in self._position if name not in movers]
        for name in movers:
            for _ in range(TRIES):
                goal = self._free_point(stay)
                if all(
                    math.dist(goal[:2], other[:2]) > self._room.apart for other in goals.values()
                ):
                    goals[name] = goal
                    break
            else:
                raise Infeasible
        self._position |= goals
        steps = [
            {
                "goto": {"agents": name, "to": list(goal)}
                | self._travel()
                | self._maybe_until([name])
            }
            for name, goal in goals.items()
        ]
        return [{"parallel": steps}] if len(steps) > 1 else steps

    def _goto_group(self, movers: list[str]) -> list[Data]:
        def made() -> Data:
            to, spacing = self._free_point([]), round(self._draw.uniform(0.0, 1.2), 2)
            spacing = max(spacing, self._room.apart)
            self._send(movers, spread(len(movers), to, spacing))
            return {"agents": self._agents(movers), "to": list(to), "spacing": spacing}

        return [{"goto": self._tried(made) | self._travel()}]

    def _goto_by(self, movers: list[str]) -> list[Data]:
        draw = self._draw
        offset: Point = (0.0, 0.0, 0.0)

        def made() -> Data:
            nonlocal offset
            offset = (round(draw.uniform(-1.2, 1.2), 2), round(draw.uniform(-1.2, 1.2), 2),
                      round(draw.uniform(-0.4, 0.4), 2))  # fmt: skip
            ends = self._shifted(movers, offset)
            stay = [name for name in self._position if name not in movers]
            if draw.random() > 0.05 and not all(  # few lead out of the fence
                self._room.free(end) and self._clear_of(end, stay) for end in ends.values()
            ):
                raise Infeasible
            self._position |= ends
            return {"agents": self._agents(movers), "by": list(offset)}

        return [{"goto": self._tried(made) | self._travel()}]

    def _beside(self, movers: list[str]) -> list[Data]:
        """A goal beside an agent that stays."""
        draw, mover = self._draw, movers[0]
        others = [n for n in self._flying if n not in movers[:1] and self._position[n] is not None]
        if not others:
            raise Infeasible
        other = draw.choice(others)
        at = self._position[other]
        assert at is not None
        goal = self._free_point([name for name in self._position if name != mover])
        by = [round(b - a, 2) for a, b in zip(at, goal, strict=True)]
        self._position[mover] = goal
        options: Data = {"agents": mover, "relative_to": other, "by": by}
        options |= self._some({"moving": True}, share=0.5)
        return [{"goto": options | self._travel()}]

    def _shifted(self, names: Sequence[str], offset: Point) -> dict[str, Point]:
        at = {name: self._position[name] or self.start[name] for name in names}
        return {
            name: (point[0] + offset[0], point[1] + offset[1], point[2] + offset[2])
            for name, point in at.items()
        }

    def _hold(self, movers: list[str]) -> list[Data]:
        seconds = round(self._draw.uniform(0, 3), 1)
        if self._draw.random() < 0.5:
            return [
                {
                    "hold": {"agents": self._agents(movers), "for": seconds}
                    | self._maybe_until(movers)
                }
            ]

        def made() -> Data:
            at = self._free_point([])
            self._send(movers, spread(len(movers), at, self._room.apart))
            return {
                "agents": self._agents(movers),
                "at": list(at),
                "spacing": self._room.apart,
                "for": seconds,
            }

        return [{"hold": self._tried(made) | self._travel()}]

    def _wait(self, movers: list[str]) -> list[Data]:
        elapsed = {"elapsed": round(self._draw.uniform(0.5, 4), 1)}
        either = {"any": [elapsed, {"battery_below": 3.0}]}
        both = {"all": [elapsed, {"not": {"battery_below": 2.9}}]}
        named = {"any": [elapsed, {"battery_below": 3.0, "agents": "all"}]}
        clock: Data = {"time": round(self._draw.uniform(1, 30), 1)}
        until = self._draw.choice([elapsed, either, both, named, clock])
        return [{"wait": {"agents": self._agents(movers), "until": until}}]

    def _formation(self, movers: list[str]) -> list[Data]:
        draw = self._draw

        def made() -> Data:
            spacing = round(self._room.apart + draw.uniform(0, 0.5), 2)
            options: Data = {"shape": draw.choice(["line", "grid", "circle", "points"])}
            options["centre"] = list(self._free_point([]))
            if options["shape"] == "points":
                lattice = spread(len(movers), (0, 0, 0), spacing)
                options["points"] = [
                    [round(x, 2), round(y, 2), round(draw.uniform(-0.2, 0.2), 2)]
                    for x, y, _ in lattice
                ]
            else:
                options["spacing"] = spacing
            options |= self._some({"yaw_deg": draw.randrange(-90, 90, 15), "within": 0.2,
                                   "for": round(draw.uniform(0, 2), 1)})  # fmt: skip
            if draw.random() < 0.4:
                options["move"] = {"to": list(self._free_point([]))}
            figure = shape(len(movers), {"for": 0.0, **options})
            passed = [point for position in figure.position for point in figure.passed(position)]
            self._send(movers, figure.position, passed)
            if any(figure.move):
                self._position |= self._shifted(movers, figure.move)
            return {"agents": self._agents(movers), **options}

        return [{"formation": self._tried(made)}]

    def _follow_path(self, movers: list[str]) -> list[Data]:
        draw = self._draw
        movers = movers[: draw.choice([1, 1, 2, 3])]

        def made() -> Data:
            x, y, z = self._free_point([])
            width = round(draw.uniform(0.5, 1.0), 2)
            size = round(draw.uniform(1.0, 2.4), 2)
            path = draw.choice(
                ["box", "circle", "figure8"] if len(movers) == 1 else ["box", "circle"]
            )
            if path != "figure8":
                width = size
            corners = [(x + a * size / 2, y + b * width / 2, z) for a in (-1, 1) for b in (-1, 1)]
            ring = [corners[i] for i in (0, 1, 3, 2, 0)]
            passed = [p for a, b in pairwise(ring) for p in points_between(a, b, 0.2)]
            grid = product((-0.7, -0.35, 0, 0.35, 0.7), repeat=2)
            inner = [(x + u * size / 2, y + v * width / 2, z) for u, v in grid]
            others = [name for name in self._position if name not in movers]
            if not all(self._room.free(p) and self._clear_of(p, others) for p in (*passed, *inner)):
                raise Infeasible
            if len(movers) > 1 and 3 * size / len(movers) < 2:
                raise Infeasible
            options: Data = {"path": path, "size": size, "centre": [x, y, z]}
            return options | ({"width": width} if path == "figure8" else {})

        options = self._tried(made)
        for name in movers:
            self._position[name] = None
        options |= self._some({"heading": "along", "speed": 0.4, "laps": 2})
        return [{"follow": {"agents": self._agents(movers), **options}}]

    def _line(self, movers: Sequence[str], points: int) -> list[Point]:
        """Draw a line of free points with nothing near to it."""
        others = [name for name in self._position if name not in movers]
        line = [self._free_point(others)]
        for _ in range(TRIES):
            if len(line) == points:
                return line
            end = self._free_point(others)
            way = points_between(line[-1], end, 0.1)
            if all(self._room.free(p) and self._clear_of(p, others) for p in way):
                line.append(end)
        raise Infeasible

    def _follow_file(self, movers: list[str]) -> list[Data]:
        line = self._line(movers[:1], self._draw.randint(2, 5))
        name = f"line{len(self.files)}.csv"
        rows = [",".join(f"{value:g}" for value in point) for point in line]
        self.files[name] = "\n".join(["x,y,z", *rows]) + "\n"
        self._position[movers[0]] = line[-1]
        options = self._some({"heading": "along", "speed": 0.4})
        return [{"follow": {"agents": movers[0], "file": name, **options}}]

    def _follow_polynomials(self, movers: list[str]) -> list[Data]:
        """A displacement and back, by polynomials, each from rest to rest."""
        name, mover = f"poly{len(self.files)}.csv", movers[0]
        start = self._position[mover]
        others = [other for other in self._position if other != mover]
        for _ in range(TRIES):
            end = self._free_point(others)
            assert start is not None
            way = points_between(start, end, 0.1)
            if all(self._room.free(p) and self._clear_of(p, others) for p in way):
                break
        else:
            raise Infeasible
        seconds = max(3.0, math.ceil(1.875 * math.dist(start, end) / 0.35))  # peak over mean speed
        header = ",".join(["duration", *(f"{axis}^{i}" for axis in POLY for i in range(8))])
        offset = [b - a for a, b in zip(start, end, strict=True)]
        rows = [_piece(seconds, [0, 0, 0], offset), _piece(seconds, offset, [-d for d in offset])]
        self.files[name] = "\n".join([header, *rows]) + "\n"
        options = self._some({"on_board": True}, share=0.5)
        return [{"follow": {"agents": mover, "file": name, "format": "poly7", **options}}]

    def _search(self, movers: list[str]) -> list[Data]:
        draw = self._draw
        width, depth = round(draw.uniform(1.5, 2.5), 1), round(draw.uniform(1.5, 2.5), 1)
        x, y = (draw.uniform(-h + 0.1, h - 0.1 - size) if h > size / 2 + 0.1 else -h + 0.1
                for h, size in zip(self._room.half, (width, depth), strict=True))  # fmt: skip
        low = [round(x, 2), round(y, 2)]
        high = [round(min(x + width, self._room.half[0] - 0.1), 2),
                round(min(y + depth, self._room.half[1] - 0.1), 2)]  # fmt: skip
        stay = [name for name in self._position if name not in movers]
        near = [self._position[name] for name in stay]
        apart = self._room.apart
        if any(
            p is None
            or all(a - apart < c < b + apart for a, b, c in zip(low, high, p, strict=False))
            for p in near
        ):
            raise Infeasible
        self.cameras = True
        self._room.add_targets(low, high)
        options: Data = {"area": {"low": low, "high": high}, "coverage": draw.choice([0.7, 0.9])}
        options |= self._some({"pattern": "frontier", "height": 1.0, "on_found": "mark"})
        for name in movers:
            self._position[name] = None
        return [{"search": {"agents": self._agents(movers), **options}}]

    # steps of steps

    def _parallel(self, movers: list[str]) -> list[Data]:
        cut = self._draw.randint(0, len(movers) - 1)
        branches = []
        for names in (movers[:cut], movers[cut:]):
            if names:
                kind = self._draw.choice([
                    self._goto_group, self._hold, self._formation, self._goto_by, self._follow_file,
                ])  # fmt: skip
                branches += kind(names)
        return [{"parallel": branches}]

    def _repeat(self, movers: list[str]) -> list[Data]:
        times = self._draw.randint(2, 3)
        if self._draw.random() < 0.5:
            steps = [*self._goto_each(movers), *self._goto_each(movers)]
            return [{"repeat": {"times": times, "steps": steps}}]
        before = dict(self._position)
        (outbound,) = self._goto_by(movers)
        by = [-value if value else 0.0 for value in outbound["goto"]["by"]]
        self._position = before
        back = {"goto": {"agents": movers, "by": by}}
        return [{"repeat": {"times": times, "steps": [outbound, back]}}]

    def _each(self, movers: list[str]) -> list[Data]:
        (goto,) = self._goto_by(movers)
        step = {key: value for key, value in goto["goto"].items() if key != "agents"}
        pause = {"hold": {"for": round(self._draw.uniform(0, 2), 1)}}
        return [{"each": {"agents": movers, "steps": [pause, {"goto": step}]}}]

    def _if(self, movers: list[str]) -> list[Data]:
        """Steps that lead to the same positions, whatever the condition."""
        when = self._draw.choice([
            {"battery_below": 3.0}, {"time": 8.5}, {"event": "step", "agents": movers[0]},
            {"not": {"near": {"point": [0.0, 0.0, 1.0], "within": 1.0}, "agents": movers[-1]}},
        ])  # fmt: skip
        steps = self._goto_each(movers)
        pause = {"hold": {"agents": movers, "for": 0.5}}
        return [{"if": {"when": when, "then": steps, "else": [pause, *steps]}}]

    def _include(self, movers: list[str]) -> list[Data]:
        (goto,) = self._goto_by(movers)
        self.files["part.yaml"] = yaml_text({
            "star": 1,
            "parameters": {"team": None, "by": None, "seconds": 0.5},
            "mission": [{"goto": {"agents": "$team", "by": "$by"}},
                        {"hold": {"agents": "$team", "for": "$seconds"}}],
        })  # fmt: skip
        values = {"team": movers, "by": goto["goto"]["by"]}
        return [{"include": {"file": "part.yaml", "with": values}}]

    def _land_again(self, movers: list[str]) -> list[Data]:
        steps = [{"land": {"agents": movers}}]
        height = self._height(0.5, 1.0)
        at = [self._position[name] for name in movers]
        if not all(p and self._room.clear((p[0], p[1], z), OBSTACLE_GAP)
                   for p in at for z in (0.0, 0.5, 1.0)):  # fmt: skip
            raise Infeasible
        return [*steps, self._takeoff(movers, height)]

    def _leave(self, movers: list[str]) -> list[Data]:
        movers = movers[:2]
        stay = [name for name in self._position if name not in movers]
        home = {name: self.start[name] for name in movers}
        if len(stay) < 2 + len(self.reserve) or len(self._flying) - len(movers) < 1 or not all(
            self._clear_of(point, stay) for point in home.values()
        ):  # fmt: skip
            raise Infeasible
        self._position |= home
        self._flying = [name for name in self._flying if name not in movers]
        return [{"leave": {"agents": movers}}]


def _piece(seconds: float, start: Sequence[float], way: Sequence[float]) -> str:
    """Return a line of a file of polynomials: from `start` by `way` in some seconds."""
    numbers = [seconds]
    for a, b in zip(start, way, strict=True):
        own = [b * c / seconds**k for k, c in enumerate(MINIMUM_JERK)]
        numbers += [own[0] + a, *own[1:]]
    return ",".join(f"{value:.9g}" for value in (*numbers, *[0.0] * 8))


def yaml_text(data: Mapping[str, Any]) -> str:
    """Return a file in JSON, which is YAML: a line for each step and each key."""
    lines = []
    for key, value in data.items():
        if key in {"mission", "swarm", "obstacles", "landmarks"}:
            many = value.items() if isinstance(value, dict) else enumerate(value)
            dash = isinstance(value, list)
            lines.append(f"{key}:" if value else f"{key}: {{}}")
            lines += [f"  {'-' if dash else f'{name}:'} {json.dumps(each)}" for name, each in many]
        else:
            lines.append(f"{key}: {json.dumps(value)}")
    return "\n".join(lines) + "\n"

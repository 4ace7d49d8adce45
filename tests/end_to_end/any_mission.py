"""Draws missions from the whole language, for one to six agents in a small room."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from hypothesis import strategies as st

from tests.end_to_end.any_trouble import Trouble, troubles

Data: TypeAlias = dict[str, Any]

STARTS = tuple((x, y, 0.0) for y in (-1.5, -0.6) for x in (-0.9, 0.0, 0.9))
HEIGHTS = (0.4, 0.8, 1.2)
THEN = ("hold", "land", "stop")
OBSTACLES: tuple[Data, ...] = (
    {},
    {"post": {"cylinder": {"centre": [1.6, 1.6], "radius": 0.15}, "height": [0.0, 2.2]}},
    {"wall": {"polyline": [[-0.4, 1.5], [0.4, 1.5]], "thickness": 0.1, "height": [0.0, 1.0]}},
)
TARGETS: tuple[Data, ...] = ({}, {"lost": {"tags": [7], "at": [0.3, 0.4, 0.0]}})
PART = "part.yaml"
PARTS: Data = {  # what missions include
    "star": 1,
    "parameters": {"team": None, "seconds": 1.0},
    "mission": [
        {"hold": {"agents": "$team", "for": "$seconds"}},
        {"goto": {"agents": "$team", "by": [0.2, 0.0, 0.0]}},
    ],
}
SCOUT = {"mode": "geometric"}  # tags without images


@dataclass(frozen=True)
class Case:
    """A mission, its world, and what goes wrong."""

    mission: Mapping[str, Any]
    world: Mapping[str, Any]
    troubles: tuple[Trouble, ...]


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Missions of one to six agents in a small room, and up to three troubles."""
    n = draw(st.integers(1, 6))
    names = [f"cf{i + 1}" for i in range(n)]
    groups = {"pair": names[:2], "rest": names[1:] or names}
    idle = draw(st.integers(0, min(2, n - 1)))
    targets = draw(st.sampled_from(TARGETS))
    language = Language(draw, names, groups, names[n - idle :], bool(targets))
    looks = draw(st.booleans())
    camera = SCOUT if targets and looks else {"mode": "off"}
    mission: Data = {
        "star": 1,
        "name": "any",
        "world": "world.yaml",
        "seed": draw(st.integers(0, 99)),
        "rate": draw(st.sampled_from([5, 5, 5, 10, 20])),
        "limits": {
            "speed": draw(st.sampled_from([0.5, 1.0])),
            "separation": draw(st.sampled_from([0.2, 0.2, 0.0])),
        },
        "swarm": {
            name: {"start": list(STARTS[i]), "yaw_deg": 90 * i, "camera": "aideck"}
            for i, name in enumerate(names)
        },
        "groups": groups,
        "transport": {
            "use": "sim",
            "noise": draw(st.booleans()),
            "battery": draw(st.sampled_from([1.0, 1.0, 0.5, 0.15])),
            "endurance": draw(st.sampled_from([420, 60, 25])),
            "swap_time": draw(st.sampled_from([None, 3])),
            "camera": camera,
        },
        "localizer": draw(st.sampled_from(["flow", {"use": "flow", "error_std": 0.03}])),
        "planner": draw(st.sampled_from(["straight", "visibility"])),
        "avoider": draw(st.sampled_from(["none", "orca", "potential", "voronoi"])),
        "safety": draw(safety),
        "mission": language.whole(),
    }
    if idle:
        mission["reserve"] = {
            "agents": names[n - idle :],
            "relieve_below": draw(st.sampled_from([3.5, 3.75, 3.9])),
            "ready_above": draw(st.sampled_from([3.8, 4.0])),
            "height": draw(st.sampled_from(HEIGHTS)),
        }
    world = {
        "star": 1,
        "name": "room",
        "fence": {"low": [-2.0, -2.0, 0.0], "high": [2.0, 2.0, 2.2]},
        "obstacles": draw(st.sampled_from(OBSTACLES)),
        "targets": targets,
    }
    return Case(mission, world, draw(troubles(n)))


safety = st.fixed_dictionaries(
    {},
    optional={
        "battery_low": st.fixed_dictionaries(
            {"below": st.sampled_from([3.3, 3.6]), "then": st.sampled_from(THEN)}
        ),
        "link_lost": st.fixed_dictionaries(
            {"after": st.sampled_from([0.3, 1.0]), "then": st.sampled_from(THEN)}
        ),
        "position_lost": st.fixed_dictionaries(
            {"after": st.sampled_from([0.5, 2.0]), "then": st.sampled_from(THEN)}
        ),
        "fence_near": st.fixed_dictionaries(
            {"within": st.sampled_from([0.0, 0.2]), "then": st.sampled_from(THEN)}
        ),
        "tumbled": st.fixed_dictionaries({"then": st.sampled_from(THEN)}),
    },
)


class Language:
    """Draws steps.

    Args:
        draw: Draws from a strategy.
        names: Of the agents.
        groups: Of the mission.
        idle: Agents in reserve.
        targets: Whether there is something to be found.
    """

    def __init__(
        self,
        draw: st.DrawFn,
        names: list[str],
        groups: Mapping[str, list[str]],
        idle: list[str],
        targets: bool,  # noqa: FBT001 -- whether, and nothing else
    ) -> None:
        self._draw = draw
        self._names = names
        self._groups = groups
        self._idle = idle
        self._targets = targets

    def whole(self) -> list[Data]:
        """A mission that mostly takes off first and mostly lands last."""
        steps: list[Data] = []
        if not self._chance(8):
            steps.append({"takeoff": {"height": self._one(*HEIGHTS)}})
        steps += [self._step(self._names, 2) for _ in range(self._one(1, 2, 3, 4))]
        if not self._chance(3) or not steps:
            steps.append({"land": self._common(None)})
        return steps

    def _one(self, *values: Any) -> Any:
        return self._draw(st.sampled_from(values))

    def _chance(self, of: int) -> bool:
        """Once of so many times."""
        return self._draw(st.integers(1, of)) == of

    def _step(self, movers: list[str] | None, depth: int) -> Data:
        """A step for some of these agents; with None it names no agents."""
        kinds = ["goto", "hold", "wait", "follow", "formation", "search", "takeoff", "land"]
        kinds += ["leave", "join", "include", "external"] if movers is not None else []
        kinds += ["repeat", "parallel", "each"] * 2 if depth else []
        kind = self._one(*kinds)
        if kind in {"repeat", "parallel", "each"}:
            return self._nested(kind, movers, depth - 1)
        named, count = self._movers(movers)
        if kind == "include":
            return {"include": {"file": PART, "with": {"team": named, "seconds": self._one(0, 2)}}}
        if kind == "join":
            assert movers is not None
            named, count = self._one(*([a for a in self._idle if a in movers] or movers)), 1
        options = getattr(self, f"_{kind}")(count)
        common = self._common(named)
        return {kind: common | options}

    def _nested(self, kind: str, movers: list[str] | None, depth: int) -> Data:
        if kind == "repeat":
            steps = [self._step(movers, depth) for _ in range(self._one(1, 2))]
            return {"repeat": {"times": self._one(1, 2, 3), "steps": steps}}
        if kind == "each" and movers is not None:
            steps = [self._step(None, 0) for _ in range(self._one(1, 2))]
            return {"each": {"agents": list(movers), "steps": steps}}
        if movers is None or len(movers) == 1:
            return {"parallel": [self._step(movers, 0)]}
        cut = self._draw(st.integers(1, len(movers) - 1))
        return {"parallel": [self._step(part, depth) for part in (movers[:cut], movers[cut:])]}

    def _movers(self, movers: list[str] | None) -> tuple[Any, int]:
        """Whom a step is for, and how many they are."""
        if movers is None:
            return None, 1
        if movers == self._names and self._chance(2):
            name = self._one("all", *self._groups)
            return name, len(self._groups.get(name, self._names))
        some = self._draw(st.lists(st.sampled_from(movers), min_size=1, unique=True))
        return some, len(some)

    def _common(self, named: Any) -> Data:
        options: Data = {} if named is None else {"agents": named}
        if self._chance(4):
            options["timeout"] = self._one(1, 4, 15)
        if self._chance(2):
            options["on_failure"] = self._one("abort", "land", "continue")
        if self._chance(4):
            options["until"] = self._condition(2)
        return options

    def _condition(self, depth: int) -> Data:
        kinds = ["elapsed", "near", "battery_below", "event"] + ["found"] * self._targets
        kind = self._one(*kinds, *(["any", "all", "not"] if depth else []))
        if kind in {"any", "all"}:
            return {kind: [self._condition(depth - 1) for _ in range(self._one(1, 2))]}
        if kind == "not":
            return {kind: self._condition(depth - 1)}
        at = self._one({"agent": self._one(*self._names)}, {"point": [0.0, 0.0, 0.8]})
        values: dict[str, Data | float | str] = {
            "elapsed": self._one(0.1, 1.5, 6.0),
            "near": {**at, "within": self._one(0.3, 1.0)},
            "battery_below": self._one(3.4, 3.8),
            "event": self._one("found", "failure", "safety", "relief", "landing", "step"),
            "found": self._one(1, "lost"),
        }
        return {kind: values[kind]}

    def _point(self) -> list[float]:
        return [self._one(-0.5, 0.0, 0.4), self._one(-0.6, 0.0, 0.5), self._one(*HEIGHTS)]

    # What each verb takes, for so many agents

    def _takeoff(self, _agents: int) -> Data:
        return {"height": self._one(*HEIGHTS)}

    _join = _takeoff

    def _land(self, _agents: int) -> Data:
        return {"speed": self._one(0.2, 0.4)}

    def _leave(self, _agents: int) -> Data:
        return {}

    def _wait(self, _agents: int) -> Data:
        return {"until": self._condition(2)}

    def _hold(self, _agents: int) -> Data:
        at = self._one({}, {"at": self._point(), "spacing": 0.5})
        return {"for": self._one(0.0, 2.0, 5.0), **at}

    def _goto(self, _agents: int) -> Data:
        far = {"by": [self._one(-0.4, 0.0, 5.0), 0.3, 0.0]}
        near = {"to": self._point(), "spacing": 0.5}
        return near if self._chance(2) else far

    def _follow(self, agents: int) -> Data:
        path = self._one("box", "circle", "figure8") if agents == 1 else "box"
        centre = [0.0, 0.0, self._one(*HEIGHTS)]
        shape = {"path": path, "size": 2.0, "centre": centre, "spacing": 0.5}
        return {**shape, "speed": 0.5, "heading": self._one("fixed", "along")}

    def _formation(self, agents: int) -> Data:
        shape = self._one("line", "grid", "circle", "points")
        options: Data = {"shape": shape, "centre": self._point()}
        if shape == "points":
            options["points"] = [[x / 2, y / 2, 0.0] for x, y, _ in STARTS[:agents]]
        else:
            options["spacing"] = 0.45
        if self._chance(2):
            options["move"] = {"to": [0.2, -0.2, 0.8], "speed": 0.3}
        return options

    def _external(self, _agents: int) -> Data:
        """No client connects: the step fails after its response timeout."""
        return {"port": 0, "response_timeout": 0.05, "lockstep": self._one(True, False)}  # noqa: FBT003

    def _search(self, _agents: int) -> Data:
        area = {"low": [-1.0, -0.5], "high": [self._one(0.0, 1.0), 0.8]}
        then = self._one("continue", "land", "hover", "mark")
        pattern = self._one("sweep", "frontier")
        return {"area": area, "pattern": pattern, "then": then, "coverage": self._one(0.6, 0.99)}

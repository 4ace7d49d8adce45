"""The cells of the fault matrix: missions with the faults that happen in them.

The crossing and the circle are missions that ``star check`` passes without a warning, so that a
broken policy is due to the fault rather than to the drift of `flow`.
"""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

ROOM: Final[dict[str, Any]] = {
    "star": 1,
    "name": "room",
    "fence": {"low": [-2, -2, 0], "high": [2, 2, 2]},
    "landmarks": {
        f"{x}{y}": {"tags": [2 * (3 * i + k), 2 * (3 * i + k) + 1], "at": [a, b, 0]}
        for i, (x, a) in enumerate({"west_": -0.9, "mid_": 0, "east_": 0.9}.items())
        for k, (y, b) in enumerate({"south": -0.9, "mid": 0, "north": 0.9}.items())
    },
}
IDEAL: Final[dict[str, Any]] = {"use": "sim", "profile": "ideal", "controller": "ideal"}
CROSSING: Final[dict[str, Any]] = {
    "star": 1,
    "name": "crossing",
    "world": "room.yaml",
    "swarm": {
        "cf1": {"start": [-0.8, 0.8, 0]},
        "cf2": {"start": [0.8, 0.8, 0], "yaw_deg": 180},
        "cf3": {"start": [-0.8, -0.8, 0]},
        "cf4": {"start": [0.8, -0.8, 0], "yaw_deg": 180},
    },
    "transport": IDEAL,
    "localizer": "flow",
    "planner": "straight",
    "avoider": "orca",
    "safety": {"link_lost": {}, "position_lost": {}, "battery_low": {}, "tumbled": {}},
    "mission": [
        {"takeoff": {"height": 0.6, "speed": 0.5}},
        {
            "parallel": [
                {"goto": {"agents": "cf1", "to": [0.8, 0.8, 0.6]}},
                {"goto": {"agents": "cf2", "to": [-0.8, 0.8, 0.6]}},
                {"goto": {"agents": "cf3", "to": [0.8, -0.8, 0.6]}},
                {"goto": {"agents": "cf4", "to": [-0.8, -0.8, 0.6]}},
            ]
        },
        {"land": {}},
    ],
}
SEEING: Final[dict[str, Any]] = {
    "swarm": {name: {**agent, "camera": "aideck"} for name, agent in CROSSING["swarm"].items()},
    "transport": IDEAL | {"camera": {"mode": "geometric"}},
    "localizer": {"use": "apriltag", "processes": 0},
}
RENDERED: Final[dict[str, Any]] = SEEING | {  # of one camera, for speed
    "swarm": CROSSING["swarm"] | {"cf1": SEEING["swarm"]["cf1"]},
    "transport": IDEAL | {"camera": {"mode": "rendered"}},
}
JOINING: Final[dict[str, Any]] = {
    "reserve": {"agents": ["cf4"]},
    "mission": [
        {"takeoff": {"height": 0.6, "speed": 0.5}},
        {"hold": {"for": 1}},
        {"join": {"agents": "cf4"}},
        {"goto": {"agents": "cf4", "to": [0, 0, 0.6]}},
        {"land": {}},
    ],
}
STACKED: Final[dict[str, Any]] = {  # cf2 above cf1, and cf4 above cf3
    "mission": [
        {"takeoff": {"height": 0.6, "speed": 0.5}},
        {
            "parallel": [
                {"goto": {"agents": "cf1", "to": [-0.8, 0.0, 0.5]}},
                {"goto": {"agents": "cf2", "to": [-0.8, 0.0, 1.3]}},
                {"goto": {"agents": "cf3", "to": [0.8, 0.0, 0.5]}},
                {"goto": {"agents": "cf4", "to": [0.8, 0.0, 1.3]}},
            ]
        },
        {"hold": {"for": 6}},
        {
            "parallel": [
                {"goto": {"agents": "cf2", "to": [-0.8, 0.8, 0.8]}},
                {"goto": {"agents": "cf4", "to": [0.8, -0.8, 0.8]}},
            ]
        },
        {"land": {}},
    ]
}
FOLLOWING: Final[dict[str, Any]] = {  # all on one circle, 0.8 m from the fence
    "mission": [
        {"takeoff": {"height": 0.6, "speed": 0.5}},
        {"follow": {"path": "circle", "size": 2.4, "centre": [0.0, 0.0, 0.6], "speed": 0.4}},
        {"land": {}},
    ]
}


@dataclass(frozen=True)
class Cell:
    """A cell of the matrix.

    Attributes:
        row: Of the matrix.
        name: What happens.
        faults: Keys of faults; ``at`` is drawn if it is not given, and ``agents: one`` is an agent.
        changes: Of the mission.
        status: Exit statuses that are right.
        act: Called in the tick of the drawn time, with the operator.
        spoofed: Whether the agent that has the fault is not judged, only the others.
        pairs: Whether flights take turns with the pairs of `RULED`.
        most: Flights, where fewer than asked for suffice or many take too long.
    """

    row: str
    name: str
    faults: Sequence[Mapping[str, Any]] = ()
    changes: Mapping[str, Any] = field(default_factory=dict)
    status: tuple[int, ...] = (0,)
    act: Callable[[Any], None] | None = None
    spoofed: bool = False
    pairs: bool = False
    most: int = 10**6


def one(component: str, mode: str, **values: Any) -> Mapping[str, Any]:
    """Return a fault of one agent."""
    return {"component": component, "mode": mode, "agents": "one", **values}


def every(component: str, mode: str, **values: Any) -> Mapping[str, Any]:
    """Return a fault of all agents."""
    return {"component": component, "mode": mode, **values}


def plugin(kind: str, mode: str, **values: Any) -> Mapping[str, Any]:
    """Return a fault of a plugin."""
    return every("plugin", mode, plugin=kind, **values)


def _signal(number: int) -> Callable[[Any], None]:
    return lambda _operator: os.kill(os.getpid(), number)


def _jump(seconds: float) -> Callable[[Any], None]:
    def jump(_operator: Any) -> None:
        right = time.time
        time.time = lambda: right() + seconds

    return jump


def _fill_disk(_operator: Any) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))


EITHER: Final = (0, 1)
RULED: Final = (  # one of each of the rows 1 to 9, for pairs
    ("1 link", one("link", "off")),
    ("2 loss", every("link", "intermittent", loss=0.2)),
    ("3 all links", every("link", "off")),
    ("4 localizer", plugin("localizer", "wrong", offset=[1, 0, 0], agents="one")),
    ("5 reports", one("telemetry", "garbage")),
    ("6 slow reports", one("telemetry", "slow", rate=1.0)),
    ("7 battery", one("battery", "wrong", factor=0.75)),
    ("8 motor", one("motor", "off")),
    ("9 flow", one("flow", "wrong", factor=0.7)),
)
CELLS: Final = (
    Cell("0", "no fault"),
    Cell("1", "link of one drone off, permanently", [one("link", "off")], status=EITHER),
    Cell("1", "link of one drone off, 0.3 s", [one("link", "off", **{"for": 0.3})]),
    Cell("1", "link of one drone off, 2 s", [one("link", "off", **{"for": 2.0})], status=EITHER),
    Cell("1", "link of one drone off in the take-off, 2 s", [
        one("link", "off", **{"at": 1.0, "for": 2.0})
    ], status=EITHER),
    Cell("1", "link of one drone off in the take-off, permanently", [
        one("link", "off", at=1.0)
    ], status=(1,)),  # nothing shows that it came down: its firmware hovers
    Cell("1", "reports of one drone off, permanently", [one("telemetry", "off")], status=EITHER),
    Cell("2", "5 % loss", [every("link", "intermittent", at=0, loss=0.05)]),
    Cell("2", "20 % loss", [every("link", "intermittent", at=0, loss=0.2)]),
    Cell("2", "30 % loss", [every("link", "intermittent", at=0, loss=0.3)], status=EITHER),
    Cell("2", "20 ms delay each way", [every("link", "delayed", at=0, delay=0.02)]),
    Cell("2", "200 ms delay each way", [every("link", "delayed", at=0, delay=0.2)], status=EITHER),
    Cell("3", "all links off", [every("link", "off")], status=(1,)),
    Cell("4", "localizer raises", [plugin("localizer", "off")], status=(1,)),
    Cell("4", "localizer stuck", [plugin("localizer", "stuck")], status=EITHER),
    Cell("4", "localizer: one drone +1 m", [plugin("localizer", "wrong", agents="one")]),
    Cell("4", "localizer: one drone +2 m", [
        plugin("localizer", "wrong", agents="one", offset=[2, 0, 0])
    ]),
    Cell("4", "localizer NaN", [plugin("localizer", "garbage")], status=(1,)),
    Cell("4", "localizer 0.2 s late", [plugin("localizer", "delayed")], status=EITHER),
    Cell("4", "reports of one drone are NaN and random", [one("telemetry", "garbage")]),
    Cell("5", "two landmarks exchanged", [
        {"component": "tags", "mode": "wrong", "swap": True, "tags": ["mid_mid", "west_mid"]}
    ], SEEING, EITHER),
    Cell("5", "a landmark moved by 0.5 m", [
        {"component": "tags", "mode": "wrong", "offset": [0.5, 0, 0], "tags": ["mid_mid"]}
    ], SEEING, EITHER),
    Cell("5", "all landmarks covered", [{"component": "tags", "mode": "off"}], SEEING, EITHER),
    Cell("6", "cameras off", [every("camera", "off")], SEEING, EITHER),
    Cell("6", "cameras at 1 Hz", [every("camera", "slow", rate=1.0)], SEEING, EITHER),
    Cell("6", "images dark", [every("camera", "wrong", factor=0.05)], RENDERED, EITHER, most=10),
    Cell("6", "images cut off", [every("camera", "garbage")], RENDERED, EITHER, most=10),
    Cell("6", "images stuck", [every("camera", "stuck")], RENDERED, EITHER, most=10),
    Cell("7", "battery of one drone reports 3.0 V", [one("battery", "wrong", factor=0.75)]),
    Cell("7", "battery of one drone not reported", [one("battery", "off")]),
    Cell("7", "battery of one drone random", [one("battery", "garbage")]),
    Cell("7", "battery of one drone at 2 %", [one("battery", "wrong", charge=0.02)]),
    Cell("7", "battery of one drone empty", [one("battery", "wrong", charge=0.0)]),
    Cell("8", "a motor stops", [one("motor", "off")]),
    Cell("8", "thrust of one drone -20 %", [one("motor", "wrong", motors=[1, 2, 3, 4])],
         status=EITHER),
    Cell("8", "a motor fails in 30 % of ticks", [one("motor", "intermittent")], status=EITHER),
    Cell("9", "goal outside of the fence", changes={
        "mission": [{"takeoff": {}}, {"goto": {"agents": "cf1", "to": [4, 0, 0.6]}}]
    }, status=(2,), most=1),
    Cell("9", "flow sensor of one drone x 0.7", [one("flow", "wrong", factor=0.7)], status=EITHER),
    Cell("9", "flow sensor of one drone stuck", [one("flow", "stuck")], status=EITHER),
    Cell("9", "flow sensor of one drone x 0.7, with landmarks", [
        one("flow", "wrong", factor=0.7)
    ], SEEING, EITHER),
    Cell("9", "flow sensor of one drone stuck, with landmarks", [
        one("flow", "stuck")
    ], SEEING, EITHER),
    *(
        Cell("10", f"position of one drone spoofed by {d} m", [
            one("telemetry", "wrong", offset=[d, 0, 0])
        ], {"collisions": "record"}, EITHER, spoofed=True)
        for d in (0.2, 0.5, 1.0, 2.0)
    ),
    Cell("11", "avoider raises", [plugin("avoider", "off")], status=(1,)),
    Cell("11", "avoider raises in 30 % of ticks", [plugin("avoider", "intermittent")], status=(1,)),
    Cell("11", "avoider NaN", [plugin("avoider", "garbage")], status=(1,)),
    Cell("11", "avoider 10 x too fast", [plugin("avoider", "wrong", factor=10)], status=EITHER),
    Cell("11", "avoider stuck", [plugin("avoider", "stuck")], status=EITHER),
    Cell("12", "planner raises", [plugin("planner", "off")], status=(1,)),
    Cell("12", "planner NaN", [plugin("planner", "garbage")], status=(1,)),
    Cell("12", "planner 10 x too fast", [plugin("planner", "wrong", factor=10)], status=EITHER),
    Cell("12", "planner stuck", [plugin("planner", "stuck")], status=EITHER),
    Cell("13", "transport raises for 0.3 s", [plugin("transport", "off", **{"for": 0.3})],
         status=EITHER),
    Cell("13", "transport raises in every call", [plugin("transport", "off")], status=(1,)),
    Cell("16", "clock jumps by an hour", act=_jump(3600.0)),
    Cell("16", "clock jumps back by an hour", act=_jump(-3600.0)),
    Cell("16", "program stalls for 2 s", [every("ground_program", "delayed", delay=2.0)], most=5),
    Cell("17", "disk full", act=_fill_disk, status=(1,)),
    Cell("18", "pairs of rows 1 to 9", status=EITHER, pairs=True),
    Cell("19", "Ctrl-C", act=_signal(signal.SIGINT), status=(1,)),
    Cell("19", "SIGTERM", act=_signal(signal.SIGTERM), status=(1,)),
    Cell("19", "terminal closed (SIGHUP)", act=_signal(signal.SIGHUP), status=(1,)),
    Cell("20", "join of a drone with 3.0 V", [
        {"component": "battery", "mode": "wrong", "factor": 0.75, "agents": "cf4", "at": 0}
    ], JOINING, EITHER),
    Cell("20", "join of a drone that is not heard", [
        {"component": "link", "mode": "off", "agents": "cf4", "at": 1.0}
    ], JOINING, (1,)),
    Cell("21", "no fault while following", (), FOLLOWING),
    Cell("21", "upper one of a stacked pair +0.7 m in z", [
        plugin("localizer", "wrong", agents="cf2", offset=[0, 0, 0.7], at=8.0)
    ], STACKED, EITHER),
    Cell("21", "thrust of one drone -20 % while following", [
        one("motor", "wrong", motors=[1, 2, 3, 4])
    ], FOLLOWING, EITHER),
    Cell("21", "flow sensor of one drone x 0.7 while following", [
        one("flow", "wrong", factor=0.7)
    ], FOLLOWING, EITHER),
    Cell("21", "flow sensor of one drone stuck while following", [one("flow", "stuck")], FOLLOWING,
         EITHER),
    Cell("21", "pairs of rows 1 to 9 while following", (), FOLLOWING, EITHER, pairs=True),
)  # fmt: skip

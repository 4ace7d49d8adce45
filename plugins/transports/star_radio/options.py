"""Options of the transport ``radio``, and their schema."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from star_core.toolkit import fill_defaults, number, positive

if TYPE_CHECKING:
    from star_core import Registry

MOCAP_KIND: Final = "mocap_source"
"""Kind of the plugins that receive from motion-capture systems."""

PARAMETERS: Final[dict[str, Any]] = {
    "type": "object",
    "propertyNames": {
        "pattern": r"^[A-Za-z0-9_]+\.[A-Za-z0-9_]+$",
        "patternErrorMessage": "expected 'group.name'",
    },
    "additionalProperties": {"type": "number"},
}
"""Schema of firmware parameters."""

OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "absent": {
            "enum": ["refuse", "fly-without"],
            "default": "refuse",
            "description": "What to do when an agent cannot be reached: refuse to fly, or fly "
            "without it (needs the safety rule link_lost, which removes it from the mission).",
        },
        "response_timeout": positive(
            "Time to wait for an answer before an agent or a camera counts as absent, s.",
            default=2.0,
        ),
        "connect_timeout": positive(
            "Time within which an agent must be fully connected; after it, an "
            "agent that answers slowly counts as absent, s.",
            default=30.0,
        ),
        "setpoints": {
            "enum": ["velocity", "full-state"],
            "default": "velocity",
            "description": "Type of setpoint: 'velocity' sends a velocity and a yaw rate; "
            "'full-state' adds a moving position, at most 0.15 m from the agent, and a heading, "
            "for on-board controllers that track them (Mellinger: parameters: "
            "{stabilizer.controller: 2}). The firmware's PID tracks only the position, slowly.",
        },
        "report_period": {
            "type": ["number", "null"],
            "minimum": 0.01,
            "maximum": 0.1,
            "default": None,
            "description": "Period of an agent's state reports, s, in steps of 0.01; null selects "
            "0.01, or the shortest period that its dongle can carry.",
        },
        "guardian": {
            "type": "boolean",
            "default": True,
            "description": "Whether a process of its own owns the links: if the flight does not "
            "answer for 0.3 s its agents hover, after 1 s, or if it has ended, they land.",
        },
        "descent": {
            "type": "boolean",
            "default": True,
            "description": "Whether an agent that hears nothing after a take-off, or a trajectory "
            "that it flies on board, hovers for 3 s and then comes down by itself; otherwise it "
            "hovers until its battery is empty.",
        },
        "landing_timeout": number(
            "Time after the flight within which agents that may be in the air are "
            "still commanded to land, s. No battery lasts longer than the default.",
            minimum=0,
            default=600.0,
        ),
        "mode": {
            "enum": ["legacy", "inline"],
            "default": "legacy",
            "description": "Crazyradio mode that the packet budget assumes: 'legacy' (cflib up to "
            "0.1.34) or 'inline' (later cflib and dongle firmware 5.1).",
        },
        "udp": {
            "enum": ["sockets", "cflib"],
            "default": "sockets",
            "description": "Driver of UDP links: 'sockets' uses one thread for all of them; "
            "'cflib' uses cflib's driver, with two threads per link.",
        },
        "cache": {
            "type": ["string", "null"],
            "minLength": 1,
            "default": None,
            "description": "Folder in which firmware tables of contents are cached, so that the "
            "next flight connects sooner; null is star-swarm/radio in the user's cache folder.",
        },
        "reset": {
            "type": "boolean",
            "default": True,
            "description": "Whether to reset the on-board estimators when the links are opened, "
            "so that odometry starts at the agents' initial positions.",
        },
        "parameters": {
            **PARAMETERS,
            "default": {},
            "description": "Firmware parameters to set on every agent, by 'group.name', in the "
            "firmware's units.",
        },
        "agent_parameters": {
            "type": "object",
            "additionalProperties": PARAMETERS,
            "default": {},
            "examples": [{"cf2": {"ring.effect": 7}}],
            "description": "Firmware parameters of single agents, by the agent's name; they "
            "override those of 'parameters'.",
        },
        "stop": {
            "enum": ["motors", "lock"],
            "default": "motors",
            "description": "Effect of a stop: 'motors' switches the motors off; 'lock' also locks "
            "the agent until it is power-cycled (the firmware's emergency stop).",
        },
        "watchdog": {
            "type": "boolean",
            "default": False,
            "description": "Whether an agent that receives nothing for 1 s switches its motors "
            "off and locks (the firmware's emergency-stop watchdog). Each agent must be "
            "power-cycled after a flight with it.",
        },
        "cameras": {
            "type": "object",
            "additionalProperties": {
                "type": "string",
                "pattern": r"^[A-Za-z0-9.-]+(:[0-9]{1,5})?$",
                "description": "Address of one AI-deck: host or host:port.",
            },
            "default": {},
            "description": "Addresses of the AI-decks by agent: host or host:port; the default "
            "port is 5000.",
        },
        "flow_deck": {
            "type": "boolean",
            "default": True,
            "description": "Whether the drones carry Flow decks; without, localizer `onboard` "
            "takes their heights from the positioning system too.",
        },
        "camera_latency": number(
            "Latency from an exposure to the first packet of its image, s.",
            minimum=0,
            default=0.15,
        ),
        "mocap": {
            "type": ["object", "null"],
            "default": None,
            "description": "Motion-capture system that provides ground truth for recording, never "
            "for the flight: a source of localizer `mocap`.",
        },
        "broadcast": {
            "type": ["integer", "null"],
            "minimum": 0,
            "default": None,
            "description": "Number of an additional Crazyradio for broadcasts: commands that are "
            "the same for all agents or for one of the mission's groups (take off, land, stop, go "
            "to a position, follow a trajectory) and position corrections. null sends everything "
            "to each agent, as velocities always are. Broadcasts remove other drones on these "
            "channels from their groups, so share them with no other swarm. Not tried on "
            "hardware.",
        },
    },
}


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioOptions:
    """Options as `OPTIONS` describes them."""

    absent: str
    response_timeout: float
    connect_timeout: float
    setpoints: str
    report_period: float | None
    guardian: bool
    descent: bool
    landing_timeout: float
    mode: str
    udp: str
    cache: str | None
    reset: bool
    parameters: Mapping[str, float]
    agent_parameters: Mapping[str, Mapping[str, float]]
    stop: str
    watchdog: bool
    cameras: Mapping[str, str]
    flow_deck: bool
    camera_latency: float
    mocap: Mapping[str, Any] | None
    broadcast: int | None


def options_with(registry: Registry) -> dict[str, Any]:
    """Return `OPTIONS`, with those of the motion-capture sources that plugins offer."""
    source: Any = registry.kinds.get(MOCAP_KIND)
    if source is None:
        return OPTIONS
    system = {
        **OPTIONS["properties"]["mocap"],
        "required": ["source"],
        "additionalProperties": False,
        "properties": source.system_options(registry),
    }
    return OPTIONS | {"properties": OPTIONS["properties"] | {"mocap": system}}


UNCHANGED: Final = RadioOptions(**fill_defaults({"reset": False}, OPTIONS))
"""Those of commands that reset no estimator and set no parameter."""

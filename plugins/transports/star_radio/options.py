"""What a mission can say of the transport ``radio``."""

from __future__ import annotations

from typing import Any

OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "absent": {
            "enum": ["refuse", "fly-without"],
            "default": "refuse",
            "description": "What to do when an agent cannot be reached: refuse to fly, or fly "
            "without it, in a mission whose safety has the rule link_lost: that takes it out.",
        },
        "patience": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 2.0,
            "description": "After which time without any answer an agent is absent, and a camera "
            "is told to be, s.",
        },
        "deadline": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 30.0,
            "description": "After which time an agent that answers, but slowly, is absent, s.",
        },
        "setpoints": {
            "enum": ["velocity", "full-state"],
            "default": "velocity",
            "description": "What agents are steered with: 'velocity' is a velocity and a yaw rate; "
            "'full-state' adds a position that moves along, at most 0.15 m from where the agent "
            "is, and a heading, for on-board controllers that track them (Mellinger: parameters: "
            "{stabilizer.controller: 2}); the firmware's PID flies to the position only, slowly.",
        },
        "report": {
            "type": ["number", "null"],
            "minimum": 0.01,
            "maximum": 0.1,
            "default": None,
            "description": "Time between two reports of an agent's state, s, in steps of 0.01; "
            "null is 0.01, or as often as its dongle can carry.",
        },
        "mode": {
            "enum": ["legacy", "inline"],
            "default": "legacy",
            "description": "How Crazyradios are driven, for the budget of packets: 'legacy' as by "
            "cflib up to 0.1.34, 'inline' where a later one and the dongles' firmware (5.1) can.",
        },
        "udp": {
            "enum": ["sockets", "cflib"],
            "default": "sockets",
            "description": "How links over UDP are driven: 'sockets' by one thread for all of "
            "them, 'cflib' as the other kinds of links are, by a driver and two threads each.",
        },
        "cache": {
            "type": ["string", "null"],
            "minLength": 1,
            "default": None,
            "description": "Folder for the tables of contents of firmwares, so that the next "
            "flight connects sooner; null is star-swarm/radio in the user's cache folder.",
        },
        "reset": {
            "type": "boolean",
            "default": True,
            "description": "Whether estimators start anew when the links are opened, so that "
            "odometry begins where the agents stand.",
        },
        "parameters": {
            "type": "object",
            "propertyNames": {
                "pattern": r"^[A-Za-z0-9_]+\.[A-Za-z0-9_]+$",
                "patternErrorMessage": "expected 'group.name'",
            },
            "additionalProperties": {"type": "number"},
            "default": {},
            "description": "Parameters of the firmware to set in every agent, by 'group.name', in "
            "the firmware's own units.",
        },
        "stop": {
            "enum": ["motors", "lock"],
            "default": "motors",
            "description": "What a stop does: switch the motors off, or also lock the agent until "
            "it is switched off and on (the firmware's emergency stop).",
        },
        "watchdog": {
            "type": "boolean",
            "default": False,
            "description": "Whether an agent that hears nothing for 1 s switches its motors off "
            "and locks (the firmware's emergency-stop watchdog). After a flight with it each agent "
            "has to be switched off and on.",
        },
        "cameras": {
            "type": "object",
            "additionalProperties": {
                "type": "string",
                "pattern": r"^[A-Za-z0-9.-]+(:[0-9]{1,5})?$",
                "description": "Host, or host and port, of one AI-deck.",
            },
            "default": {},
            "description": "Where the AI-decks' images come from, by agent: host:port; without a "
            "port, 5000.",
        },
        "camera_latency": {
            "type": "number",
            "minimum": 0,
            "default": 0.15,
            "description": "Time from an exposure to the first packet of its image, s.",
        },
        "mocap": {
            "type": ["object", "null"],
            "required": ["type", "hostname"],
            "properties": {
                "type": {
                    "type": "string",
                    "description": "The system, as the package motioncapture names it: "
                    "'optitrack', 'vicon', 'qualisys', 'nokov', 'vrpn', ...",
                },
                "hostname": {"type": "string", "description": "Where it runs."},
                "names": {
                    "type": "object",
                    "additionalProperties": {"type": "string"},
                    "default": {},
                    "description": "Its name for each agent, where that is not the agent's own.",
                },
            },
            "additionalProperties": False,
            "default": None,
            "description": "Motion capture that tells recorders where the agents really are.",
        },
        "broadcast": {
            "type": ["integer", "null"],
            "minimum": 0,
            "default": None,
            "description": "Number of a Crazyradio, beside those of the links, with which orders "
            "that are the same for all or for one of the mission's groups (take off, land, stop, "
            "go to a place, follow a trajectory), and corrections, are sent to them at once; null "
            "sends to each, as velocities always are. Nobody else may broadcast on these channels: "
            "it takes their drones out of their groups. Not tried on hardware.",
        },
    },
}

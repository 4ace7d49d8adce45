#!/usr/bin/env python3
"""Lead the agents of a step `external` around a circle, and end the step.

Run it beside ``star run missions/external.yaml``: ``python examples/external_goals.py [PORT]``. It
needs only Python's standard library, and shows the whole protocol: a greeting, then state lines,
and one line in answer to each.
"""

import json
import math
import socket
import sys
import time

PORT = 5799
RADIUS = 0.8  # m
SPEED = 0.3  # m/s, along the circle
HEIGHT = 1.0  # m
LAPS = 2
TIMEOUT = 60.0  # s, of connecting


def connect(port: int) -> socket.socket:
    """Return a connection to `port`, as soon as a step listens there."""
    until = time.monotonic() + TIMEOUT
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)


def goals(names: list[str], flown: float) -> dict[str, dict[str, list[float]]]:
    """Return the goal of each agent after `flown` seconds: evenly spaced on the circle."""
    turn = SPEED / RADIUS  # rad/s
    found = {}
    for i, name in enumerate(names):
        angle = math.pi + turn * flown + math.tau * i / len(names)
        x, y = math.cos(angle), math.sin(angle)
        found[name] = {
            "position": [RADIUS * x, RADIUS * y, HEIGHT],
            "velocity": [-SPEED * y, SPEED * x, 0.0],
        }
    return found


def main() -> None:
    """Answer each state line with goals, and the last one with ``done``."""
    port = int(sys.argv[1]) if len(sys.argv) > 1 else PORT
    names: list[str] = []
    begun = None
    with connect(port) as connection, connection.makefile("rw", encoding="utf-8") as lines:
        for line in lines:
            message = json.loads(line)
            if "error" in message:
                raise SystemExit(message["error"])
            if "star" in message:  # the greeting
                names = message["agents"]
                continue
            begun = message["time"] if begun is None else begun
            flown = message["time"] - begun
            over = flown * SPEED >= LAPS * math.tau * RADIUS
            answer = {"done": True} if over else {"goals": goals(names, flown)}
            print(json.dumps(answer), file=lines, flush=True)


if __name__ == "__main__":
    main()

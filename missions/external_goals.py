#!/usr/bin/env python3
"""Leads the agents of a step `external` round a circle, and says when they are done.

Run it beside ``star run missions/external.yaml``: ``python external_goals.py [PORT]``. It needs
nothing but Python, and shows all there is to the protocol: a greeting, then state lines, and one
line in answer to each.
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
PATIENCE = 60.0  # s, to wait for a step that listens


def connect(port: int) -> socket.socket:
    """Return a connection to a step that listens on `port`, as soon as there is one."""
    until = time.monotonic() + PATIENCE
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            if time.monotonic() > until:
                raise
            time.sleep(0.1)


def goals(names: list[str], flown: float) -> dict[str, dict[str, list[float]]]:
    """Return where each agent should be after `flown` seconds: evenly round the circle."""
    turn = SPEED / RADIUS  # rad/s
    places = {}
    for i, name in enumerate(names):
        angle = math.pi + turn * flown + math.tau * i / len(names)
        x, y = math.cos(angle), math.sin(angle)
        places[name] = {
            "position": [RADIUS * x, RADIUS * y, HEIGHT],
            "velocity": [-SPEED * y, SPEED * x, 0.0],
        }
    return places


def main() -> None:
    """Answer every state line with goals, and the last with that it is done."""
    port = int(sys.argv[1]) if len(sys.argv) > 1 else PORT
    names: list[str] = []
    begun = None
    with connect(port) as connection, connection.makefile("rw", encoding="utf-8") as lines:
        for line in lines:
            said = json.loads(line)
            if "error" in said:
                raise SystemExit(said["error"])
            if "star" in said:  # the greeting
                names = said["agents"]
                continue
            begun = said["time"] if begun is None else begun
            flown = said["time"] - begun
            over = flown * SPEED >= LAPS * math.tau * RADIUS
            answer = {"done": True} if over else {"goals": goals(names, flown)}
            print(json.dumps(answer), file=lines, flush=True)


if __name__ == "__main__":
    main()

"""The summary of a flight whose program was killed, made of the events until then."""

from __future__ import annotations

from star_record.unfinished import summary_of

MANIFEST = {"mission": {"name": "hop"}}


def test_collisions_are_counted_by_what_was_hit() -> None:
    struck = {"agents": ["cf1"], "obstacle": "wall"}
    events = [
        {"kind": "collision", "time": time, "text": "", "details": details}
        for time, details in enumerate([struck, {"agents": ["cf1", "cf2"]}, struck])
    ]
    collisions = summary_of(MANIFEST, ["cf1", "cf2"], (), events)["collisions"]
    assert collisions == {"agent_agent": 1, "agent_obstacle": 2}

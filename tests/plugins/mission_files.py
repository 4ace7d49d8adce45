"""Missions in a room, as files."""

from __future__ import annotations

from pathlib import Path

PARTS = {
    "swarm": "{cf1: {start: [0, 0, 0]}, cf2: {start: [1, 0, 0]}}",
    "transport": "sim",
    "localizer": "flow",
    "planner": "straight",
    "avoider": "none",
}


def write_mission(
    folder: Path, steps: str, *, name: str = "flight", room: str = "", **parts: str
) -> Path:
    """Write a mission in a room of 6 m by 6 m, and return its path.

    Args:
        folder: Where the files of the mission and of its world, ``room.yaml``, are written.
        steps: A line each.
        name: Of the mission and of its file.
        room: What the room has beside its fence.
        parts: The parts of the mission that are not those of `PARTS`.
    """
    fence = "fence: {low: [-3, -3, 0], high: [3, 3, 3]}"
    (folder / "room.yaml").write_text(f"star: 1\nname: room\n{fence}\n{room}", encoding="utf-8")
    lines = [f"{key}: {value}\n" for key, value in {"world": "room.yaml", **PARTS, **parts}.items()]
    text = f"star: 1\nname: {name}\n{''.join(lines)}mission:\n{steps}"
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path

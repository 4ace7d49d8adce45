"""Names of measures for people: ``path_length_m.total`` is "path length, m"."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

LABELS: Final = {
    "collisions.agent_agent": "collisions between agents",
    "collisions.agent_obstacle": "collisions with obstacles",
    "corrected.fence": "corrections at the fence",
    "corrected.obstacle": "corrections at obstacles",
    "corrected.separation": "corrections to keep the separation",
    "corrected.speed": "corrections of speed",
    "flight_time_s": "flight time, s",
    "min_clearance_m": "least clearance, m",
    "min_separation_m": "closest approach, m",
    "outcome": "completed",
    "path_length_m.total": "path length, m",
    "position_mse_m2.mean": "mean squared position error, m²",
    "position_nees": "squared position error over its variance",
    "position_rmse_m": "position error (RMS), m",
    "position_worst_m": "largest position error, m",
    "targets.found": "targets found",
    "targets.total": "targets",
}
UNITS: Final = {
    "m": "m", "m2": "m²", "s": "s", "us": "µs", "v": "V", "deg": "°", "rad": "rad", "percent": "%",
}  # fmt: skip


def label(measure: str) -> str:
    """Return the name of a measure, with its unit.

    >>> label("min_separation_m"), label("waits.longest_s"), label("swirl_rate_rad.cf1")
    ('closest approach, m', 'waits: longest, s', 'swirl rate: cf1, rad')
    """
    if measure in LABELS:
        return LABELS[measure]
    words, unit = [], ""
    for word in measure.split("."):
        stem, _, suffix = word.rpartition("_")
        if stem and suffix in UNITS:
            word, unit = stem, UNITS[suffix]  # noqa: PLW2901 -- the rest of the word
        words.append(word.replace("_", " "))
    return ": ".join(words) + (f", {unit}" if unit else "")


def made(software: Mapping[str, Any], rows: Mapping[str, str]) -> dict[str, str]:
    """Return how a flight or a study was made, by names: command, `rows`, software, computer.

    Args:
        software: As `star_core.commands.software` returns it; records of others may lack any of it.
        rows: What is known besides.
    """
    packages = software.get("packages")
    versions = packages.items() if isinstance(packages, Mapping) else ()
    releases = [f"{name} {version}" for name, version in versions]  # that of STAR first
    commit = str(software.get("commit") or "")
    return {
        "command": str(software.get("command") or ""),
        **rows,
        "STAR": ", ".join([*releases[:1], *([f"commit {commit}"] if commit else [])]),
        "packages": ", ".join(releases[1:]),
        "computer": ", ".join(
            f"{name}{software[key]}"
            for key, name in (("python", "Python "), ("platform", ""))
            if key in software
        ),
    }


def file_name(title: str) -> str:
    """Return a name for the file of a figure.

    >>> file_name("Position error (m)")
    'position-error-m'
    """
    return "-".join(re.findall(r"[a-z0-9]+", title.lower())) or "figure"

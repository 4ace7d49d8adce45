"""The summary of a flight as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from star_core.commands import Source
from star_core.toolkit import number_at


def format_summary(summary: Mapping[str, Any], folder: Path | None) -> str:
    """Return a summary as text."""
    collisions = summary["collisions"]
    factor, apart = summary["realtime_factor"], summary["min_separation_m"]
    rmse, clear = number_at(summary, "position_rmse_m"), summary["min_clearance_m"]
    flown = number_at(summary, "path_length_m.total")
    by = "" if summary["distances_from"] == "ground_truth" else " (estimated positions)"
    rows = [
        (
            "flight",
            f"{summary['flight_time_s']:.1f} s with {_many(summary['agents'])}"
            + (f", {factor:.{0 if factor >= 1 else 1}f} times real time" if factor else ""),
        ),
        ("slowest plugin", _slowest(summary)),
        *(("slow ticks", text) for text in _slow(summary["slow_ticks"])),
        (
            "collisions",
            f"{collisions['agent_agent']} between agents, "
            f"{collisions['agent_obstacle']} with obstacles{by}",
        ),
        ("closest approach", f"{apart:.2f} m{by}" if apart is not None else ""),
        ("corrected", _corrected(summary["corrected"])),
        ("late ticks", _late(summary["late_ticks"], summary["latest_tick_s"])),
        ("clearance", f"{clear:.2f} m at least{by}" if clear is not None else ""),
        ("position error", f"{rmse:.3f} m RMS" if rmse is not None else ""),
        ("targets", _targets(summary["targets"])),
        ("flown", f"{flown:.1f} m in all" if flown is not None else ""),
        ("record", str(folder) if folder and (folder / "summary.json").exists() else ""),
    ]
    head = f"{summary['mission']}: {summary['outcome']}"
    head += f": {summary['reason']}" if summary["reason"] else ""
    return "\n".join([head, *(f"  {label:<18}{text}" for label, text in rows if text)])


def _slowest(summary: Mapping[str, Any]) -> str:
    """Return the plugin that took most of a flight slower than real time, if there is one."""
    factor, wall_time = summary["realtime_factor"], summary["wall_time_s"]
    if factor is None or factor >= 1 or not summary["compute_s"]:
        return ""
    spent, plugin = max(
        ((spent, plugin) for plugin, spent in summary["compute_s"].items() if not _own(plugin)),
        default=(0.0, ""),
    )
    return f"{plugin}, {spent:.1f} of {wall_time:.1f} s" if spent > wall_time / 2 else ""


def _own(plugin: str) -> bool:
    """Return whether a plugin is one of STAR's own observers."""
    kind, _, source = plugin.partition(" ")
    return kind == "observer" and Source(source).own


def _slow(slow_ticks: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield every plugin that took too long for ticks of a simulation."""
    for plugin, slow in slow_ticks.items():
        yield f"{slow['ticks']} of {plugin}, the slowest took {slow['longest_s']:.1f} s"


def _corrected(corrected: Mapping[str, int]) -> str:
    """Return the numbers of corrected setpoints by reason, if there are any."""
    counts = [f"{count} for {why}" for why, count in corrected.items() if count]
    return f"setpoints: {', '.join(counts)}" if counts else ""


def _late(ticks: int, worst: float) -> str:
    """Return the number of late ticks, and the greatest lateness, s, if there are any."""
    return f"{ticks}, by {worst:.2f} s at most" if ticks else ""


def _targets(targets: Mapping[str, Any]) -> str:
    """Return the number of targets found, if there are any."""
    total = targets["total"]
    return f"{targets['found']} of {total} found" if total else ""


def _many(agents: Sequence[str]) -> str:
    return "1 agent" if len(agents) == 1 else f"{len(agents)} agents"

"""Draws the calls of one tick as a sequence diagram, ``docs/pictures/tick.svg``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final
from xml.sax.saxutils import escape

LOOP, VEHICLES, TRANSPORT, LOCALIZER, STEPS, PLANNER, AVOIDER, FILTER, OBSERVERS = range(9)
LINES: Final = (
    "ControlLoop", "VehicleInterface", "transport", "localizer", "StepExecutor", "planner",
    "avoider", "SafetyFilter", "observers",
)  # fmt: skip
PLUGINS: Final = {TRANSPORT, LOCALIZER, PLANNER, AVOIDER, OBSERVERS}

CALLS: Final = (
    (LOOP, VEHICLES, "receive", "Telemetry"),
    (VEHICLES, TRANSPORT, "wait, receive", "Telemetry"),
    (LOOP, VEHICLES, "locate", "Estimate"),
    (VEHICLES, LOCALIZER, "locate", "Estimate"),
    (VEHICLES, TRANSPORT, "correct", ""),
    (LOOP, VEHICLES, "track", "Health"),
    (LOOP, LOOP, "safety rules", ""),
    (LOOP, STEPS, "step, of each running step", "goals, commands, status"),
    (LOOP, LOOP, "reserves", ""),
    (LOOP, VEHICLES, "send_command", ""),
    (VEHICLES, TRANSPORT, "command", ""),
    (LOOP, LOOP, "landings", ""),
    (LOOP, PLANNER, "plan", "Plan"),
    (LOOP, VEHICLES, "setpoint", "Setpoint"),
    (LOOP, AVOIDER, "avoid", "Setpoint"),
    (LOOP, FILTER, "filter", "Setpoint"),
    (LOOP, VEHICLES, "send", "Setpoint that was sent"),
    (VEHICLES, TRANSPORT, "send", "Setpoint"),
    (LOOP, OBSERVERS, "star_ticked", ""),
)
"""Caller, object called, methods, and what the last of them returns."""

COLUMN, ROW, TOP, MARGIN = 122, 26, 54, 62
WIDTH: Final = 2 * MARGIN + COLUMN * (len(LINES) - 1)
HEIGHT: Final = TOP + ROW * (len(CALLS) + 1)


def diagram() -> str:
    """Return the picture, SVG."""
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="Helvetica, Arial, sans-serif" font-size="12" role="img">',
        "<title>One tick: calls from the top to the bottom</title>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        *_lifelines(),
        *(line for row, call in enumerate(CALLS) for line in _call(TOP + ROW * (row + 1), *call)),
        "</svg>",
        "",
    ])  # fmt: skip


def _lifelines() -> Iterator[str]:
    for i, name in enumerate(LINES):
        x, color = MARGIN + COLUMN * i, "#e8eefc" if i in PLUGINS else "#eeeeee"
        yield (
            f'<rect x="{x - 56}" y="12" width="112" height="26" rx="4" fill="{color}" '
            'stroke="#999"/>'
        )
        yield f'<text x="{x}" y="29" text-anchor="middle">{name}</text>'
        yield f'<path d="M{x} 38V{HEIGHT}" stroke="#bbb" stroke-dasharray="4 4"/>'


def _call(y: int, caller: int, callee: int, call: str, result: str) -> Iterator[str]:
    start, end = (MARGIN + COLUMN * i for i in (caller, callee))
    text = escape(f"{call} → {result}" if result else call)
    if caller == callee:
        yield f'<path d="M{start} {y - 8}h14v10h-8" fill="none" stroke="#333"/>'
        yield f'<path d="M{start + 2} {y + 2}l7-3.5v7z" fill="#333"/>'
        yield f'<text x="{start + 20}" y="{y + 2}">{text}</text>'
        return
    yield f'<path d="M{start} {y}H{end - 6}" stroke="#333"/>'
    yield f'<path d="M{end} {y}l-7-3.5v7z" fill="#333"/>'
    yield (
        f'<text x="{start + 6}" y="{y - 5}" stroke="white" stroke-width="3" '
        f'paint-order="stroke">{text}</text>'
    )

"""A lens in words, and as a mission has it."""

from __future__ import annotations

from typing import Final

from star_calibrate.lens import Lens
from star_calibrate.views import Views

ENOUGH: Final = 0.75  # of the picture's cells: less leaves its edges to guesswork


def as_text(lens: Lens, views: Views) -> str:
    """Return what a user should know before trusting a lens, several lines."""
    used = {seen.name: f"{seen.error:.3f} px at {seen.distance:.2f} m" for seen in lens.used}
    left_out = {seen.name: f"left out: {seen.error:.3f} px" for seen in lens.left_out}
    lines = [
        *(f"{view.name}: {(used | left_out)[view.name]}" for view in views.found),
        *(f"{name}: no board" for name in views.without),
        f"RMS {lens.error:.3f} px over {len(lens.used)} pictures",
        *(
            f"{name} {value:.2f} +- {deviation:.2f} px"
            for name, value, deviation in zip(
                ("fx", "fy", "cx", "cy"), lens.matrix, lens.deviation, strict=True
            )
        ),
        f"corners in {lens.covered:.0%} of the picture",
    ]
    if lens.covered < ENOUGH:
        lines.append("the lens is not known where no corner was: add pictures with the board there")
    return "\n".join(lines) + "\n"


def as_yaml(lens: Lens, name: str) -> str:
    """Return the block ``cameras`` of a mission, with one camera of that name."""
    matrix = ", ".join(f"{value:.2f}" for value in lens.matrix)
    distortion = ", ".join(f"{value:.5f}" for value in lens.distortion)
    return (
        f"# Calibrated by {len(lens.used)} pictures, {lens.error:.3f} px RMS. Add this to a"
        f" mission, and\n# `camera: {name}` to its agents; its position and pitch_deg are an"
        " AI-deck's unless\n# they are given.\n"
        "cameras:\n"
        f"  {name}:\n"
        f"    width: {lens.width}\n"
        f"    height: {lens.height}\n"
        f"    matrix: [{matrix}]\n"
        f"    distortion: [{distortion}]\n"
    )

"""A lens in words, and as missions have it."""

from __future__ import annotations

from pathlib import Path
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
    """Return the file of a camera, which missions name."""
    matrix = ", ".join(f"{value:.2f}" for value in lens.matrix)
    distortion = ", ".join(f"{value:.5f}" for value in lens.distortion)
    return (
        f"# A camera, calibrated by {len(lens.used)} pictures of a chessboard: {lens.error:.3f} px"
        " RMS.\n"
        "# Its position, pitch_deg and rate are an AI-deck's unless they are given, here or in a"
        " mission.\n"
        "star: 1\n"
        f'name: "{name}"\n'
        f"width: {lens.width}\n"
        f"height: {lens.height}\n"
        f"matrix: [{matrix}]\n"
        f"distortion: [{distortion}]\n"
    )


def as_lines(name: str, out: Path) -> str:
    """Return the two lines by which a mission has the camera in a file.

    The mission is beside it, or beside the folder ``cameras`` that it is in.

    >>> print(as_lines("mine", Path("missions/cameras/mine.yaml")), end="")
    to use it, add these two lines to a mission in 'missions':
      cameras: {mine: {file: cameras/mine.yaml}}
      swarm: {cf1: {camera: mine, ...}}
    """
    folder = out.parent.parent if out.parent.name == "cameras" else out.parent
    return (
        f"to use it, add these two lines to a mission in {str(folder)!r}:\n"
        f"  cameras: {{{name}: {{file: {out.relative_to(folder).as_posix()}}}}}\n"
        f"  swarm: {{cf1: {{camera: {name}, ...}}}}\n"
    )

"""Lists the missions that come with STAR."""

from __future__ import annotations

from itertools import groupby

from star_core.commands.columns import columns
from star_core.mission_file.input_file import description, shipped


def as_text() -> str:
    """Return names and descriptions, by folder."""
    files = shipped()
    lines = []
    for folder, names in groupby(files, key=lambda name: name.rpartition("/")[0]):
        lines.append(folder or "missions")
        lines += [*columns((name, description(files[name])) for name in names), ""]
    return "\n".join(
        [*lines, f"`star run NAME` flies one. To copy: {files['first_flight'].parent}"]
    )

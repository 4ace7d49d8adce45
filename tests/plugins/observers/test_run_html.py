"""A recorded flight in a Python session and in a notebook."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from star_core import Registry, fly, load, read_run
from star_record.read_record import RecordedRun


def test_a_run_is_shown_in_a_line_and_in_a_picture(hop: Path) -> None:
    registry = Registry()
    fly(load(hop / "hop.yaml", registry), registry, folder=hop / "a<b")
    run = read_run(hop / "a<b")
    assert isinstance(run, RecordedRun)
    text = repr(run)
    assert text.startswith("<Run 'hop', outcome: completed, flight: ")
    assert text.endswith(f"in {str(hop / 'a<b')!r}>")
    assert len(text) < 300
    page = ET.fromstring(f"<body>{run._repr_html_()}</body>")  # noqa: S314 -- made here
    assert page.findtext("table/tr/td") == "completed"
    tracks = page.findall("svg/g/polyline")
    assert [track.findtext("title") for track in tracks] == ["cf1", "cf2"]
    x, y, _z = run.arrays["truth_position"][0, 0]
    assert tracks[0].attrib["points"].startswith(f"{x:.3f},{-y:.3f} ")

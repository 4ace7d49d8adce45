"""Tables on terminals of several widths."""

from __future__ import annotations

import re

from star_core.toolkit import ReportTable
from star_core.toolkit.table_text import table_lines

TABLE = ReportTable(
    title="Means",
    note="Mean ± standard deviation.",
    names=["avoider", "world"],
    measures=[("n", ""), ("closest approach, m", "min_separation_m"), ("flight time, s", "t")],
    rows=[
        ["orca", "ideal", "5", "0.706 ± 0.0928 [0.591, 0.821]", "14.3 ± 0.057 [14.2, 14.3]"],
        ["orca", "default with lamps", "5", "0.671", "-"],
    ],
)


def text(width: int | None) -> str:
    return "\n".join(table_lines(TABLE, width))


def test_a_table_has_one_line_a_row_in_a_pipe() -> None:
    heads, _, *rows = text(None).splitlines()[2:]
    assert re.split(r" {2,}", heads)[2:] == ["n", "closest approach, m", "flight time, s"]
    assert "5  0.706 ± 0.0928 [0.591, 0.821]  14.3 ± 0.057 [14.2, 14.3]" in rows[0]
    assert len(rows) == 2


def test_a_narrow_terminal_has_intervals_below_means() -> None:
    assert (
        text(70)
        == """\
Mean ± standard deviation.

                                       closest  flight time,
avoider  world               n     approach, m             s
────────────────────────────────────────────────────────────
orca     ideal               5  0.706 ± 0.0928  14.3 ± 0.057
                                [0.591, 0.821]  [14.2, 14.3]
orca     default with lamps  5           0.671             -"""
    )


def test_measures_that_do_not_fit_follow_below() -> None:
    lines = text(45).splitlines()
    assert max(map(len, lines)) <= 45
    heads = [line for line in lines if line.startswith("avoider")]
    assert len(heads) == 2
    assert "[0.591, 0.821]" in text(45)
    assert "[14.2, 14.3]" in text(45)


def test_names_stay_whole_beside_measures_with_hyphens() -> None:
    head = ("agent-obstacle collisions", "")
    table = ReportTable("", "", ["scenario", "positions"], [head], [["crossing", "bounded", "0"]])
    assert "scenario  positions  collisions" in list(table_lines(table, 34))

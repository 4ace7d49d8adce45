"""The steps of a mission as a Mermaid flowchart."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

from star_core.toolkit import shortlist
from star_explain.plan import agent_names, alike, ending, how, times
from star_explain.results import Group, Part, StepResult
from star_explain.words import options, own_options

INDENT = "  "


def mermaid(name: str, result: Group) -> str:
    """Return a flowchart of a mission's steps, from top to bottom."""
    chart = _Chart()
    chart.line(f"start([{label(name)}])")
    end = chart.sequence(result, "start")
    chart.line("done([done])")
    chart.line(f"{end} --> done")
    return "\n".join(["flowchart TD", *chart.lines]) + "\n"


def label(*rows: str) -> str:
    """Return rows of text as a label, escaped.

    >>> label('say "no"', "a#b")
    '"say #quot;no#quot;<br/>a#35;b"'
    """
    escapes = {"#": "#35;", '"': "#quot;", "<": "#lt;", ">": "#gt;", "&": "#amp;", "`": "#96;"}
    return '"' + "<br/>".join("".join(escapes.get(c, c) for c in row) for row in rows) + '"'


class _Chart:
    """Collects the lines of a chart."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._number = count(1)
        self._depth = 1

    def line(self, text: str) -> None:
        self.lines.append(f"{INDENT * self._depth}{text}")

    def sequence(self, group: Group, before: str) -> str:
        """Draw steps in sequence after a node; return the last node."""
        for part in group.parts:
            if isinstance(part, Group) and part.kind == "reaction":
                self._framed(part.title, part, self._node("([{}])", "at any time"))
            else:
                before = self._part(part, group, before)
        return before

    def _part(self, part: Part, above: Group, before: str) -> str:
        if isinstance(part, StepResult):
            node = self._node("[{}]", *_rows(part))
            self.line(f"{before} --> {node}")
            return node
        same = alike(part)
        if same is not None:
            return self._framed(f"each by itself: {shortlist(agent_names(part))}", same, before)
        if not part.at_once:
            often = f"{part.times} times" if part.times > 1 else how(part, above)
            return self._framed(often, part, before)
        fork = self._node("{{{{{}}}}}", how(part, above) if part.title else "at once")
        self.line(f"{before} --> {fork}")
        ends = [self._part(branch, part, fork) for branch in part.parts]
        join = self._node("{{{{{}}}}}", "done" if part.title else "all done")
        if part.title and len(part.parts) == 1:
            self.line(f"{fork} -- otherwise --> {join}")
        for end in ends:
            self.line(f"{end} --> {join}")
        return join

    def _framed(self, title: str, group: Group, before: str) -> str:
        """Draw steps in a frame."""
        frame = f"g{next(self._number)}"
        self.line(f"subgraph {frame} [{label(title)}]")
        self._depth += 1
        first = len(self.lines)
        end = self.sequence(group, before)
        self._depth -= 1
        self.line("end")
        entering = [line for line in self.lines[first:-1] if line.strip().startswith(f"{before} -")]
        for line in entering:  # an arrow from outside would pull its node into the frame
            self.lines.remove(line)
            self.line(line.strip())
        return end

    def _node(self, shape: str, *rows: str) -> str:
        name = f"n{next(self._number)}"
        self.line(name + shape.format(label(*rows)))
        return name


def _rows(result: StepResult) -> Iterator[str]:
    yield f"{result.action.verb} {shortlist(result.agents) or 'no agents'}"
    if written := own_options(result.action):
        yield options(written)
    yield times(result)
    yield from ending(result)
    for fault in (result.fault, *result.blocked):
        if fault:
            yield f"! in the rehearsal: {fault}"

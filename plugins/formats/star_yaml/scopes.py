"""Names for values: ``$name``, ``$(...)`` and ``each: {with: ...}`` replaced by their values.

Values keep the locations at which they are written. A value of a name is located where it is
written and then, after a colon, where it is used.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from star_core import InputError
from star_core.formats import Mark, Value, coded, shown
from star_core.toolkit import suggestion
from star_yaml.document import mapped
from star_yaml.expressions import OPENING, ExpressionError, evaluate
from star_yaml.schema import SIGN, is_parameter

MAX_VALUES: Final = 200_000  # in all files of a mission with the values of names in their places
_COORDINATES: Final = 3
"""Values in a list whose locations are listed in the list's own: a point has no more."""


class _NotKnown(Exception):  # noqa: N818 -- no error: the parameter of a file that nothing includes
    """A value that is not known, or is reported elsewhere."""


@dataclass
class Findings:
    """What is found where names are replaced.

    Attributes:
        problems: One line each, with its location.
        count: Number of values so far.
    """

    problems: list[str] = field(default_factory=list)
    count: int = 0

    def report(self, mark: Mark, message: str, code: str) -> None:
        """Add a problem."""
        self.problems.append(coded(f"{mark}: {message}", code))

    def made(self, mark: Mark) -> None:
        """Count a value.

        Raises:
            InputError: There are too many.
        """
        self.count += 1
        if self.count > MAX_VALUES:
            message = f"the names from here on stand for more than {MAX_VALUES} values"
            raise InputError(f"{mark}: {message}", "unreadable-file")


class Scope:
    """Values by name, and those of a scope around it.

    Args:
        values: By name. One that is a parameter is not known, and is not replaced.
        findings: Receive the problems.
        unknown: Returns what is wrong with a name that has no value, and the code.
        outer: The scope around it.

    Attributes:
        names: That have values, those of the scope around it included.
    """

    def __init__(
        self,
        values: Mapping[str, Value],
        findings: Findings,
        unknown: Callable[[str, Collection[str]], tuple[str, str]],
        outer: Scope | None = None,
    ) -> None:
        self._values = dict(values)
        self._findings = findings
        self._unknown = unknown
        self._outer = outer
        self.names: tuple[str, ...] = (*values, *(outer.names if outer else ()))

    @classmethod
    def of_parameters(cls, values: Mapping[str, Value], findings: Findings) -> Scope:
        """Return the scope of a file of steps."""
        return cls(values, findings, _unknown_parameter)

    @classmethod
    def of_mission(cls, let: Value | None, findings: Findings) -> tuple[Scope, dict[str, Value]]:
        """Return the scope of a mission, and the names of its ``let`` with their values.

        Raises:
            InputError: The ``let`` is no map.
        """
        written = {} if let is None else let.map()
        scope = _Let(written, findings, _unknown_name)
        return scope, scope.filled()

    def fill(self, value: Value) -> Value:
        """Return a value in which every known name is replaced."""
        self._findings.made(value.location)
        if _has_values_of_agents(value):
            return self._expanded(value)
        if isinstance(value.data, list):
            return self._list(value)
        if isinstance(value.data, str) and value.data.startswith(OPENING):
            return self._computed(value)
        return self._replaced(value) if is_parameter(value.data) else mapped(value, self.fill)

    def find(self, name: str, at: Mark) -> Value:
        """Return the value of a name that is used somewhere.

        Raises:
            _NotKnown: It has none; that is reported if it should have.
        """
        if name not in self.names:
            if name.startswith("{"):  # as in a shell
                wrong = f"write `$({name.strip('{} ')})`, in parentheses", "invalid-expression"
            else:
                wrong = self._unknown(name, self.names)
            self._findings.report(at, *wrong)
            raise _NotKnown
        if name not in self._values and self._outer is not None:
            return self._outer.find(name, at)
        value = self._values[name]
        if is_parameter(value.data):
            raise _NotKnown
        return value

    def _replaced(self, value: Value) -> Value:
        """Return the value that a name stands for, if it is known."""
        try:
            stands_for = self.find(str(value.data).removeprefix(SIGN), value.location)
        except _NotKnown:
            return value
        used = self._used(stands_for, value.location)
        in_list = value.key == value.mark
        key = used.mark if in_list or isinstance(used.data, dict) else value.key
        return replace(used, key=key)

    def _list(self, value: Value) -> Value:
        items, written = [], []
        for item in value.children().values():
            items.append(self.fill(item))
            replaced = is_parameter(item.data) and not str(item.data).startswith(OPENING)
            if replaced and not is_parameter(items[-1].data) and not items[-1].children():
                name = str(item.data).removeprefix(SIGN)
                written.append(str(self.find(name, item.location).location))
        if not written:
            return Value(items, value.mark, value.key)
        text = ": ".join([*dict.fromkeys(written)][:_COORDINATES])
        mark = value.location
        return Value(items, mark._replace(source=f"{text}: {mark.source}"), value.key)

    def _computed(self, value: Value) -> Value:
        """Return the value of an expression, at the location of the expression."""
        text, mark = str(value.data), value.mark
        if not text.endswith(")"):
            why = "')' is missing at the end; put an expression that has a comma in quotes"
            self._findings.report(_within(mark, len(text)), why, "invalid-expression")
            return value
        try:
            result = evaluate(text[len(OPENING) : -1], lambda *name: self._number(mark, *name))
        except _NotKnown:
            return value
        except ExpressionError as error:
            at = _within(mark, len(OPENING) + error.offset)
            self._findings.report(at, error.message, error.code)
            return value
        return replace(value, data=result)

    def _number(self, mark: Mark, name: str, offset: int) -> float:
        """Return the value of a name in an expression."""
        data = self.find(name, _within(mark, len(OPENING) + offset)).data
        if isinstance(data, bool) or not isinstance(data, int | float):
            raise ExpressionError(
                f"{name!r} is {shown(data)}, expected a number", offset, "wrong-type"
            )
        return data

    def _expanded(self, step: Value) -> Value:
        """Return a step ``each`` with values by agent as one ``each`` for each of them."""
        each = step.need("each")
        options, by_agent = each.map(), each.need("with").map()
        if "agents" in options:
            why = "'with' names the agents of this 'each'; remove 'agents'"
            self._findings.report(options["agents"].key, why, "option-conflict")
        names = dict.fromkeys(name for values in by_agent.values() for name in values.map())
        branches = []
        for agent, values in by_agent.items():
            if lacking := [repr(name) for name in names if name not in values.map()]:
                why = f"{agent!r} has no value for {', '.join(lacking)}, as others have"
                self._findings.report(values.location, why, "missing-option")
            own = {name: self.fill(value) for name, value in values.map().items()}
            own |= {
                name: replace(values, data=f"{SIGN}{name}") for name in names if name not in own
            }
            inner = Scope(own, self._findings, self._unknown, self)
            content = {key: item for key, item in options.items() if key not in {"with", "agents"}}
            content = {key: inner.fill(item) for key, item in content.items()}
            content["agents"] = Value(agent, values.key, values.key)
            branches.append(replace(step, data={"each": replace(each, data=content)}))
        return replace(step, data={"parallel": replace(each, data=branches)})

    def _used(self, value: Value, at: Mark) -> Value:
        """Return a value that is used elsewhere, with both locations."""
        self._findings.made(at)
        data = mapped(value, lambda item: self._used(item, at)).data
        return Value(data, value.location.used_at(at), value.key.used_at(at))


class _Let(Scope):
    """The names of a mission, whose values may use each other in any order."""

    _open: tuple[str, ...] = ()  # names whose values are being replaced
    _waiting: dict[str, Value]  # values in which no name is replaced yet

    def filled(self) -> dict[str, Value]:
        """Return all values; an empty one, which the schema refuses, is empty."""
        self._waiting = dict(self._values)
        empty = {name: value for name, value in self._values.items() if value.data is None}
        for name, value in self._values.items():
            self._complete(name, value.location)
        return self._values | empty

    def find(self, name: str, at: Mark) -> Value:
        self._complete(name, at)
        return super().find(name, at)

    def _complete(self, name: str, at: Mark) -> None:
        if name in self._open:
            between = ", ".join(map(repr, self._open[self._open.index(name) + 1 :]))
            by_way = f", by way of {between}" * bool(between)
            self._findings.report(at, f"{name!r} stands for itself{by_way}", "circular-name")
            raise _NotKnown
        if (value := self._waiting.pop(name, None)) is None:
            return
        self._open += (name,)
        before = len(self._findings.problems)
        filled = self.fill(value)
        self._open = self._open[:-1]
        if filled.data is None or len(self._findings.problems) > before:  # which is reported once
            filled = replace(filled, data=f"{SIGN}{name}")
        self._values[name] = filled


def parameters(value: Value) -> Iterator[Mark]:
    """Yield the locations of parameters in a value, itself included."""
    if is_parameter(value.data):
        yield value.location
    for inner in value.children().values():
        yield from parameters(inner)


def _has_values_of_agents(value: Value) -> bool:
    """Whether this is a step ``each`` with values by agent."""
    if not isinstance(value.data, dict) or [*value.data] != ["each"]:
        return False
    by_agent = value.need("each").child("with")
    return (
        by_agent is not None
        and isinstance(by_agent.data, dict)
        and bool(by_agent.data)
        and all(isinstance(values.data, dict) for values in by_agent.data.values())
    )


def _within(mark: Mark, offset: int) -> Mark:
    """Return the mark of a character of a value; of what a command line sets, that of the value."""
    return mark._replace(column=mark.column + offset) if mark.line else mark


def _unknown_parameter(name: str, values: Collection[str]) -> tuple[str, str]:
    return f"no parameter named {name!r}{suggestion(name, values)}", "unknown-parameter"


def _unknown_name(name: str, values: Collection[str]) -> tuple[str, str]:
    hint = suggestion(name, values, "there are") or f"; write `let: {{{name}: ...}}` at the top"
    return f"no value is named {name!r}{hint}", "unknown-name"

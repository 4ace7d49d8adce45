"""Whose fault it is when a plugin raises."""

from __future__ import annotations

import asyncio
import logging
import sys

import pytest

from star_core import ContractError, InputError, PluginError
from star_core.plugin_support.guard import PluginGuard, PluginTimeout, Strikes

PLUGIN = "planner 'mine' (my-dist 1.0:mine)"


def blamed(error: BaseException) -> PluginError:
    with pytest.raises(PluginError) as caught, PluginGuard(PLUGIN):
        raise error
    return caught.value


def test_the_place_is_that_of_the_innermost_call() -> None:
    with pytest.raises(PluginError) as caught, PluginGuard(PLUGIN):
        int("three", base=99)  # raised in C: the line here is the innermost there is
    cause = caught.value.__cause__
    assert cause is not None
    assert cause.__traceback__ is not None
    assert str(caught.value).endswith(
        f"({__file__}:{cause.__traceback__.tb_lineno}) [plugin-failed]"
    )


def test_errors_are_reported_with_kind_and_the_plugins_line() -> None:
    def plugin() -> None:
        raise ZeroDivisionError("by nought")

    with pytest.raises(PluginError) as caught, PluginGuard(PLUGIN):
        plugin()
    line = plugin.__code__.co_firstlineno + 1
    text = f"{PLUGIN}: ZeroDivisionError: by nought ({__file__}:{line}) [plugin-failed]"
    assert str(caught.value) == text
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


@pytest.mark.parametrize("error", [ContractError("no rows"), InputError(["a", "b"])])
def test_what_star_itself_reports_needs_no_place(error: Exception) -> None:
    assert str(blamed(error)) == f"{PLUGIN}: {error}"


def test_a_plugin_that_ends_the_process_is_blamed() -> None:
    with pytest.raises(PluginError) as caught, PluginGuard(PLUGIN):
        sys.exit("bye")
    assert str(caught.value).startswith(f"{PLUGIN}: SystemExit: bye (")


@pytest.mark.parametrize(
    "error", [BaseException("bye"), asyncio.CancelledError("bye"), GeneratorExit("bye")]
)
def test_a_plugin_is_blamed_for_all_that_it_raises(error: BaseException) -> None:
    assert str(blamed(error)).startswith(f"{PLUGIN}: {type(error).__name__}: bye (")


def test_an_interrupt_is_nobodys_fault() -> None:
    with pytest.raises(KeyboardInterrupt), PluginGuard(PLUGIN):
        raise KeyboardInterrupt


def test_the_traceback_is_logged_on_demand(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, logger="star_core.plugin_support.guard")
    blamed(KeyError("gain"))
    (record,) = caplog.records
    assert record.getMessage() == f"{PLUGIN} raised"
    assert record.exc_info


def test_one_problem_may_be_given_as_text() -> None:
    assert InputError("no such file [invalid-input]").problems == ("no such file [invalid-input]",)
    assert str(InputError(["a", "b"])) == "a [invalid-input]\nb [invalid-input]"


def test_an_error_of_many_lines_is_reported_on_one() -> None:
    with pytest.raises(PluginError, match="a plugin: ValueError: a b "), PluginGuard("a plugin"):
        raise ValueError("a\nb")


def test_two_failures_of_each_plugin_are_tolerated_in_flight() -> None:
    strikes, failure = Strikes(3), PluginError("boom")
    strikes.begin_tick(in_flight=True)
    answers = [strikes.tolerates(plugin, failure) for plugin in ("one", "other", "one", "one")]
    assert answers == [True, True, True, False]
    first, *_rest = strikes.drain()
    assert first == "all agents brake: boom (failure 1; at 3 all land)"
    assert strikes.drain() == []


def test_a_plugin_that_hangs_in_flight_is_not_tolerated() -> None:
    strikes = Strikes(3)
    strikes.begin_tick(in_flight=True)

    def expire() -> None:
        raise PluginTimeout("no result after 1 s")

    with pytest.raises(PluginError) as caught, PluginGuard(PLUGIN):
        expire()
    assert not strikes.tolerates(PLUGIN, caught.value)

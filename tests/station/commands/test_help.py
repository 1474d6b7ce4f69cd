"""What the help of each command shows, a person can type: no types of Python, and every example is taken."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from typing import Any

import pytest
from typer.main import get_command

from station.cli import app, main

NUMBERS = {"INTEGER": "1", "NUMBER": "1"}
EXAMPLE = re.compile(r"(?<=: )-?\d+(?: -?\d+)+(?=\.)")


@functools.cache
def program() -> Any:
    """The command line, built once."""
    return get_command(app)


def commands(command: Any = None, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    command = command or program()
    if not hasattr(command, "commands"):
        yield path
    for name in getattr(command, "commands", {}):
        yield from commands(command.commands[name], (*path, name))


COMMANDS = tuple(commands())


@functools.cache
def command_of(path: tuple[str, ...]) -> Any:
    """As the program finds it: with the names that it gives to values."""
    command: Any = program()
    context = command.make_context("truewheel", list(path), resilient_parsing=True)
    for name in path:
        command = command.get_command(context, name)
    return command


def value_of(parameter: Any) -> list[str]:
    """Something that a parameter takes, by what the help calls it."""
    if parameter.type_descriptor.is_choice:
        return [str(parameter.type_descriptor.choices[0])]
    if parameter.param_type_name == "argument":
        return ["1"]
    lowest = getattr(parameter, "min", None)
    words = str(parameter.metavar).split()
    return [str(lowest) if lowest is not None else NUMBERS.get(word, "1") for word in words]


def line_of(path: tuple[str, ...], option: Any = None, values: list[str] | None = None) -> list[str]:
    """What stands behind the command: all that is required, and one option more."""
    line: list[str] = []
    for parameter in command_of(path).params:
        if parameter.required and parameter is not option and parameter.opts != (option and option.opts):
            known = [] if parameter.param_type_name == "argument" else [parameter.opts[0]]
            line += [*known, *value_of(parameter)]
    return line if option is None else [*line, option.opts[0], *(values or value_of(option))]


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_no_help_shows_types_of_python(path: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    """It said ``--offset <float,float,float>...`` and ``SHOT... <list[Path]>``."""
    with pytest.raises(SystemExit) as ended:
        main([*path, "--help"])
    assert ended.value.code in (0, None)
    said = capsys.readouterr().out
    assert not re.search(
        r"list\[|<(?:str|path|int|float|bool)\b|\bNone\b(?! of)|\.\.\.\}|Annotated|typing", said
    ), said


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_every_option_takes_what_its_help_shows(path: tuple[str, ...]) -> None:
    """``--offset`` refused ``1,2,3``, which is what its help called its value."""
    command = command_of(path)

    def understood(line: list[str]) -> None:
        command.make_context(" ".join(path), line)

    context = command.make_context(" ".join(path), [], resilient_parsing=True)
    understood(line_of(path))
    for option in command.params:
        if option.param_type_name != "option" or getattr(option, "is_flag", False) or option.is_eager:
            continue
        assert option.nargs == len(str(option.metavar).split()) or option.type_descriptor.is_choice, (
            option.opts
        )
        understood(line_of(path, option))
        _, text = option.get_help_record(context)
        shown = re.search(r"\[default: \(?(-?[\d.]+(?: -?[\d.]+)*)\)?[;\]]", text)
        if shown is not None:
            understood(line_of(path, option, shown[1].split()))
        for example in EXAMPLE.findall(text):
            understood(line_of(path, option, example.split()))
        for choice in option.type_descriptor.choices or ():
            understood(line_of(path, option, [str(choice)]))

"""Errors in the words of the command line: choices as its options, remedies as commands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import Any, get_args

from typer.core import TyperGroup

from alignment.errors import Deed, Remedy, Words

COMMANDS = {
    Deed.FORCE: "To do it all the same, add --force with --reason, which is recorded",
    Deed.NAME_CONFIGURATION: "Name one with --config",
    Deed.BEGIN_CONFIGURATION: "Name one with --config, or write one to start from: `truewheel init FOLDER`",
    Deed.SAY_IMAGE_SIZE: "Say it with --size",
    Deed.SAY_UNIT: "If so, say --unit {of}",
    Deed.MIGRATE: "Run `truewheel db migrate --database {of}`",
    Deed.MAKE_DATABASE: "Create it with `truewheel db migrate --database {of}`",
    Deed.CHECK_DATABASE: "Run `truewheel db check --all`",
    Deed.REBUILD_SUMS: "Run `truewheel db sums --rebuild`",
    Deed.LIST_ZEROS: "`truewheel zero list` shows them",
    Deed.LIST_STUDIES: "See `truewheel gauge list`",
    Deed.LIST_DRIVERS: "`truewheel camera list` shows those of this environment",
    Deed.WARM_UP: "Run `truewheel warm-up`",
}
"""How each deed is done with this program."""


def remedy_in_commands(remedy: Remedy) -> str:
    """Return what to type, and what else there is to do."""
    # As a person types it: a blank, a backslash or a question mark would mean something to the shell.
    typed = replace(remedy, of=quote(remedy.of)) if remedy.of else remedy
    return typed.told(COMMANDS[remedy.deed])


@dataclass
class Running:
    """The command that runs, once it is known: groups note it in passing (see `Verbs`)."""

    command: Any = None

    def option(self, choice: str) -> str:
        """Return the option or argument of the command for a choice in plain words; these if it has none."""
        option, argument = f"--{choice.replace(' ', '-')}", choice.replace(" ", "_")
        for parameter in () if self.command is None else self.command.params:
            if option in parameter.opts:
                return option
            if parameter.param_type_name == "argument" and parameter.name == argument:
                return str(parameter.metavar or argument.upper())
        return choice

    def words(self) -> Words:
        """Return the words of this command."""
        return Words(self.option, remedy_in_commands)


_KINDS = {str: "TEXT", Path: "PATH", int: "INTEGER", float: "NUMBER"}


def name_values(command: Any) -> Any:
    """Return a command whose help names values as people do: ``--out PATH`` and not ``--out <path>``.

    Typer shows how Python writes a type (``<list[Path]>``, ``<int range>``). A range stands behind the help
    anyway, choices stay as they are, and a name of our own stays too.
    """
    for parameter in getattr(command, "params", []):
        described = parameter.type_descriptor
        if described.is_choice or getattr(parameter, "is_flag", False):
            continue
        if parameter.param_type_name == "argument":
            parameter.metavar = parameter.metavar or parameter.name.upper()
            parameter.display_type_rich = _untyped
        elif parameter.metavar is None:
            kinds = get_args(described.annotation) or (described.annotation,)
            parameter.metavar = " ".join(_KINDS.get(kind, "VALUE") for kind in kinds)
    return command


def _untyped(ctx: Any) -> None:
    """Of an argument the name says what it is."""


class Verbs(TyperGroup):
    """A group that notes in the context's `Running` which of its commands was chosen."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """As in every group, with values that are named for people."""
        return name_values(super().get_command(ctx, cmd_name))

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """As in every group."""
        name, command, rest = super().resolve_command(ctx, args)
        if isinstance(ctx.obj, Running):
            ctx.obj.command = command
        return name, command, rest

"""Errors of inner rooms speak plain words; the command line shows its options and commands."""

from __future__ import annotations

from pathlib import Path
from shlex import quote

import pytest

from alignment.errors import (
    PLAIN,
    ConfigurationError,
    Deed,
    Remedy,
    SeveralErrors,
    StoreSchemaError,
    TruewheelError,
    WarmUpError,
    Words,
)
from station.cli import main
from station.commands.words import COMMANDS, Running, remedy_in_commands


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    assert end.value.code in {2, 3}
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("gauge type1", "field '--from-file, --study': expected one of both"),
        ("gauge plan odd --name a --database sqlite:///x.db --characteristic f.toe --part A", "field 'KIND'"),
        ("gauge plan grr --name a --database sqlite:///x.db --characteristic front.toe --part A", "'--part'"),
        ("gauge plan grr --name a --database sqlite:///x.db --characteristic toe --part A --part B",
         "field '--characteristic'"),
        ("report --database sqlite:///x.db --from soon", "field '--from'"),
        ("report --database sqlite:///x.db --limits-from 7d", "field '--limits-from, --limits-until'"),
        ("report --database sqlite:///x.db --shift 06:00-14:00 --timezone Mars", "field '--timezone'"),
        ("report --database sqlite:///x.db --from 1d --until 2d", "field '--until'"),
        ("report --database sqlite:///x.db", "Create it with `truewheel db migrate --database sqlite:///x.db`"),
        ("study odd --out x", "field 'NAME'"),
        ("run", "Name one with --config, or write one to start from: `truewheel init FOLDER`"),
    ],
)  # fmt: skip
def test_what_a_command_says_names_its_options(
    arguments: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Options with other names than the choice, arguments and remedies; each of groups and of the top."""
    monkeypatch.chdir(tmp_path)
    assert expected in said(capsys, *arguments.split())


def test_a_surface_without_words_of_its_own_shows_none_of_the_command_line() -> None:
    error = ConfigurationError(
        choice="from file, study", expected="one of both", seen="none", remedy=Remedy(Deed.LIST_STUDIES)
    )
    assert str(error) == error.told(PLAIN)
    assert str(error) == (
        "field 'from file, study': expected one of both, found none. See the list of the studies"
    )
    assert not any("--" in str(Remedy(deed)) or "`" in str(Remedy(deed)) for deed in Deed)


def test_a_screen_puts_in_its_own_words() -> None:
    screen = Words(lambda choice: choice.title(), lambda remedy: f"Press {remedy.deed.name}")
    error = ConfigurationError(choice="camber, toe", expected="degrees", remedy=Remedy(Deed.FORCE))
    assert error.told(screen) == "field 'Camber, Toe': expected degrees. Press FORCE"


@pytest.mark.parametrize("kind", [StoreSchemaError, WarmUpError])
def test_a_remedy_of_several_errors_is_told_in_each(kind: type[TruewheelError]) -> None:
    url = "sqlite:///it's {odd}.db"
    error = SeveralErrors("2 failed", [kind("a is old", Remedy(Deed.MIGRATE, url)), ValueError("b")])  # type: ignore[call-arg]
    assert str(error) == f"2 failed; a is old. Migrate the database {url}; b"
    words = Running().words()
    assert error.told(words) == f"2 failed; a is old. Run `truewheel db migrate --database {quote(url)}`; b"


def test_every_deed_has_its_command() -> None:
    assert set(COMMANDS) == set(Deed)
    then = Remedy(Deed.CHECK_DATABASE, then="Restore the last backup")
    assert remedy_in_commands(then) == "Run `truewheel db check --all`. Restore the last backup"

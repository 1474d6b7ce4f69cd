"""Names of files that mean something in a URL or to a shell: found, or refused with a cure that works."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import ConfigurationError, TruewheelError
from db.connection import describe, migrate, parse_url, sqlite_url
from station.cli import main


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    return int(ended.value.code or 0)


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=30))
def test_every_name_has_a_url_that_finds_it_again(name: str) -> None:
    if not name.strip() or name == ":memory:" or name.startswith("file:"):
        return
    parsed = parse_url(sqlite_url(name))
    assert parsed.database == name
    assert parse_url(describe(parsed)).database == name


@pytest.mark.parametrize(
    "name", ["a b.db", "a#b.db", "C:\\x\\r.db", "a'b.db", "a&b;c.db", "a$b.db", "ü.db", "50%.db"]
)
def test_the_command_that_a_message_names_can_be_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """A blank or a backslash in the name, and the shell made another name of the cure."""
    monkeypatch.chdir(tmp_path)
    asked = ["report", "yield", "--database", f"sqlite:///{name}"]
    assert run(*asked) == 2 or run(*asked) == 3
    said = capsys.readouterr().err
    cure = re.findall(r"`truewheel (.*?)`", said)[0]
    assert run(*shlex.split(cure)) == 0
    assert [path.name for path in tmp_path.glob("*.db")] == [name]
    assert run(*asked) in (0, 1)


@pytest.mark.parametrize(
    ("name", "typed", "part"),
    [
        ("results/r.db", "sqlite://results/r.db", "three slashes"),
        ("r.db", "sqlite://r.db", "three slashes"),
        ("a?b.db", "sqlite:///a?b.db", "%3F"),
        ("a?b=c.db", "sqlite:///a?b=c.db", "%3F"),
        ("what?.db", "sqlite:///what?.db", "%3F"),
        ("a%20b.db", "sqlite:///a%20b.db", "%25"),
        ("a%3Fb.db", "sqlite:///a%3Fb.db", "%25"),
        ("r.db", "r.db", "sqlite:///r.db"),
        ("r.db", "sqlite:r.db", "sqlite:///r.db"),
    ],
)
def test_the_url_that_a_message_names_finds_the_file(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    typed: str,
    part: str,
) -> None:
    """`sqlite://x` was told to be migrated, which ended in a traceback; `a?b.db` was looked for as `a`."""
    monkeypatch.chdir(tmp_path)
    Path(name).parent.mkdir(exist_ok=True)
    migrate(sqlite_url(name))
    for asked in (["report", "yield"], ["db", "migrate"], ["db", "check"]):
        assert run(*asked, "--database", typed) == 2
        said = capsys.readouterr().err
        assert part in said
        assert "Traceback" not in said
    cure = said.strip().rsplit(" ", 1)[1]
    assert cure.startswith("sqlite:///")
    assert run("db", "check", "--database", cure) == 0
    # Nothing was made by the way.
    assert list(tmp_path.rglob("*.db")) == [tmp_path / name]


def test_a_cure_never_repeats_what_may_be_a_password() -> None:
    for url in ("sqlite://user:geheim@host/x", "user:geheim@host", "sqlite:user:geheim@host"):
        with pytest.raises(TruewheelError) as caught:
            parse_url(url)
        assert "geheim" not in str(caught.value)


def test_parameters_are_still_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="the parameters mode"):
        parse_url(f"sqlite:///{tmp_path / 'r.db'}?mode=memory")

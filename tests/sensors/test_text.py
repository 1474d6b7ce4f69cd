"""Text of others, by one set of rules: marks, code pages, and formats that are UTF-8 by definition."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import InputError
from sensors.formats.text import text_of, utf8_of
from sensors.formats.validation import load_json, load_toml


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_text_is_the_same_in_every_encoding_of_the_field(encoding: str) -> None:
    assert text_of("Prüfer: 5 °C\r\n".encode(encoding)) == "Prüfer: 5 °C\r\n"


@given(st.binary(max_size=200))
def test_any_bytes_are_some_text_or_one_error(data: bytes) -> None:
    assert isinstance(text_of(data), str)
    try:
        known = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        with pytest.raises(ValueError, match=r"no UTF-8|UTF-16"):
            utf8_of(data)
    else:
        assert utf8_of(data) == known


@pytest.mark.parametrize(
    ("load", "text"),
    [(load_toml, 'a = 1\nname = "Prüfstand"\n'), (load_json, '{"a": 1,\n"name": "Prüfstand"}')],
)
def test_what_is_utf8_by_definition_says_where_it_is_not(tmp_path: Path, load, text: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "file"
    for encoding in ("utf-8", "utf-8-sig"):
        path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
        assert load(path, "a file") == {"a": 1, "name": "Prüfstand"}
    column = text.splitlines()[1].index("ü") + 1
    for encoding, seen in (
        ("cp1252", f"byte 0xFC in line 2, column {column}, which is no UTF-8"),
        ("utf-16", "text in UTF-16-LE"),
    ):
        path.write_bytes(text.encode(encoding))
        with pytest.raises(InputError, match=seen) as caught:
            load(path, "a file")
        assert "UTF-8" in caught.value.expected
        assert caught.value.cure == "Save it as UTF-8"

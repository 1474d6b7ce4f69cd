"""Structured Text (IEC 61131-3) as Python: what the documents show is run as it stands.

The part of the language that a controller's steps need: IF, CASE, assignments, calls, FUNCTION without
arguments; integers, typed words (`Code#START`), durations (`T#10s`). Names are attributes of one object.
"""

from __future__ import annotations

import re
from types import CodeType

_TOKEN = re.compile(
    r"(?P<duration>T#\d+(?:\.\d+)?s\b)|(?P<word>[A-Za-z_]\w*\#[A-Za-z_]\w*)|(?P<name>[A-Za-z_][\w.]*)"
    r"|(?P<number>\d+)|(?P<symbol>:=|<>|<=|>=|[=<>()+\-*,;:])|(?P<space>\s+)|(?P<wrong>.)"
)
_OPERATORS = {"=": "==", "<>": "!=", "AND": "and", "OR": "or", "NOT": "not", "MOD": "%", "TRUE": "True"}
_OPERATORS["FALSE"] = "False"
_ENDS = {"ELSIF", "ELSE", "END_IF", "END_CASE", "END_FUNCTION"}


class _Translator:
    def __init__(self, text: str) -> None:
        plain = re.sub(r"\(\*.*?\*\)", " ", text, flags=re.DOTALL)
        self.tokens: list[tuple[str, str]] = []
        for match in _TOKEN.finditer(plain):
            kind = match.lastgroup or "wrong"
            if kind == "wrong":
                raise SyntaxError(f"{match[0]!r} is no Structured Text")
            if kind != "space":
                self.tokens.append((kind, match[0]))
        self.at = 0
        self.lines: list[str] = []

    def peek(self, ahead: int = 0) -> tuple[str, str]:
        index = self.at + ahead
        return self.tokens[index] if index < len(self.tokens) else ("end", "")

    def take(self, expected: str | None = None) -> tuple[str, str]:
        token = self.peek()
        if token[0] == "end" or (expected is not None and token[1] != expected):
            raise SyntaxError(f"expected {expected}, found {token[1]!r} after {self.tokens[: self.at][-8:]}")
        self.at += 1
        return token

    def expression(self, *ends: str) -> str:
        parts, depth = [], 0
        while depth > 0 or self.peek()[1] not in ends:
            kind, text = self.take()
            depth += {"(": 1, ")": -1}.get(text, 0)
            if kind == "duration":
                text = text[2:-1]
            elif kind == "word":
                text = repr(text.partition("#")[2].lower())
            elif text in _OPERATORS:
                text = _OPERATORS[text]
            elif kind == "name":
                text = f"plc.{text}"
            parts.append(text)
        self.take()
        return " ".join(parts)

    def block(self, depth: int) -> None:
        self.lines.append("    " * depth + "pass")
        while self.peek()[0] != "end" and self.peek()[1] not in _ENDS:
            if self.peek()[0] == "word" and self.peek(1)[1] == ":":
                return
            self.statement(depth)

    def statement(self, depth: int) -> None:
        pad = "    " * depth
        kind, text = self.take()
        if text == ";":
            return
        if text == "IF":
            self.lines.append(f"{pad}if {self.expression('THEN')}:")
            self.block(depth + 1)
            while self.peek()[1] in ("ELSIF", "ELSE"):
                if self.take()[1] == "ELSE":
                    self.lines.append(f"{pad}else:")
                else:
                    self.lines.append(f"{pad}elif {self.expression('THEN')}:")
                self.block(depth + 1)
            self.take("END_IF")
            self.take(";")
        elif text == "CASE":
            self.lines.append(f"{pad}case = {self.expression('OF')}")
            keyword = "if"
            while self.peek()[1] != "END_CASE":
                self.lines.append(f"{pad}{keyword} case == {self.expression(':')}:")
                self.block(depth + 1)
                keyword = "elif"
            self.take("END_CASE")
            self.take(";")
        elif text == "FUNCTION":
            name = self.take()[1]
            self.take(":")
            self.take()
            self.lines.append(f"{pad}def {name}():")
            self.block(depth + 1)
            self.take("END_FUNCTION")
            self.lines += [
                f"{pad}    return plc.__dict__.pop({name!r})",
                f"{pad}functions[{name!r}] = {name}",
            ]
        elif kind == "name" and self.peek()[1] == ":=":
            self.take()
            self.lines.append(f"{pad}plc.{text} = {self.expression(';')}")
        elif kind == "name" and self.peek()[1] == "(":
            self.lines.append(f"{pad}plc.{text} {self.expression(';')}")
        else:
            raise SyntaxError(f"{text!r} begins no statement")


def translated(text: str) -> CodeType:
    """Code that works on an object `plc`, and puts its functions into a mapping `functions`."""
    translator = _Translator(text)
    translator.block(0)
    if translator.peek()[0] != "end":
        raise SyntaxError(f"{translator.peek()[1]!r} belongs to nothing")
    return compile("\n".join(translator.lines), "structured text", "exec")


def names_of(text: str) -> set[str]:
    """Names that a program uses, without what follows a point."""
    keywords = {"IF", "THEN", "CASE", "OF", "FUNCTION", "USINT", *_ENDS, *_OPERATORS}
    tokens = _Translator(text).tokens
    return {name.partition(".")[0] for kind, name in tokens if kind == "name"} - keywords

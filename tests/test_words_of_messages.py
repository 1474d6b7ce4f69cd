"""No message shows how Python writes an object: ``Trigger(sequence=3, …)``, ``<Mode.ADJUST: 'adjust'>``.

What an f-string, `str()` or a log call shows is looked up by its annotation: of a parameter, of a field or
property of this name, of what a function of this name returns. What has none is not known here.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CONTAINERS = {"tuple", "list", "dict", "set", "frozenset", "Sequence", "Mapping", "Collection", "Iterable"}
LOG = {"debug", "info", "warning", "error", "exception", "log"}
Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def product() -> dict[str, ast.Module]:
    return {
        str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8"))
        for top in ("alignment", "sensors", "db", "station")
        for path in sorted((ROOT / top).rglob("*.py"))
    }


def names_of(annotation: ast.expr | None) -> Iterator[str]:
    """The types that an annotation allows, without None; aliases are not resolved."""
    match annotation:
        case ast.BinOp(left, ast.BitOr(), right):
            yield from names_of(left)
            yield from names_of(right)
        case ast.Name(name) | ast.Attribute(_, name):
            yield name
        case ast.Subscript(value, _):
            yield from names_of(value)
        case ast.Constant(str() as text):
            yield from names_of(ast.parse(text, mode="eval").body)


class Types:
    """What the annotations of the product say of names.

    Attributes
    ----------
    raw
        Classes of which Python writes the repr: those without words of their own, and containers.
    members
        Types of fields, properties and annotated attributes by their name; several, when several classes
        have one.
    returned
        Types of what functions and methods return, by their name.
    """

    def __init__(self, modules: dict[str, ast.Module]) -> None:
        self.raw = set(CONTAINERS)
        self.members: dict[str, set[str]] = defaultdict(set)
        self.returned: dict[str, set[str]] = defaultdict(set)
        self.aliases: dict[str, set[str]] = {}
        nodes = [node for tree in modules.values() for node in ast.walk(tree)]
        classes = {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}
        for name, node in classes.items():
            if not self._has_words(node, classes):
                self.raw.add(name)
        for node in nodes:
            self._take(node)

    def _has_words(self, node: ast.ClassDef, classes: dict[str, ast.ClassDef]) -> bool:
        own = {part.name for part in node.body if isinstance(part, Function)}
        if own & {"__str__", "__format__"}:
            return True
        bases = [name for base in node.bases for name in names_of(base)]
        # Of a base that is not ours, an error or a StrEnum, it is taken for granted, except of these.
        ours = [classes[name] for name in bases if name in classes]
        plain = {"object", "Protocol", "Generic", "NamedTuple", "Enum", "ABC", "TypedDict"}
        return any(self._has_words(base, classes) for base in ours) or any(
            name not in classes and name not in plain for name in bases
        )

    def _take(self, node: ast.AST) -> None:
        match node:
            case ast.ClassDef():
                for part in node.body:
                    if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
                        self.members[part.target.id] |= set(names_of(part.annotation))
            case ast.AnnAssign(ast.Attribute(_, name), annotation):
                self.members[name] |= set(names_of(annotation))
            case ast.Assign([ast.Name(name)], ast.BinOp() as value) if name[0].isupper():
                self.aliases[name] = set(names_of(value))
            case ast.FunctionDef():
                decorators = {name for one in node.decorator_list for name in names_of(one)}
                kind = self.members if decorators & {"property", "cached_property"} else self.returned
                kind[node.name] |= set(names_of(node.returns))

    def of(self, value: ast.expr, local: dict[str, set[str]]) -> set[str]:
        """What a value may be; nothing where nobody knows."""
        match value:
            case ast.Name(name):
                return local.get(name, set())
            case ast.Attribute(_, name):
                return self.members.get(name, set())
            case ast.List() | ast.ListComp() | ast.Call(ast.Name("sorted" | "list")):
                return {"list"}
            case ast.Dict() | ast.DictComp() | ast.Set() | ast.SetComp() | ast.Tuple():
                return {"tuple"}
            case ast.Call(ast.Name(name) | ast.Attribute(_, name)):
                return {name} if name in self.raw - CONTAINERS else self.returned.get(name, set())
            case ast.BoolOp(_, values):
                return set[str]().union(*(self.of(one, local) for one in values))
            case ast.IfExp(_, body, orelse):
                return self.of(body, local) | self.of(orelse, local)
        return set()

    def written_raw(self, value: ast.expr, local: dict[str, set[str]]) -> bool:
        """Whether everything that a value may be is written as Python does."""
        found = self.of(value, local)
        found = set[str]().union(*(self.aliases.get(name, {name}) for name in found))
        return bool(found) and found <= self.raw


def locals_of(function: Function, types: Types) -> dict[str, set[str]]:
    every = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
    found = {one.arg: set(names_of(one.annotation)) for one in every if one.arg not in ("self", "cls")}
    for node in ast.walk(function):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            name = node.targets[0].id
            seen = types.of(node.value, found)
            # A name that is assigned twice may be anything.
            found[name] = set() if name in found and found[name] != seen else seen
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found[node.target.id] = set(names_of(node.annotation))
    return found


def shown(function: Function) -> Iterator[ast.expr]:
    """The values that go into texts for people."""
    for node in ast.walk(function):
        match node:
            case ast.FormattedValue(value, conversion, None) if conversion in (-1, 115):
                yield value
            case ast.Call(ast.Name("str"), [value], []):
                yield value
            case ast.Call(ast.Attribute(ast.Name("_LOG"), name), [_, *values]) if name in LOG:
                yield from values


def raw_values(modules: dict[str, ast.Module]) -> list[str]:
    types = Types(modules)
    return sorted(
        {
            f"{file}:{value.lineno}: {ast.unparse(value)}"
            for file, tree in modules.items()
            for function in ast.walk(tree)
            if isinstance(function, Function)
            for values in [list(shown(function))]
            if values
            for local in [locals_of(function, types)]
            for value in values
            if types.written_raw(value, local)
        }
    )


def test_no_message_shows_how_python_writes_an_object() -> None:
    """A refusal said ``LineStatus(state=<StationState.IDLE: 'idle'>, …)``, an aborted cycle ``Abort(…)``."""
    # The shape of an array is written as in mathematics.
    assert [found for found in raw_values(product()) if not found.endswith((": shape", ": size"))] == []


def literals(modules: dict[str, ast.Module]) -> Iterator[tuple[str, str]]:
    """Texts as they stand in the code, and where; of formatted ones with {} for each value."""
    for file, tree in modules.items():
        inside = {
            id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values
        }
        inside |= {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                parts = [str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values]
                yield f"{file}:{node.lineno}", "".join(parts)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
                yield f"{file}:{node.lineno}", node.value


def test_no_text_has_a_blank_or_a_full_stop_before_another_mark() -> None:
    marks = re.compile(r"\w[ ][,;](?= )|[\w}][.][,;](?= )|,,|[(][ ]?[)][.]|: [)]")
    found = [f"{place}: {text}" for place, text in literals(product()) if marks.search(text)]
    assert found == []


CODE = """
from dataclasses import dataclass
from enum import Enum, StrEnum

class Plain(Enum):
    A = 1

class Word(StrEnum):
    A = "a"

@dataclass
class Order:
    number: int
    parts: tuple[str, ...]
    def answer(self) -> "Reply": ...

@dataclass
class Reply:
    order: Order
    def __str__(self) -> str: return "reply"

Either = Order | Plain

def told(order: Order, kind: Plain, word: Word, reply: Reply | None, either: Either | None) -> None:
    answer = order.answer()
    VALUES
"""


def test_what_is_written_raw_is_found() -> None:
    def found(values: str) -> bool:
        return raw_values({"code.py": ast.parse(CODE.replace("VALUES", values))}) != []

    for raw in (
        'f"{order}"',
        'f"of {kind}"',
        'f"{either}"',
        'f"{reply.order}"',
        'f"{order.parts}"',
        "str(order)",
        '_LOG.warning("it is %s", order)',
        'f"{Order(1, ())}"',
        'f"{sorted(order.parts)}"',
        'names = [part for part in order.parts]; f"{names}"',
        'found: list[str] = []; f"{found}"',
        'f"{reply.order or order}"',
    ):
        assert found(raw), raw
    for good in (
        'f"{reply}"',
        'f"{answer}"',
        'f"{word}"',
        'f"{order.number}"',
        'f"{order.number:g}"',
        "str(word)",
        '_LOG.info("it is %s", reply)',
    ):
        assert not found(good), good

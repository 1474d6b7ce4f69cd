"""Mutation testing of the modules that decide: `python tools/mutate.py`, or with a module's name.

Each mutant changes one thing in a module's code (a comparison, a constant, a branch, an enumeration's
member, a statement) and runs the module's own tests on it in a process of its own. A mutant that no test
notices survives and is shown. Survivors that cannot be told from the original by any caller are listed in
EQUIVALENT, with the reason.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import importlib
import importlib.util
import io
import os
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GUIDANCE = tuple(f"tests/station/guidance/test_{name}.py" for name in ("learning", "wheel", "vehicle"))
TESTS = {
    "station.guidance.words": GUIDANCE[:1],
    "station.guidance.drift": GUIDANCE[:2],
    "station.guidance.stillness": GUIDANCE[:2],
    "station.guidance.reaction": GUIDANCE[:2],
    "station.guidance.aims": GUIDANCE,
    "station.guidance.wheel": GUIDANCE[1:],
    "station.guidance.vehicle": GUIDANCE[2:],
    "station.cycle.judging.verdict": ("tests/station/cycle/judging/test_verdict.py",),
    "station.cycle.judging.straight_ahead": ("tests/station/cycle/judging/test_straight_ahead.py",),
    "station.cycle.judging.ride_height": ("tests/station/cycle/judging/test_ride_height.py",),
    "station.cycle.judging.corrections": ("tests/station/cycle/judging/test_corrections.py",),
    "station.line.handshake": ("tests/station/line/test_handshake.py",),
}
# None of them may load a module that is mutated; what is loaded here each child has at once.
PRELOADED = (
    "numpy",
    "hypothesis",
    "pytest",
    "alignment.errors",
    "db.records.results",
    "station.configuration.vehicle_types",
    "scipy.interpolate",
    "station.line.wire.messages",
    "station.line.wire.bus",
    "station.line.wire.dbc",
    "station.line.wire.link",
)
TIMEOUT_S = 120
# By module and mutant: why no caller can tell it from the original.
EQUIVALENT: dict[tuple[str, str], str] = {
    (
        "station.cycle.judging.straight_ahead",
        'Gt -> GtE: side = "left" if wheel_deg > 0.0 else "right"',
    ): ("it stands farther from straight than a limit that is above nothing"),
    ("station.guidance.wheel", "assignment dropped: self._resume = GuidanceState.CHECK"): (
        "it is set whenever a wheel is lost, before it is read"
    ),
    ("station.guidance.wheel", "assignment dropped: self._since_s = 0.0"): (
        "it is set whenever a correction begins, before it is read"
    ),
    ("station.guidance.wheel", "assignment dropped: self._told = 0.0"): (
        "it is set whenever a correction begins, before it is read"
    ),
    ("station.guidance.words", "Gt -> GtE: return cls.OUT if turns > 0.0 else cls.IN"): (
        "no turn at all has no direction, and is answered before"
    ),
    ("station.guidance.words", "Gt -> GtE: return cls.LENGTHEN if turns > 0.0 else cls.SHORTEN"): (
        "no turn at all has no direction, and is answered before"
    ),
    ("station.line.handshake", "False -> True: self._final = False"): (
        "before the first command the reply is to none, and no command is equal to it"
    ),
    ("station.line.handshake", "True -> False: return dict(zip(Request, rules, strict=True))"): (
        "every row of the table that stands there has a rule for each request"
    ),
}
_SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
}
Change = Callable[[ast.AST], ast.AST | None]


def changes_of(node: ast.AST, enumerations: dict[str, type]) -> Iterator[tuple[str, Change]]:
    """Yield all that is changed of one node: what it says, and a function that returns the new node."""
    if isinstance(node, ast.Compare):
        for index, operator in enumerate(node.ops):
            swap = _SWAPS.get(type(operator))
            if swap is not None:
                yield f"{type(operator).__name__} -> {swap.__name__}", _with(f"ops.{index}", swap())
    elif isinstance(node, ast.BoolOp | ast.BinOp):
        swap = _SWAPS.get(type(node.op))
        if swap is not None:
            yield f"{type(node.op).__name__} -> {swap.__name__}", _with("op", swap())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "not dropped", lambda found: found.operand  # type: ignore[attr-defined]
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield f"{node.value} -> {not node.value}", _with("value", not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield f"{node.value} -> {node.value + 1}", _with("value", node.value + 1)
    elif isinstance(node, ast.IfExp):
        yield "branches swapped", _swapped
    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        members = [m.name for m in enumerations.get(node.value.id, ())]  # type: ignore[attr-defined]
        if node.attr in members:
            other = members[(members.index(node.attr) + 1) % len(members)]
            yield f"{node.attr} -> {other}", _with("attr", other)
    elif isinstance(node, ast.Return) and node.value is not None:
        if not (isinstance(node.value, ast.Constant) and node.value.value is None):
            yield "returns None", _with("value", ast.Constant(None))
    elif isinstance(node, ast.Assign) and any(isinstance(t, ast.Attribute) for t in node.targets):
        yield "assignment dropped", lambda found: ast.Pass()
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield "call dropped", lambda found: ast.Pass()
    elif isinstance(node, ast.If):
        yield "condition True", _with("test", ast.Constant(True))
        yield "condition False", _with("test", ast.Constant(False))
    elif isinstance(node, ast.Raise):
        yield "raise dropped", lambda found: ast.Pass()


def _with(field: str, value: object) -> Change:
    def change(node: ast.AST) -> ast.AST:
        name, _, index = field.partition(".")
        if index:
            getattr(node, name)[int(index)] = value
        else:
            setattr(node, name, value)
        return node

    return change


def _swapped(node: ast.AST) -> ast.AST:
    assert isinstance(node, ast.IfExp)
    node.body, node.orelse = node.orelse, node.body
    return node


def mutants(source: str, enumerations: dict[str, type]) -> Iterator[tuple[str, ast.Module]]:
    """Yield every mutant of a module: its name, which holds the line, and its tree."""
    tree = ast.parse(source)
    skipped = set(_annotations(tree))
    for number, node in enumerate(ast.walk(tree)):
        if node in skipped:
            continue
        for what, change in changes_of(node, enumerations):
            mutant = copy.deepcopy(tree)
            target = next(n for k, n in enumerate(ast.walk(mutant)) if k == number)
            new = change(target)
            if new is not target:
                mutant = _replaced(mutant, target, new)
            line = source.splitlines()[node.lineno - 1].strip()  # type: ignore[attr-defined]
            yield f"line {node.lineno}: {what}: {line}", ast.fix_missing_locations(mutant)  # type: ignore[attr-defined]


def _annotations(tree: ast.AST) -> Iterator[ast.AST]:
    for node in ast.walk(tree):
        for name in ("annotation", "returns"):
            found = getattr(node, name, None)
            if found is not None:
                yield from ast.walk(found)


def _replaced(tree: ast.Module, target: ast.AST, new: ast.AST | None) -> ast.Module:
    class Replace(ast.NodeTransformer):
        def visit(self, node: ast.AST) -> ast.AST | None:
            if node is target:
                return ast.copy_location(new, node) if new is not None else None
            return self.generic_visit(node)

    found = Replace().visit(tree)
    assert isinstance(found, ast.Module)
    return found


def survives(module: str, tree: ast.Module, file: Path, tests: tuple[str, ...]) -> bool:
    """Run the tests on a mutant in a child process; true when all of them pass."""
    child = os.fork()
    if child == 0:
        code = 1
        with contextlib.suppress(BaseException):
            code = _run(module, tree, file, tests)
        os._exit(code)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) == 0


def _run(module: str, tree: ast.Module, file: Path, tests: tuple[str, ...]) -> int:
    import signal

    import pytest

    signal.alarm(TIMEOUT_S)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    made = types.ModuleType(module)
    made.__file__ = str(file)
    made.__package__ = module.rpartition(".")[0]
    sys.modules[module] = made
    exec(compile(tree, str(file), "exec"), made.__dict__)
    with contextlib.redirect_stdout(io.StringIO()):
        # What is loaded already cannot be rewritten by pytest, which would be an error.
        quiet = ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
        return int(pytest.main(["-x", "-q", "-p", "no:cov", *quiet, *tests]))


def enumerations_of(module: str) -> dict[str, type]:
    """Names of a module that stand for enumerations, asked of a process that ends again."""
    import enum

    found = importlib.import_module(module)
    return {
        name: value
        for name, value in vars(found).items()
        if isinstance(value, type) and issubclass(value, enum.Enum)
    }


def main(modules: list[str]) -> int:
    """Try all mutants of some modules; exit status 1 when one survives, 2 for an unknown module."""
    unknown = [module for module in modules if module not in TESTS]
    if unknown:
        sys.stderr.write(f"{unknown[0]}: not a module to mutate; these are: {', '.join(TESTS)}\n")
        return 2
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    for name in PRELOADED:
        importlib.import_module(name)
    failed = False
    for module in modules or list(TESTS):
        spec = importlib.util.find_spec(module)
        assert spec is not None
        assert spec.origin is not None
        file = Path(spec.origin)
        before = set(sys.modules)
        enumerations = enumerations_of(module)
        # With it go those of its room that were loaded with it: they hold what it was.
        room = module.rpartition(".")[0] + "."
        for name in [n for n in sys.modules if n == module or (n.startswith(room) and n not in before)]:
            del sys.modules[name]
        source = file.read_text(encoding="utf-8")
        if not survives(module, ast.parse(source), file, TESTS[module]):
            sys.stderr.write(f"{module}: its tests fail without any mutation\n")
            return 2
        all_mutants = list(mutants(source, enumerations))
        alive = equivalent = 0
        for name, tree in all_mutants:
            if survives(module, tree, file, TESTS[module]):
                known = (module, name.partition(": ")[2]) in EQUIVALENT
                alive, equivalent = alive + (not known), equivalent + known
                if not known:
                    sys.stdout.write(f"  {name}\n")
                    sys.stdout.flush()
        found = len(all_mutants) - alive - equivalent
        sys.stdout.write(
            f"{module}: {len(all_mutants)} mutants, {found} found, {equivalent} equivalent, {alive} survive\n"
        )
        failed = failed or alive > 0
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

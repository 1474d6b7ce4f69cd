"""What a document shows is true: snippets are run or read, commands are some, links lead somewhere.

A snippet in a language that nobody checks fails.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import shutil
import tomllib
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from db.connection import migrate
from db.records import EventRecord, Severity
from db.store import ResultStore
from sensors.formats import SCHEMAS, read_plate
from station.cli import commands, main
from station.configuration.settings import StationConfig, read_configuration, read_station
from station.configuration.vehicle_types import VehicleType
from tests.documents import DOCUMENTS, ROOT, Fence, fences
from tests.station.quality.conftest import folder_of_month

PAGES = (*DOCUMENTS, ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md")
# What a page tells its reader to write.
NEW = {"alignment/calibration/geometric.py", "configs/vehicles/roadster.toml"}
FOLDERS = "alignment|sensors|db|station|configs|tests|tools|benchmarks|docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")
FENCES = [fence for document in DOCUMENTS for fence in fences(document)]


@pytest.mark.slow
def test_the_readme_s_commands_and_python_work_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    [shown] = [fence.text for fence in fences(ROOT / "README.md") if fence.language == "console"]
    commands = re.findall(r"^\$ \.venv/bin/truewheel (.+)$", shown, flags=re.MULTILINE)
    assert len(commands) == 2
    for command in commands:
        with pytest.raises(SystemExit) as end:
            main(command.split())
        assert end.value.code == 0, capsys.readouterr()
    assert "camber" in capsys.readouterr().out
    [example] = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    exec(compile(example, "README.md", "exec"), {})
    said = capsys.readouterr().out
    camber, toe = (float(re.search(rf"{name} ([-\d.]+) rad", said)[1]) for name in ("camber", "toe"))  # type: ignore[index]
    assert camber == pytest.approx(-0.8 * 3.14159265 / 180, abs=3e-5)
    assert toe == pytest.approx(0.15 * 3.14159265 / 180, abs=3e-5)


@pytest.mark.slow
def test_the_readme_s_questions_are_answered_by_an_example_database(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copyfile(folder_of_month() / "results.db", "results.db")
    rows = [
        f"{part},{who},{trial},{part + 0.01 * trial}" for part in range(5) for who in "AB" for trial in (1, 2)
    ]
    Path("study.csv").write_text("\n".join(["part,appraiser,trial,value", *rows]) + "\n", encoding="utf-8")
    [asked] = [fence.text for fence in FENCES if fence.language == "sh" and "report all" in fence.text]
    for line in asked.splitlines():
        # The example's month is long past; whether a report is good is not what is asked here.
        arguments = shlex.split(line.replace("--from 30d", "--from 2026-10-01"))[1:]
        with pytest.raises(SystemExit) as end:
            main(arguments)
        assert end.value.code in (0, 1), (line, capsys.readouterr())
    assert Path("report.html").is_file()
    assert Path("results.dfq").is_file()


# Snippets that other tests run, as they need what those have; the test must take them from the document.
RUN_ELSEWHERE = {
    ("README.md", "console"): (1, "tests/test_documents.py"),
    ("README.md", "python"): (1, "tests/test_documents.py"),
    ("docs/line-interface.md", "c"): (1, "tests/station/line/tools/test_page_code.py"),
    ("docs/line-interface.md", "iecst"): (2, "tests/station/line/tools/test_page_plc.py"),
    ("docs/line-interface.md", "mermaid"): (3, "tests/station/line/tools/test_page_plc.py"),
    ("docs/database.md", "sql"): (2, "tests/db/connection/test_access.py"),
    ("docs/how-to/commission-a-station.md", "sh"): (10, "tests/end_to_end/test_commissioning.py"),
    ("docs/how-to/commission-a-station.md", "toml"): (2, "tests/end_to_end/test_commissioning.py"),
    ("docs/how-to/commission-cameras.md", "sh"): (9, "tests/end_to_end/test_commission_cameras.py"),
    ("docs/how-to/commission-cameras.md", "toml"): (7, "tests/end_to_end/test_commission_cameras.py"),
    ("docs/how-to/add-a-calibration-method.md", "python"): (
        3,
        "tests/alignment/calibration/test_method_page.py",
    ),
    ("docs/how-to/measure-the-steering-axis.md", "sh"): (1, "tests/end_to_end/test_steering_axis.py"),
    ("docs/how-to/measure-again.md", "sh"): (3, "tests/station/replay/test_page.py"),
    ("docs/how-to/add-a-camera.md", "python"): (2, "tests/end_to_end/test_camera_plugin.py"),
    ("docs/how-to/add-a-camera.md", "toml"): (2, "tests/end_to_end/test_camera_plugin.py"),
    ("docs/how-to/basler-cameras.md", "toml"): (3, "tests/end_to_end/test_pylon_station.py"),
}


def python_runs(fence: Fence, folder: Path) -> None:
    if "results.db" in fence.text:
        migrate(f"sqlite:///{folder / 'results.db'}")
        with ResultStore(f"sqlite:///{folder / 'results.db'}") as store:
            noon = datetime(2026, 11, 22, 12, tzinfo=UTC)
            store.record_event(EventRecord(noon, "EOL-1", Severity.INFO, "station", "started", "started"))
    exec(compile(fence.text, fence.name, "exec"), {})


def shell_is_understood(fence: Fence, folder: Path) -> None:
    for line in fence.text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        match words:
            case ["make", target, *given]:
                makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
                assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE)
                assert all(f"$({variable.partition('=')[0]})" in makefile for variable in given), line
            case [".venv/bin/truewheel" | "truewheel" | "/opt/truewheel/bin/truewheel", *arguments]:
                understood(arguments)
            case ["useradd" | "chown" | "cp", *_]:
                # As the unit itself says.
                unit = (ROOT / "configs" / "truewheel.service").read_text(encoding="utf-8")
                assert line in unit.replace("@HOME@", "/srv/truewheel"), line
            case (
                ["systemctl", *_, "truewheel"]
                | ["journalctl", *_]
                | [
                    "python3" | "/opt/truewheel/bin/python",
                    "-m",
                    "pip" | "venv",
                    *_,
                ]
            ):
                pass  # The installation as Python has it.
            case [".venv/bin/python" | "python", "-m", module, *_]:
                assert importlib.util.find_spec(module), line
            case [".venv/bin/python" | "python", script, *_]:
                assert (ROOT / script).is_file(), line
            case _:
                pytest.fail(f"{fence.name}: nobody checks the command {line!r}")


def toml_is_read(fence: Fence, folder: Path) -> None:
    found = tomllib.loads(fence.text)
    if "schema" in found:
        schema_is_kept(found)
        return
    if "axles" in found:
        vehicle_type_is_added(fence, folder)
        return
    if set(found) <= set(VehicleType.model_fields) - set(StationConfig.model_fields):
        # Tables that the page puts behind its vehicle type.
        first = next(f for f in FENCES if f.document == fence.document and "[axles." in f.text)
        behind = replace(fence, text=f"{first.text}\n{fence.text}")
        vehicle_type_is_added(behind, folder)
        return
    # A part of a station's configuration: the delivered one with this part instead must be read.
    text = (ROOT / "configs" / "station.toml").read_text(encoding="utf-8")
    for table in found:
        assert table in StationConfig.model_fields, f"{fence.name}: no configuration has [{table}]"
        text = re.sub(rf"^\[{table}\]\n(?:(?!\[).*\n)*", "", text, flags=re.MULTILINE)
    (folder / "station.toml").write_text(f"{text}\n{fence.text}", encoding="utf-8")
    read_station(folder / "station.toml")


def vehicle_type_is_added(fence: Fence, folder: Path) -> None:
    """Beside those that are delivered, in a file of its own."""
    shutil.copytree(ROOT / "configs", folder / "configs")
    before = set(read_configuration(folder / "configs" / "station.toml").vehicle_types)
    (folder / "configs" / "vehicles" / "added.toml").write_text(fence.text, encoding="utf-8")
    after = read_configuration(folder / "configs" / "station.toml").vehicle_types
    number = tomllib.loads(fence.text)["number"]
    assert set(after) == before | {number}
    # The command by which the page tries it out names it.
    assert f"--vehicle-type {number}" in fence.document.read_text(encoding="utf-8")


def json_is_read(fence: Fence, folder: Path) -> None:
    schema_is_kept(json.loads(fence.text))


def schema_is_kept(found: dict[str, Any]) -> None:
    kind, version = found["schema"].removeprefix("truewheel.").split("/")
    assert version == "1"
    SCHEMAS[kind].model_validate_json(json.dumps(found), strict=True)


def certificate_is_read(fence: Fence, folder: Path) -> None:
    _, _, *rows = fence.text.splitlines()
    listed = {tuple(row.split(",")[:2]) for row in rows}
    cells = [(str(i), str(j)) for i in range(-5, 6) for j in range(-5, 6)]
    others = [f"{i},{j},{15 * int(i)},{15 * int(j)},0.0005" for i, j in cells if (i, j) not in listed]
    (folder / "head_certificate.csv").write_text(fence.text + "\n".join(others) + "\n", encoding="utf-8")
    [plate] = [f.text for f in fences(fence.document) if f.language == "toml" and "certificate" in f.text]
    (folder / "plate.toml").write_text(plate, encoding="utf-8")
    read_plate(folder / "plate.toml")


def files_are_named_elsewhere(fence: Fence, folder: Path) -> None:
    """A folder's content: each of its files is named in the examples or the sentences around it."""
    if fence.document.name == "design.md":
        packages_exist(fence)
        return
    rest = fence.document.read_text(encoding="utf-8").replace(fence.text, "")
    names = re.findall(r"[\w/]+\.\w+", fence.text)
    assert names
    for name in names:
        assert name.rpartition("/")[2] in rest, f"{fence.name}: {name} is named nowhere else"


def packages_exist(fence: Fence) -> None:
    named = re.findall(rf"^({FOLDERS})/ ", fence.text, flags=re.MULTILINE)
    named += re.findall(rf"\b(?:{FOLDERS})\.\w+", fence.text)
    assert len(named) >= 4
    for name in named:
        assert is_there(name), f"{fence.name}: {name}"


CHECKS: dict[str, Callable[[Fence, Path], None]] = {
    "python": python_runs,
    "sh": shell_is_understood,
    "toml": toml_is_read,
    "json": json_is_read,
    "csv": certificate_is_read,
    "text": files_are_named_elsewhere,
}


@pytest.mark.parametrize("fence", FENCES, ids=lambda fence: fence.name)
def test_every_snippet_is_run_or_read(
    fence: Fence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The published E2E code was wrong in words and in C, because nobody had ever compiled it."""
    place = str(fence.document.relative_to(ROOT)), fence.language
    if place in RUN_ELSEWHERE:
        count, test = RUN_ELSEWHERE[place]
        assert Counter(f.language for f in fences(fence.document))[fence.language] == count
        assert fence.language in (ROOT / test).read_text(encoding="utf-8")
        return
    assert fence.language in CHECKS, (
        f"{fence.name}: nobody checks snippets in {fence.language or 'no language'!r}"
    )
    monkeypatch.chdir(tmp_path)
    CHECKS[fence.language](fence, tmp_path)


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("python", "import no_such_module"),
        ("sh", "truewheel meausre out/wheel"),
        ("sh", "truewheel measure out/wheel --no-such-option"),
        ("sh", "rm -r out"),
        ("sh", "make coffee"),
        ("toml", "[archive]\nfodler = 'x'"),
        ("toml", "[nothing]\nx = 1"),
        ("json", '{"schema": "truewheel.truth/1"}'),
        ("csv", "# C\ni,j,x_mm\n0,0,1"),
        ("text", "folder/\n    never_heard_of.png"),
    ],
)
def test_snippet_with_a_mistake_is_found(
    language: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    fence = Fence(ROOT / "docs" / "formats.md", 1, language, 0, text)
    with pytest.raises((Exception, pytest.fail.Exception)):
        CHECKS[language](fence, tmp_path)


def test_every_link_of_the_documents_leads_somewhere() -> None:
    for document in PAGES:
        # Brackets of code are no links.
        text = without_fences(document)
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
            assert (document.parent / target).exists(), f"{document.name} links to {target}"


@pytest.mark.parametrize("document", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_and_module_that_a_page_names_exists(document: Path) -> None:
    """Decision records named modules of before the rooms."""
    for name in re.findall(r"`([^`\n]+)`", without_fences(document)):
        if re.fullmatch(rf"({FOLDERS})/[\w./-]*", name):
            assert name in NEW or (ROOT / name).exists(), f"{document.name}: {name}"
        elif re.fullmatch(rf"({FOLDERS})(\.\w+)+", name) and not name.endswith((".toml", ".md")):
            assert is_there(name), f"{document.name}: {name}"


@pytest.mark.parametrize(
    "name", ["station.contradiction", "db.chain", "station.cycle.judging.verdict.Verdikt"]
)
def test_module_that_is_gone_is_found(name: str) -> None:
    assert not is_there(name)
    assert is_there("station.cycle.judging.verdict")
    assert is_there("station.cycle.judging.verdict.Angle.status")


def without_fences(document: Path) -> str:
    text = document.read_text(encoding="utf-8")
    for fence in fences(document):
        text = text.replace(fence.text, "")
    return text


def is_there(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def test_every_make_target_that_the_readme_names_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(re.findall(r"`?make ([a-z]+)`?", README)):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


def documented_commands(pattern: str) -> list[tuple[str, str]]:
    """Command lines that documents show, with the document's name; continued lines joined."""
    found = []
    for document in DOCUMENTS:
        text = document.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(pattern, text, flags=re.MULTILINE):
            found.append((document.name, line))
    return found


@pytest.mark.parametrize(
    ("document", "line"), documented_commands(r"^(?: {4}|\$ )(?:\.venv/bin/)?truewheel (.+)$")
)
def test_every_command_that_a_document_shows_is_understood(document: str, line: str) -> None:
    understood(shlex.split(line, comments=True))


@pytest.mark.parametrize(
    ("document", "line"), documented_commands(r"`(?:\.venv/bin/)?truewheel ([a-z][^`…|]*)`")
)
def test_every_command_that_a_sentence_names_exists_with_its_options(document: str, line: str) -> None:
    # What stands in brackets is optional; required arguments may be left out.
    words = shlex.split(re.sub(r"[\[\]]", " ", line))
    command: Any = commands()
    options: set[str] = set()
    for word in words:
        if hasattr(command, "commands"):
            assert word in command.commands, f"{document}: truewheel {line}"
            command = command.commands[word]
            options = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
        elif word.startswith("--"):
            assert word in options | {"--help"}, f"{document}: truewheel {line}"


def understood(arguments: list[str]) -> None:
    """Parse a command line with all checks of options, and do not run it."""
    command: Any = commands()
    context = None
    while hasattr(command, "resolve_command"):
        context = command.make_context(command.name, arguments, parent=context)
        rest = [*context._protected_args, *context.args]
        if not rest and command.invoke_without_command:
            return
        _, command, arguments = command.resolve_command(context, rest)
    command.make_context(command.name, arguments, parent=context)

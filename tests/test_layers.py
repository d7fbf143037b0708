"""Imports run downwards only: no room of the package knows one above it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.machines import ROOT

PACKAGE = "orthoglide_cal"
SOURCES = sorted((ROOT / PACKAGE).rglob("*.py"))
# From the top down; rooms in one line do not know each other either.
LAYERS = (
    ("__main__",),
    ("cli",),
    ("report",),
    ("session", "outcome"),
    ("verification", "diagnosis"),
    ("estimation",),
    ("data",),
    ("causes", "protocols"),
    ("simulation",),
    ("effects",),
    ("kinematics",),
    ("measured",),
    ("plan",),
    ("machine",),
    ("axes", "errors", "published"),
)
RANK = {room: rank for rank, rooms in enumerate(LAYERS) for room in rooms}
PRINTING = {"print", "input"}


def room_of(module: str) -> str:
    """Second part of a dotted name: "orthoglide_cal.data.table" → "data"."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else ""


def name_of(path: Path) -> str:
    """Dotted name of a source file."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imported(path: Path) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of everything that a file imports from the package, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, name.name) for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} imports relatively"
            module = node.module or ""
            if module == PACKAGE:
                yield from ((node.lineno, f"{module}.{name.name}") for name in node.names)
            else:
                yield node.lineno, module


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_imports_run_downwards(path: Path) -> None:
    room = room_of(name_of(path))
    for line, module in imported(path):
        if not module.startswith(f"{PACKAGE}."):
            continue
        other = room_of(module)
        if other == room or other == "__version__":
            continue
        assert RANK[room] < RANK[other], f"{path}:{line}: {room} must not know {other}"


def test_every_room_has_its_layer() -> None:
    rooms = {room_of(name_of(path)) for path in SOURCES} - {""}
    assert rooms == set(RANK)


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_files_are_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 300


@pytest.mark.parametrize("path", [p for p in SOURCES if p.name == "__init__.py"], ids=name_of)
def test_init_files_only_re_export(path: Path) -> None:
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        name = isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
        if name:
            assert node.targets[0].id in ("__all__", "__version__")  # type: ignore[attr-defined]
        assert text or name or isinstance(node, ast.Import | ast.ImportFrom)


@pytest.mark.parametrize(
    "path", [p for p in SOURCES if room_of(name_of(p)) not in ("cli", "__main__", "")], ids=name_of
)
def test_only_the_command_line_prints_reads_keys_or_exits(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        if isinstance(called, ast.Name):
            assert called.id not in PRINTING, f"{path}:{node.lineno}"
        if isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name):
            assert (called.value.id, called.attr) != ("sys", "exit"), f"{path}:{node.lineno}"


@pytest.mark.parametrize("path", [p for p in SOURCES if room_of(name_of(p)) == "cli"], ids=name_of)
def test_commands_import_only_the_quick_at_module_level(path: Path) -> None:
    """So that `--help` stays quick: typer, the standard library, errors and the commands."""
    heavy = ("numpy", "scipy", "matplotlib", "jinja2", "rich", "yaml", "pydantic", "serial")
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            names = [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        else:
            continue
        for name in names:
            assert name.partition(".")[0] not in heavy, f"{path}:{node.lineno}"
            if name.startswith(PACKAGE):
                assert room_of(name) in ("", "cli", "errors"), f"{path}:{node.lineno}"


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_randomness_comes_through_a_generator(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute):
            if (node.value.attr, node.attr) == ("random", "default_rng"):
                assert room_of(name_of(path)) in ("cli", "session"), f"{path}:{node.lineno}"
            elif node.value.attr == "random":
                assert node.attr == "Generator", f"{path}:{node.lineno}"

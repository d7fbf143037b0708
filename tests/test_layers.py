"""The package as a whole, from its syntax: which room may know which, and what nobody needs.

Each test reads every file and names all places that break its rule.
"""

import ast
import functools
import inspect
import itertools
import re
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

import numpy as np
import yaml

from orthoglide_cal.model.kinds import MACHINES
from orthoglide_cal.model.machine import Machine

ROOT = Path(__file__).parents[1]
PACKAGE = "orthoglide_cal"
RULES = yaml.safe_load((ROOT / "tests" / "layers.yaml").read_text(encoding="utf-8"))
ROOMS, KINDS, QUESTIONS = (RULES[name].split() for name in ("rooms", "kinds", "questions"))


def name_of(path: Path) -> str:
    """Dotted name of a source file; a folder's for its `__init__.py`."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


FILES = {name_of(path): path for path in sorted((ROOT / PACKAGE).rglob("*.py"))}


@functools.cache
def tree(name: str) -> ast.Module:
    return ast.parse(FILES[name].read_text(encoding="utf-8"))


@functools.cache
def nodes_of(name: str, *kinds: type[ast.AST]) -> list[ast.AST]:
    """Every such node of a file; all of them without `kinds`."""
    every = nodes_of(name) if kinds else ast.walk(tree(name))
    return [node for node in every if not kinds or isinstance(node, kinds)]


def room_of(module: str) -> str:
    """Second part of a dotted name; "" for the package itself."""
    return [*module.split("."), ""][1]


def imported(name: str) -> Iterator[tuple[str, str]]:
    """(place, dotted name) of what a file imports from the package, anywhere in it.

    `from a import b` is the module a.b if there is one, else the module a.
    """
    for node in nodes_of(name, ast.Import, ast.ImportFrom):
        modules = [entry.name for entry in node.names]
        if isinstance(node, ast.ImportFrom):
            inner = [f"{node.module}.{entry}" for entry in modules]
            modules = [module if module in FILES else str(node.module) for module in inner]
        place = f"{name}:{node.lineno}"
        yield from ((place, module) for module in modules if module.split(".")[0] == PACKAGE)


def nodes(*kinds: type[ast.AST]) -> Iterator[tuple[str, ast.AST]]:
    """(dotted name of its file, node) of every such node of the package."""
    yield from ((name, node) for name in FILES for node in nodes_of(name, *kinds))


def none(faults: Iterable[str]) -> None:
    places = list(faults)
    assert not places, f"{len(places)} places:\n" + "\n".join(places)


def test_every_room_has_its_place_in_the_order() -> None:
    assert {room_of(name) for name in FILES} - {""} <= set(ROOMS)


def test_imports_run_downwards() -> None:
    rank = {room: place for place, room in enumerate(ROOMS)}
    faults = []
    for name in FILES:
        for place, module in imported(name):
            room, other = room_of(name), room_of(module)
            # The package itself holds the version and knows nobody.
            if other in (room, "") or {room, other} - set(ROOMS) - {""}:
                continue
            upwards = room == "" or rank[other] < rank[room]
            if upwards or room not in RULES["only_for"].get(other, {room}):
                faults.append(f"{place}: {room or PACKAGE} must not know {module}")
    none(faults)


def test_no_imports_run_in_a_circle() -> None:
    """Inside a room neither, nor where only types are imported."""
    knows = {name: {m for _, m in imported(name) if m in FILES} - {name} for name in FILES}
    # What knows nobody, or is known by nobody, is in none.
    while free := {n for n in knows if not knows[n]} or {*knows}.difference(*knows.values()):
        knows = {name: others - free for name, others in knows.items() if name not in free}
    none(f"{name} knows {', '.join(sorted(others))}" for name, others in knows.items())


def test_no_class_name_stands_twice() -> None:
    defined: dict[str, list[str]] = {}
    for name, node in nodes(ast.ClassDef):
        defined.setdefault(node.name, []).append(f"{name}:{node.lineno}: {node.name}")
    none(place for places in defined.values() if len(places) > 1 for place in places)


def test_hardly_anything_is_of_any_type() -> None:
    found = [f"{name}:{node.lineno}" for name, node in nodes(ast.Name) if node.id == "Any"]
    none(found if len(found) > RULES["most_any"] else ())


def test_only_who_makes_or_reads_one_knows_a_kind_of_machine() -> None:
    faults, idle = [], {*RULES["needing"]}
    for name, node in nodes(ast.ImportFrom):
        known = {*KINDS} & {entry.name for entry in node.names}
        if known and str(node.module).startswith(PACKAGE) and room_of(name) != "model":
            places = {
                place for place in RULES["needing"] if f"{name}.".startswith(f"{PACKAGE}.{place}.")
            }
            idle -= places
            faults += [] if places else [f"{name} needs {', '.join(sorted(known))}"]
    none([*faults, *(f"nobody needs one in {place}" for place in sorted(idle))])


def test_no_other_room_knows_the_class_of_a_cause() -> None:
    causes = f"{PACKAGE}.causes"
    classes = {str(node.name) for name, node in nodes(ast.ClassDef) if name.startswith(causes)}
    for name, node in nodes(ast.ImportFrom):
        known = classes & {entry.name for entry in node.names}
        assert not known or name.startswith(causes), (name, known)


def stated(of: object, name: str) -> bool:
    """Whether a kind, or its words, gives something that takes no argument; or is not empty."""
    value = getattr(of, name, None)
    bare = callable(value) and len(inspect.signature(value).parameters) == 1
    if callable(value) or isinstance(value, property):
        return name in vars(of) and (bare or isinstance(value, property))
    return isinstance(value, np.ndarray) or bool(value)


def truths(node: ast.AST) -> list[ast.expr]:
    """Expressions of which a node takes the truth, by which it multiplies, or that it compares with
    a constant."""
    values = node.values if isinstance(node, ast.BoolOp) else []
    constant = isinstance(getattr(node, "comparators", [None])[-1], ast.Constant)
    sides = ("left", "right") if constant or isinstance(getattr(node, "op", None), ast.Mult) else ()
    one = (getattr(node, name, None) for name in ("test", "operand", *sides))
    return [*filter(None, one), *getattr(node, "ifs", []), *values]


def ends(node: ast.AST) -> tuple[str, str]:
    """Last two parts of a dotted name; of a call those of its function, or of what it counts."""
    while isinstance(node, ast.Call | ast.NamedExpr | ast.Subscript):
        counts = isinstance(node, ast.Call) and ast.unparse(node.func) in ("bool", "len", "any")
        inner = node.value if not isinstance(node, ast.Call) else node.func
        node = node.args[0] if counts else inner
    named = isinstance(node, ast.Name | ast.Attribute | ast.Constant)
    *_, owner, name = ["", "", *(ast.unparse(node) if named else "").split(".")]
    return owner, name.strip("'")


def asks(file: str, differing: Collection[str]) -> Iterator[int]:
    """Lines of a file that ask for the kind, under whatever local name."""
    owners, asking = {"machine", "kind", "vocabulary", "words", "MACHINES"}, {*QUESTIONS}
    owners |= {
        node.arg for node in nodes_of(file, ast.arg)
        if {*KINDS, "Machine", "Vocabulary"} & {*re.findall(r"\w+", ast.unparse(node))}
    }  # fmt: skip
    for node in nodes_of(file, ast.Assign, ast.NamedExpr):
        for target in getattr(node, "targets", None) or [node.target]:
            both = (getattr(part, "elts", [part]) for part in (target, node.value))
            for to, (owner, name) in ((to, ends(value)) for to, value in zip(*both, strict=False)):
                owners |= {ast.unparse(to)} if name in owners else set()
                asking |= {ast.unparse(to)} if owner in owners and name in differing else set()
    for node in nodes_of(file, ast.expr, ast.stmt, ast.comprehension, ast.MatchClass):
        for part, (owner, name) in ((part, ends(part)) for part in truths(node)):
            if name in asking or (owner in owners and name in differing):
                yield part.lineno
        called = ends(node.func)[1] if isinstance(node, ast.Call) else ""
        compared = isinstance(node, ast.Compare | ast.MatchClass)
        names = {ends(part)[1] for part in ast.walk(node)} if compared or called[:2] == "is" else {}
        of_machine = called == "type" and {ends(part)[1] for part in node.args} & owners
        if called in QUESTIONS or of_machine or {*KINDS, *MACHINES} & {*names}:
            yield node.lineno


def test_hardly_anybody_asks_for_the_kind_of_machine() -> None:
    """Where readers and writers of one kind begin, and where gauges are planned.

    An ask is a class that is required or compared, a table by kinds, the type of a machine, and
    whether there is something that one kind states and another leaves empty.
    """
    kinds, own = [*MACHINES.values()], {f"{PACKAGE}.model.{name}" for name in RULES["kind_files"]}
    differing = {*RULES["for_some_kinds"].split()} | {
        name for some in (kinds, [kind.vocabulary for kind in kinds]) for name in dir(some[0])
        if name[0] != "_" and name not in Machine.model_fields
        and len({stated(one, name) for one in some}) > 1
    }  # fmt: skip
    lines = {f"{file}:{line}" for file in {*FILES} - own for line in asks(file, differing)}
    none(sorted(lines) if len(lines) > RULES["most_questions"] else ())


def test_every_file_is_reached_from_the_program() -> None:
    """A file that searches its folder for modules (`pkgutil`) reaches all that lie in it."""
    reached: set[str] = set()
    waiting = [f"{PACKAGE}.__main__"]
    while waiting:
        name = waiting.pop()
        if name in reached or name not in FILES:
            continue
        reached.add(name)
        waiting += [module for _, module in imported(name)]
        waiting.append(name.rpartition(".")[0])
        every = nodes_of(name, ast.Import)
        if any(alias.name == "pkgutil" for node in every for alias in node.names):
            folder = FILES[name].parent
            waiting += [inner for inner, path in FILES.items() if path.is_relative_to(folder)]
    none(sorted(set(FILES) - reached))


def test_nothing_is_shipped_that_only_tests_use() -> None:
    """Every name that a file defines is read somewhere in the package; re-exports do not count."""
    defined: dict[str, str] = {}
    read = {"__all__", "__version__"}
    for name in FILES:
        for node in tree(name).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                registered = any(ast.unparse(d).startswith("app.") for d in node.decorator_list)
                command = name == f"{PACKAGE}.cli.{node.name}"  # loaded by its name
                words = [] if registered or command else [node.name]
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                words = [inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)
                         and isinstance(inner.ctx, ast.Store)]  # fmt: skip
            else:
                words = []
            defined |= {word: f"{name}:{node.lineno}: {word}" for word in words}
        names, attributes = nodes_of(name, ast.Name), nodes_of(name, ast.Attribute)
        read |= {node.id for node in names if isinstance(node.ctx, ast.Load)}
        read |= {node.attr for node in attributes}
    none(place for word, place in defined.items() if word not in read)


def test_init_files_only_re_export() -> None:
    """They may choose a module by the operating system."""
    faults = []
    for name, path in FILES.items():
        body = tree(name).body if path.name == "__init__.py" else []
        choice = [(*s.body, *s.orelse) if isinstance(s, ast.If) else (s,) for s in body]
        for node in itertools.chain(*choice):
            text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            names = [getattr(target, "id", "") for target in getattr(node, "targets", ())]
            stated = names in (["__all__"], ["__version__"])
            if not (text or stated or isinstance(node, ast.Import | ast.ImportFrom)):
                faults.append(f"{name}:{node.lineno}")
    none(faults)


def test_only_the_command_line_prints_asks_or_exits() -> None:
    none(
        f"{name}:{node.lineno}: {ast.unparse(node.func)}"
        for name, node in nodes(ast.Call)
        if ast.unparse(node.func) in ("print", "input", "exit", "quit", "sys.exit", "os._exit")
        and room_of(name) not in RULES["printing"]
    )


def test_randomness_comes_through_a_generator() -> None:
    """Only a command, or the simulated gauge of a session, makes one from its seed."""
    none(
        f"{name}:{node.lineno}: {ast.unparse(node)}"
        for name, node in nodes(ast.Attribute)
        if ast.unparse(node.value).endswith("np.random")
        and node.attr != "Generator"
        and (node.attr != "default_rng" or room_of(name) not in RULES["seeding"])
    )

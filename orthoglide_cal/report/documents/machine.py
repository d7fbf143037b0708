"""The document of `orthocal machine`: a machine with the numbers of its file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

from orthoglide_cal.files import machine_values
from orthoglide_cal.model import Model
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.facts import MEANS, OWNER, stated
from orthoglide_cal.words import short

# Keys of the file that have a place of their own on the page, or none.
_ELSEWHERE = {"schema_version", "name", "tolerances", "history", "identified", "report"}


def machine_document(model: Model) -> doc.Document:
    """The document, for any of the renderers."""
    return doc.Document(partial(machine_values, model), partial(_page, model))


def _page(model: Model) -> doc.Page:
    machine, values = model.machine, machine_values(model)
    own = {key: value for key, value in values.items() if key not in _ELSEWHERE}
    facts = doc.Facts((*_rows(own), *stated(machine, OWNER), *stated(machine, MEANS)))
    sections, rows = [], list[tuple[str, ...]]()
    for one in machine.history:
        day, digest = one.date[:10], one.data_sha256[:12]
        rows.append((day, _written(one.before), _written(one.after), digest))
    if rows:
        head = ("entered", "before, mm", "after, mm", "from SHA-256")
        sections.append(doc.Section("In the controller", (doc.Grid(head, tuple(rows)),)))
    rows = []
    for effect in model.accepted:
        sizes = (
            f"{name} {short(each.value, 4)} ± {short(each.std, 4)} {each.unit}"
            for name, each in model.called(effect).items()
        )
        rows.append((effect.cause.id, ", ".join(sizes), (effect.date or "")[:10]))
    if rows:
        titles = ("cause", "size, one standard deviation", "found")
        grid = doc.Grid(titles, tuple(rows), words=(0, 1))
        sections.append(doc.Section("What is known to be wrong with it", (grid,)))
    return doc.Page("Machine", machine.name, facts=facts, sections=tuple(sections))


def _rows(values: Mapping[str, object], group: str = "") -> Iterator[tuple[str, doc.Blank]]:
    """Every key in words with its unit, and its value; `joint_limits_mm` is "Joint limits, mm"."""
    for key, value in values.items():
        if isinstance(value, Mapping) and "_" not in key:
            yield from _rows(value, f"{key} ")
            continue
        name, _, unit = key.rpartition("_")
        unit = f", {unit}" if unit in ("mm", "deg") else ""
        words = f"{group}{name if unit else key}".replace("_", " ")
        yield words[0].upper() + words[1:] + unit, doc.Given(_written(value))


def _written(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_written(each)}" for name, each in value.items())
    if isinstance(value, list | tuple):
        return " ".join(map(_written, value))
    return short(value, 6) if isinstance(value, float) else str(value)

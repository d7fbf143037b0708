"""Short documents: `machine`, `validate`, `apply`, `adjust`, and `paper`, its own check."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from orthoglide_cal.errors import command, fault_kinds, file_words
from orthoglide_cal.files.input import Check, Input
from orthoglide_cal.files.machine_file import machine_values
from orthoglide_cal.files.tree import yaml_text
from orthoglide_cal.model.measured import Source
from orthoglide_cal.model.model import Model
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import data_words, measure_again
from orthoglide_cal.report.sentences import sentence
from orthoglide_cal.results.application import Application, Correction
from orthoglide_cal.session.adjusting import AdjustmentAnswer, Phase
from orthoglide_cal.words import counted, decimals_for, plain, signed, with_uncertainty

if TYPE_CHECKING:
    from orthoglide_cal.paper.tables import Reproduction

_KEYS = 58  # characters behind which the keys of a group go on in the next line of a terminal


def machine_document(model: Model) -> doc.Document:
    """A machine under the keys of its file."""
    values = machine_values(model)
    sections = [doc.Section(None, doc.Listing(yaml_text(values, _KEYS).splitlines()))]
    page = doc.Page("Machine", model.machine.name, sections=sections)
    return doc.Document(lambda: values, lambda: page)


def check_document(check: Check, source: Source | None = None) -> doc.Document:
    """One line for the file; two for each fault: where and what, then the remedy."""
    path, kind, refused = file_words(check.input.path), check.input.kind, check.refused
    lines = [f"{path}: {counted(len(check.problems), 'fault')}"]
    word = "no fault, but see the notes" if check.doubtful else "fine"
    if kind == "machine":
        lines = [f"{path}: machine {check.machine!r}, {word}"]
    elif check.valid and kind is not None:
        word = "which give no offsets" if refused else word
        data = data_words(source, kind, check.input.readings)
        data += ", SIMULATED" if check.simulated else ""
        lines = [f"{path}: {data}, {word} (for {check.machine})"]
    kinds, others = fault_kinds(check.problems)
    for problem, often in kinds:
        lines.append(f"  {replace(problem, file=None, remedy='').alone}")
        advice = f"{problem.remedy} {often}".strip()
        lines += [f"    → {advice}"] if advice else []
    lines += [f"  {text}" for text in others]
    lines += [f"  {refused.what}", f"    → {refused.remedy}"] if refused else []
    lines += [f"  note: {sentence(remark)}" for remark in check.remarks]
    page = doc.Page("Validation", sections=[doc.Section(None, doc.Listing(lines))])
    return doc.Document(partial(check.model_dump, mode="json", context=sentence), lambda: page)


def application_document(application: Application) -> doc.Document:
    """The offsets in the controller from now on, and what comes next; as data what changes [mm]."""
    entry, machine, given = application.entry, application.file.model.machine, application.given
    undone, written, controller = given is None, application.written, application.controller
    simulated = given is not None and given.measured.source.simulated
    # In the controller until then and from then on; none of a printer.
    before, after = (dict(active or {}) for active in (entry.before, entry.after))
    before, after = (after, before) if undone else (before, after)
    data = {
        "schema_version": 1,
        "simulated": simulated,
        "machine_file": application.file.document.path,
        "machine": machine.name,
        "undone": undone,
        "date": entry.date if application.changes else None,
        "before": before,
        "after": after,
        "data_sha256": entry.data_sha256,
        "corrections": [correction.model_dump() for correction in application.corrections],
        "written": written.model_dump() if written else None,
    }
    words, head = machine.vocabulary, ("", "before", "change", "from now on")
    rows = [
        (name, signed(old, 4), signed(after[name] - old, 4), doc.strong(signed(after[name], 4)))
        for name, old in before.items()
    ]
    caption = f"{words.title} in the controller{machine.common_unit} ({words.relation})."
    first = "The controller must hold the values of the last column and have been homed with them."
    if controller is not None and written is not None:
        head, none = ("line", "what", "now", "from now on"), "(no line)"
        # Which axis a joint is follows from the file.
        axes = {v.key.split()[0]: name for name, v in controller.settings.items() if name in before}
        keys = [f"{axes.get(v.key.split()[0], '')} {v.key}".strip() for v in written.values]
        rows = [
            (str(line.line), key, line.before or none, doc.strong(line.after or none))
            for key, line in zip(keys, written.values, strict=True)
        ]
        notes = map(sentence, application.remarks)
        caption = " ".join((f"Lines of {written.target}; all others stay.", *notes))
        if written.tables and not undone:
            names = ", ".join(Path(table.path).name for table in written.tables)
            held = any(line.key.endswith("BACKLASH") for line in written.values)
            caption += f" New files in its folder: {names}{', with what BACKLASH held' * held}."
            caption += " Home offsets change so that the tables add nothing at the switches."
        restarts = controller.format == "linuxcnc" and not application.live
        first = f"{'Restart LinuxCNC: it reads its INI only then. ' * restarts}{words.restart}"
    corrections = doc.Section(None, _corrections(application.corrections))
    sections = [doc.Section(None, doc.Grid(head, rows, caption=caption)), corrections]
    title, steps = "To be taken back", list[doc.Line]([first])
    if given is not None:
        title, again = "To be recorded", doc.step(f"{words.anew}.", measure_again(given))
        compare, path = "Compare with the prediction.", given.measured.source.path
        if controller and controller.sha256 == entry.data_sha256:
            compare, path = f"{compare} BEFORE: a copy of this file, made first.", "BEFORE"
        typed = command("verify", path, "AFTER", machine=given.machine_file)
        steps += [again, doc.step(compare, typed)]
    sections.append(doc.Section(None, doc.Instructions(steps)))
    page = doc.Page(title, machine.name, sections=sections, simulated=simulated)
    return doc.Document(lambda: data, lambda: page)


def _corrections(corrections: Sequence[Correction]) -> doc.Grid:
    why = {
        "": "corrected",
        "no_place": "the controller has no place for it",
        "no_origin": "MIN_LIMIT and MAX_LIMIT do not show where the isotropic posture is",
        "below_u": "not corrected: within U",
        "fitted": "entered with the parameters",
    }
    rows = []
    for one in corrections:
        size = f"{with_uncertainty(one.value, one.expanded)} {one.unit}"
        gain = "" if one.gain_mm is None or one.left else plain(one.gain_mm, 3)
        # Without a place its sizes are of no use here.
        cause = (one.id, "") if one.left == "no_place" else (f"{one.id} {one.name}", size)
        rows.append((*cause, gain, why[one.left]))
    caption = "Size: what is known to be wrong. Gain: carriage error that the controller removes."
    head = ("cause", "size", "gain, mm", "from now on")
    return doc.Grid(head, list(dict.fromkeys(rows)), caption=caption, words=(0, 3))


def adjustment_document(answer: AdjustmentAnswer, given: Input) -> doc.Document:
    """The document; `given` is what was adjusted."""
    head = ("parameter", "", "target", "reached", "check: expected", "measured")
    rows = []
    for one in answer.adjustments:
        plan, decimals = one.adjustment, decimals_for(one.adjustment.expanded_mm)
        values = one.target_mm, one.readings_mm.get(Phase.TIGHT), plan.check_mm, one.check_mm
        target, reached, expected, measured = (
            "—" if value is None else signed(value, decimals) for value in values
        )
        target += f" ± {plain(plan.expanded_mm, decimals)}" * (one.target_mm is not None)
        expected += f" ± {plain(plan.check_expanded_mm, decimals)}"
        rows.append((plan.name, one.status, target, reached, expected, measured))
    caption = "Readings, mm; the check is the difference between two of them."
    notice = doc.Notice(doc.Tone.INFO, f"Adjusted: {answer.cause}")
    if answer.failed:
        notice = doc.Notice(doc.Tone.BAD, "A check failed: something did not move as intended")
    first = doc.step(given.model.machine.vocabulary.pushed, measure_again(given))
    compare = command("verify", answer.input.path, "AFTER", machine=given.machine_file)
    section = doc.Section(None, doc.Grid(head, rows, words=(0, 1), caption=caption))
    sections = [section, doc.next_steps((first, doc.step("Compare the two.", compare)))]
    page = doc.Page("Adjustment", answer.machine.name, notice=notice, sections=sections)
    return doc.Document(partial(answer.model_dump, mode="json"), lambda: page)


def paper_document(reproduction: "Reproduction") -> doc.Document:
    """Two lines for each row, as printed and as computed, and the verdict.

    As data None stands where nothing was printed or nothing can be computed.
    """
    rows = []
    for row in reproduction.rows:
        computed = row.computed or (None,) * len(row.published)
        both = (row.name, "published", row.published), ("", "computed", computed)
        for name, origin, values in both:
            cells = ("—" if part is None else plain(part, reproduction.digits) for part in values)
            rows.append((name, origin, *cells))
    verdict = doc.Notice(doc.Tone.BAD, "NOT reproduced.")
    if reproduction.reproduced:
        verdict = doc.Notice(doc.Tone.GOOD, "Reproduced in every figure that can be computed.")
    grid = doc.Grid(("", "", *reproduction.columns), rows, words=(0, 1))
    kind = "Accuracy" if reproduction.table == "accuracy" else f"Table {reproduction.table}"
    section = doc.Section(None, grid, *reproduction.notes, verdict)
    page = doc.Page(kind, reproduction.title, sections=[section])
    return doc.Document(partial(reproduction.model_dump, mode="json"), lambda: page)

"""The document of `orthocal diagnose`: what the model leaves out, how sure that is, what to do.

The calibration report shows the same blocks for the verdict, its causes and what to read next.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest

from orthoglide_cal.causes import CAUSES
from orthoglide_cal.inference import NextMeasurement, Verdict, nothing_wrong
from orthoglide_cal.inference.result import Explanation, FoundPattern
from orthoglide_cal.model.cause import Stage
from orthoglide_cal.model.measured import weighing
from orthoglide_cal.report import document as doc
from orthoglide_cal.report.case import Case, decision_notice, size_words, sizes_words, to_do
from orthoglide_cal.report.documents.pictures import brief_residuals, residual_blocks
from orthoglide_cal.report.documents.solution import (
    alone_block,
    common_unit,
    offsets_only,
    open_blocks,
    parameters_grid,
    parameters_title,
    solution_document,
)
from orthoglide_cal.report.sentences import pattern_name, pattern_remedy, pattern_words
from orthoglide_cal.report.terminal import fitting
from orthoglide_cal.results import Answer
from orthoglide_cal.words import (
    chance,
    counted,
    decimals_for,
    listed,
    percent,
    plain,
    signed,
    two_figures,
    unit_words,
)

RESIDUALS = "Residuals (measured − model)"
_NOTHING, _UNLISTED = "nothing wrong", "none of the listed causes"
# What one screen has room for.
_MOST_OPEN = 4  # explanations
_MOST_LIKELY = 3  # of them in the title
_MOST_SIZES, _MOST_SHOWN = 6, 3  # of one cause; of more the largest are shown
_DECIDED, _BEYOND, _UNDECIDED = 30, 24, 20  # lines of its screen


def diagnosis_document(case: Case) -> doc.Document:
    """The whole answer."""
    if not case.answer.parameters:
        return solution_document(case)
    return doc.Document(case.data, partial(_page, case), partial(_screen, case))


def _screen(case: Case) -> doc.Page:
    """The numbers that decide, one thought each, and what to do.

    Where a screen has too few lines for it, notes give way, then baselines, the reminder to
    solve again, the residuals, and all steps but the first.
    """
    answer = case.answer
    undecided = answer.verdict is Verdict.AMBIGUOUS
    most = _UNDECIDED if undecided else _BEYOND if _beyond(answer) else _DECIDED
    baselines, steps = [*_baselines(case)], [*_steps(case)]
    first, others = steps[:1], steps[1:]
    named = answer.verdict is Verdict.NAMED
    residuals = [brief_residuals(case)] if named else []
    again = []
    if named and not (answer.release.usable or any(fault.matters for fault in answer.unshown)):
        again.append(doc.Instruction("Then solve again, and enter only what it releases."))
    notes = [case.says(note) for note in answer.notes if note.code == "acts_too"]
    notes += _doubts(case, all=False)
    if answer.ruled_out:
        notes.append(f"Ruled out by hand: {listed(answer.ruled_out)}.")
    notes += [case.says(note) for note in answer.notes if note.code == "not_excluded"]
    decisive, left = [*_sizes(case, offsets=True), *open_blocks(case)], [_rms_grid(case)]
    if undecided:
        decisive, left = [_open_grid(case)], left * bool(answer.holdout)

    def page() -> doc.Page:
        sections = (
            *(doc.Section(None, *blocks) for blocks in (decisive, [*left, *baselines], *residuals)),
            doc.next_steps([*first, *others, *again], *notes, case.more("diagnose")),
        )
        notice, simulated = diagnosis_notice(case), answer.simulated
        return doc.Page("Diagnosis", simulated=simulated, notice=notice, sections=sections)

    return fitting(page, notes, baselines, again, residuals, others, lines=most)


def diagnosis_notice(case: Case) -> doc.Notice:
    """The verdict, and what it means for the parameters."""
    answer, release, notice = case.answer, case.answer.release, decision_notice(case)
    if not release.usable and answer.verdict in (None, Verdict.CONSISTENT):
        return notice  # not the model is wrong, but the numbers
    title = headline(case)
    judged = answer.judgement and case.says(answer.judgement)  # it is in the headline
    consistent = answer.verdict is Verdict.CONSISTENT
    lines = [f"{notice.title}.", *(e for e in notice.lines if not (consistent and e == judged))]
    reason = release.reasons[0].code if release.reasons else ""
    if answer.alone is not None and reason in ("offsets_wrong", "cause_found"):
        wrong = f"{two_figures(answer.alone.wrong_by)} {answer.alone.unit}"
        alone = f"the {case.words.many} alone would be wrong by up to {wrong}"
        lines[:2] = [f"Do not enter anything yet: {alone}."]
    elif "beyond_list" in release.codes:
        caution = next(one for one in release.cautions if one.code == "beyond_list")
        words = (
            f"The {case.words.many} may be entered, with a reservation: the reason is not known."
        )
        lines = [words, *(text for text in notice.lines if text != case.says(caution))]
    elif answer.refuted is not None and reason == answer.refuted.code:
        del lines[1]  # the title
    elif reason == "undecided":
        u = two_figures(max(size.expanded for size in answer.parameters))
        why = f": they may be wrong by {u} {answer.parameters[0].unit} until this is decided"
        lines[:2] = [f"{notice.title}{why if common_unit(case.machine) else ''}."]
    if case.invalidating:
        title, lines[0] = notice.title, f"{title.rstrip('.')}."
    return replace(notice, title=title, lines=tuple(lines))


def _sizes(case: Case, *, offsets: bool = False) -> Iterator[str]:
    """Where the causes are, and their parameters; with `offsets` also those of the machine."""
    answer = case.answer
    for cause in answer.causes:
        shown = cause.parameters
        if len(shown) > _MOST_SIZES and not cause.where:
            largest = sorted(shown, key=lambda size: -abs(size.value) / (size.std or 1.0))
            shown = tuple(largest[:_MOST_SHOWN])
        sizes = [(size.name, size.value, size.expanded, size.unit) for size in shown]
        if sizes and not cause.where:
            others = len(cause.parameters) - len(shown)
            rest = f" and {counted(others, 'other')}" if others else ""
            yield f"{cause.id}: {sizes_words(sizes)}{rest}."
        places = [cause.where] if len(sizes) < 2 else [name for name, *_ in sizes]
        for place, row in zip_longest(places, sizes) if cause.where else ():
            size = size_words(*row[1:]) if row else ""
            if row and CAUSES[cause.id].stage is Stage.RECORD:
                size = size.lstrip("+−").replace("1 turns", "1 turn")
                size += f" too {'high' if row[1] > 0.0 else 'low'}"
            at = "" if place.startswith(("at ", "from ")) else "at "
            where = f"{cause.id} {at}{place}"
            yield f"{': '.join(filter(None, (where, size)))}."
    if offsets:
        known = (size for size in answer.parameters if size.determined)
        found = ((size.name, size.found or 0.0, size.expanded, size.unit) for size in known)
        together = len(answer.causes) + len(_beyond(answer))
        causes = f" with {'them' if together > 1 else 'it'}" * bool(answer.named or answer.patterns)
        yield f"{case.words.many.capitalize()}{causes}: {sizes_words(found)}."


def _omitted(case: Case) -> str:
    return "later readings" if case.answer.holdout else "omitted readings"


def _beyond(answer: Answer) -> list[FoundPattern]:
    """The patterns of the likeliest state beyond the list."""
    return [pattern for pattern in answer.patterns if pattern.accepted]


def _rms_grid(case: Case, *, late: bool = False) -> doc.Grid:
    """Residuals without and with the causes, of readings fitted and not; `late`: last ones too."""
    answer, lack = case.answer, case.answer.lack_of_fit
    left: dict[str, tuple[float, ...]] = {}
    for first in answer.causes[:1]:
        left["fitted"] = first.rms_before_mm, *filter(None, [first.rms_after_mm])
        left[f"predicting {_omitted(case)}"] = first.heldout_before_mm, first.heldout_after_mm
    for best in _beyond(answer)[:1]:
        left["fitted"] = best.rms_before_mm, best.rms_after_mm or best.rms_before_mm
        if best.heldout_before_mm is not None and best.heldout_after_mm is not None:
            left["cycles left out, there"] = best.heldout_before_mm, best.heldout_after_mm
        if late and best.last_third_before_mm and best.last_third_after_mm:
            left["last third, there"] = best.last_third_before_mm, best.last_third_after_mm
    if lack is not None:
        left.setdefault("fitted", (lack.left_mm,))
        left[f"{case.words.noise}'s noise{case.words.also} would leave"] = (lack.expected_mm,)
    head = ["r.m.s., mm", f"{case.words.many} only"]
    if answer.causes:
        head.append(f"with {' and '.join(cause.id for cause in answer.causes)}")
    if known := _beyond(answer):
        head.append(f"with the {pattern_name(known[0])}")
    rows = [(name, *(plain(mm, 4) for mm in pair), "")[: len(head)] for name, pair in left.items()]
    return doc.Grid(head, rows)


def _baselines(case: Case) -> Iterator[doc.Block]:
    """Predictions of a printer's extension, compared with those that need no cause."""
    baselines = case.answer.baselines
    if baselines is None:
        return
    named = {
        f"{case.words.many} only": baselines.parameters_mm,
        "with the causes": baselines.extension_mm,
        "a quartic surface": baselines.quartic_mm,
        "the earlier map": baselines.earlier_map_mm,
    }
    errors = [f"{name} {plain(1e3 * mm, 1)}" for name, mm in named.items() if mm is not None]
    yield f"Errors of predicting {_omitted(case)}, µm r.m.s.: {', '.join(errors)}."


def _open(answer: Answer) -> list[Explanation]:
    """The explanations that these data leave open; of some it was not worth fitting."""
    return [state for state in answer.explanations if state.parameters]


def _name(state: Explanation) -> str:
    if state.pattern is not None:
        return state.pattern
    first, *others = state.ids or (_NOTHING,)
    return f"{first} with {' and '.join(others)}" if others else first


def _shares(answer: Answer) -> str:
    """The most probable explanations and the share of all others, 100 % in all."""
    shares = {_name(state): state.probability for state in answer.explanations if not state.pattern}
    shares[_UNLISTED] = sum(state.probability for state in answer.explanations if state.pattern)
    likely = sorted(shares.items(), key=lambda pair: -pair[1])[:_MOST_LIKELY]
    whole = {name: round(100.0 * share) for name, share in likely}
    shown = [f"{name} ({share} %)" for name, share in whole.items() if share]
    if rest := 100 - sum(whole.values()):
        shown.append(f"or others ({rest} %)")
    return ", ".join(shown)


def _open_grid(case: Case) -> doc.Grid:
    """Residuals and parameters under each open state."""
    rows = []
    names = [row.name for row in case.answer.parameters]
    # Where nearly any cause fits, one of them shows what they may do.
    most = 1 if "few_readings" in case.answer.release.codes else _MOST_OPEN
    rivals = (state for state in _open(case.answer) if not state.sound)
    others = [state for state in rivals if round(100.0 * state.probability)][:most]
    for state in (*filter(None, [offsets_only(case.answer)]), *others):
        values = {
            one.name: signed(one.found, decimals_for(2.0 * one.std))
            for one in state.parameters
            if one.found is not None
        }
        left = "" if state.rms_mm is None else plain(state.rms_mm, 4)
        name = f"{case.words.many} only" if state.sound else _name(state)
        rows.append((name, left, *(values.get(name, "") for name in names)))
    head = f"{case.words.many}{common_unit(case.machine)}"
    return doc.Grid((head, "r.m.s. left, mm", *names), rows)


def _steps(case: Case) -> Iterator[doc.Instruction]:
    """Next steps: remedies, the measurement that decides, or entering."""
    answer, release, baselines = case.answer, case.answer.release, case.answer.baselines
    if baselines and baselines.better and answer.causes:
        instead, mm = "Keep the earlier bed mesh: it", baselines.earlier_map_mm
        if baselines.better == "quartic":
            instead, mm = "Make a bed mesh: a quartic surface", baselines.quartic_mm
        both = [f"{plain(1e3 * size, 1)} µm" for size in (mm or 0.0, baselines.extension_mm)]
        text = f"{instead} predicts within {both[0]} r.m.s., the causes found within {both[1]}."
        yield doc.Instruction(text)
    if answer.verdict is Verdict.AMBIGUOUS:
        # Whatever else is open, these readings are wrong.
        sure = set.intersection(*(set(state.ids) for state in _open(answer)))
        for cause in (
            cause for cause in answer.causes if cause.id in sure and not cause.in_machine
        ):
            yield doc.Instruction(cause.remedy)
        if "few_readings" in release.codes:  # more of them come first
            yield from case.remedies()
        else:
            yield from case.remedies("measure")
            yield _next_step(case)
        for cause in answer.causes:
            if cause.where and not cause.in_machine and cause.id not in sure:
                yield doc.Instruction(f"Or: {cause.remedy}")
        shape = case.machine.shape
        open_ids = (*answer.ambiguous_with, *(cause.id for cause in answer.causes))
        worth = (
            baselines and not baselines.better and baselines.extension_mm < baselines.parameters_mm
        )
        if worth and shape in open_ids:
            # What lasts may be carried, whatever its cause.
            typed = case.typed("diagnose", f"--accept {shape}")
            yield doc.Instruction(
                "Or accept the shape as part of the machine, whatever its cause", typed
            )
    elif known := _beyond(answer):
        for pattern in known:
            yield doc.Instruction(pattern_remedy(case.machine, pattern), case.further(None))
    elif not release.usable:
        yield from case.remedies()
        if answer.next_measurement is not None and any(fault.matters for fault in answer.unshown):
            decides = _next_step(case)
            yield replace(decides, content=f"Or: {decides.content}")
    elif answer.verdict is Verdict.NAMED:
        # As in the decision: the record first.
        for cause in sorted(answer.causes, key=lambda cause: CAUSES[cause.id].fix_order):
            yield doc.Instruction(cause.remedy)
            if cause.recommended:
                typed = case.typed("diagnose", f"--accept {cause.id}")
                yield doc.Instruction("Or accept it as part of the machine", typed)
            if CAUSES[cause.id].corrected_at_joints(case.machine):
                typed = case.typed("apply", "--to FILE.ini")
                yield doc.Instruction("Or let LinuxCNC correct it", typed)
    for cause in answer.causes if answer.verdict is Verdict.NAMED else ():
        beyond = any(abs(size.value) > size.expanded for size in cause.parameters)
        if CAUSES[cause.id].adjustable and beyond:
            typed = case.typed("adjust", f"--cause {cause.id}")
            yield doc.Instruction(f"Correct it live, with a {case.words.noise}", typed)
    if release.settled:
        yield from to_do(case)
    elif release.usable:
        yield doc.Instruction("See what to enter", case.typed("solve"))


def _page(case: Case) -> doc.Page:
    answer = case.answer
    blocks: list[doc.Block] = [parameters_grid(case)]
    if answer.verdict is Verdict.AMBIGUOUS:
        blocks.append("U includes the undecided causes.")
    elif answer.verdict is Verdict.UNEXPLAINED:
        blocks.append("U includes what is not on the list.")
    blocks += [*open_blocks(case), *alone_block(case), *_note_blocks(case)]
    return doc.Page(
        kind="Diagnosis",
        simulated=answer.simulated,
        notice=diagnosis_notice(case),
        sheet=(doc.next_steps(_steps(case)),),
        sections=(
            doc.Section("Causes", *_cause_blocks(case)),
            doc.Section(RESIDUALS, *residual_blocks(case), *_fit_blocks(case)),
            doc.Section(parameters_title(case), *blocks),
        ),
    )


def headline(case: Case) -> str:
    """The verdict in one sentence."""
    answer = case.answer
    if answer.verdict is Verdict.NAMED:
        ids, share = [cause.id for cause in answer.causes], answer.causes[0].probability
        others = [cause for cause in answer.causes if cause.id != case.shape]
        titles = [case.title_of(cause.id, len(cause.parameters)) for cause in others]
        for shape in (cause for cause in answer.causes if cause.id == case.shape):
            size = f"A smooth shape is left ({1e3 * shape.adds_mm:.0f} µm)"
            left = " and ".join([size, *titles])
            return f"{left}: {' and '.join(ids)}, {percent(share, 1)}"
        if len(ids) > 1:
            return f"Causes found: {' and '.join(ids)} ({percent(share, 1)})"
        # What looks the same to these readings, such as a stand that was knocked before the last.
        alike = [(one.ids[0], one.probability) for one in answer.explanations if len(one.ids) == 1]
        alike = [(id, p) for id, p in alike if id in answer.causes[0].aliases and 2.0 * p > share]
        named = ", or ".join(f"{id}, {percent(p, 1)}" for id, p in ((ids[0], share), *alike))
        return f"Cause found: {titles[0]} ({named})"
    if answer.verdict is Verdict.AMBIGUOUS:
        return f"Undecided: {_shares(answer)}"
    if answer.refuted is not None:
        return f"Unexplained: {case.says(answer.refuted)}"
    if answer.verdict is not Verdict.CONSISTENT:
        if known := _beyond(answer):
            text = "; ".join(pattern_words(case.machine, pattern) for pattern in known)
            return f"Not on the list: {text}."
        far = [
            f"{cause.id} at {cause.times:.0f} times its size" for cause in answer.beyond_tolerance
        ]
        only = f"only {' or '.join(far)} would explain what these readings show"
        return f"Unexplained: {only if far else 'no listed cause explains these readings'}."
    judged = answer.judgement and case.says(answer.judgement)
    text = f"{judged[0].lower()}{judged[1:]}" if judged else "the model fits."
    for unknown in answer.undetermined:
        if unknown.name not in [parameter.name for parameter in answer.parameters]:
            within = f"{unknown.within:.2g} {unit_words(unknown.unit)}"
            text += (
                f" The readings do not determine {unknown.name}: it may be off by {within} (1 σ)."
            )
    unfit = answer.judgement is not None and answer.judgement.code == "residuals_too_large"
    return f"{'No cause found' if unfit else 'Consistent'}: {text}"


def diagnosis_section(case: Case) -> doc.Section:
    """All of it for a report, below its own verdict."""
    blocks = [f"{headline(case).rstrip('.')}.", *_fit_blocks(case), *_cause_blocks(case)]
    if case.answer.verdict is Verdict.AMBIGUOUS:
        blocks.append(doc.Instructions([_next_step(case)]))
    return doc.Section("Diagnosis", *blocks, *_note_blocks(case))


def _cause_blocks(case: Case) -> Iterator[doc.Block]:
    """Open explanations; each cause with place and size; what all of them gain."""
    answer = case.answer
    if answer.verdict in (Verdict.AMBIGUOUS, Verdict.UNEXPLAINED) and _open(answer):
        yield _open_grid(case)
    if _beyond(answer):
        yield _rms_grid(case, late=True)
    if not answer.causes:
        return
    yield from _sizes(case)
    yield _rms_grid(case)
    facts: list[tuple[str, doc.Blank]] = []
    for cause in answer.causes:
        facts.append((cause.id, case.title_of(cause.id, len(cause.parameters))))
        if cause.id in case.machine.companions:
            facts.append(("doubt", case.machine.companions[cause.id]))
        if not cause.in_machine and cause.id != case.machine.shape:
            facts.append(("note", "An error of the measurement: no controller corrects it."))
        elif not cause.recommended:
            facts.append(("note", "Accepting it as part of the machine is not recommended."))
        if cause.aliases and answer.verdict is not Verdict.AMBIGUOUS:
            facts.append(("looks like", ", ".join(cause.aliases)))
    share = percent(answer.causes[0].probability, 1)
    nothing = nothing_wrong(answer.explanations)
    if nothing is not None:
        share += f"; {percent(nothing, 1)} that nothing is wrong at all"
    facts.append(("probability", share))
    if any(size.std for cause in answer.causes for size in cause.parameters):
        names = {size.name for cause in answer.causes for size in cause.parameters}
        facts.append(("±", "U, 95 %" + "; y_x: along y on leg x" * ("y_x" in names)))
    yield doc.Facts(facts)


def _next_step(case: Case) -> doc.Instruction:
    """The measurement that would decide what is open, or that none would."""
    answer, following = case.answer, case.answer.next_measurement
    if following is not None and following.between:
        first, second = between_words(following)
        text = f"{case.says(following.what)} About {following.minutes:.0f} min; it distinguishes"
        text += f" {first} from {second} ({following.separation_sigma:.1f} σ)."
        return doc.Instruction(text, case.further(following.session))
    if not answer.ambiguous_with:
        again = f"Repeat the session with {case.words.further}: a real fault returns unchanged."
        return doc.Instruction(again)
    open_ids = {*answer.ambiguous_with, *(cause.id for cause in answer.causes if cause.aliases)}
    text = "No further reading of this kind is likely to decide."
    if not any(CAUSES[id].in_machine for id in open_ids):
        text += " All of them are faults of the measurement: measure there again, and leave the old"
        text += " readings out. Then it does not matter which it was."
    return doc.Instruction(text)


def between_words(measurement: NextMeasurement) -> tuple[str, str]:
    """The two explanations that it distinguishes, in words."""
    first, second = (" with ".join(ids) or "a sound machine" for ids in measurement.between)
    return first, second


def _doubts(case: Case, all: bool = True) -> Iterator[str]:
    """Faults that these readings would not show, and causes far beyond their size.

    Without `all` not those that the decision names, and of several only their names.
    """
    answer, machine = case.answer, case.machine
    faults = [fault for fault in answer.unshown if all or not fault.matters]
    places = {fault: f" ({fault.where})" if fault.where else "" for fault in faults}
    if len(faults) > 1 and not all:
        named = " or ".join(f"{fault.id}{place}" for fault, place in places.items())
        yield f"These readings cannot show {named}. How to check: --details."
        places = {}
    for fault, place in places.items():
        title = case.title_of(fault.id) + place
        yield f"These readings cannot show whether {title}. How to check: {fault.check}."
    large = [(cause.id, "has", cause.times_stated) for cause in answer.causes if cause.times_stated]
    would = "would explain these readings with"
    large += [(far.id, would, far.times) for far in answer.beyond_tolerance]
    for id, verb, times in large:
        stated = "usual" if CAUSES[id].assumed(machine) else "stated"
        key = CAUSES[id].number.get(type(machine), f"{id} under tolerances")
        real = "a real slip" if CAUSES[id].stage is Stage.RECORD else "real damage"
        check = f"look for {real}, or correct {key} in the machine file."
        yield f"{id} {verb} {times:.0f} times its {stated} size: {check}"


def _note_blocks(case: Case) -> tuple[doc.Block, ...]:
    """Remarks, the sizes that were assumed, and how the answer depends on the tolerances."""
    answer = case.answer
    notes = [case.says(note) for note in answer.notes if note not in answer.release.cautions]
    notes += _doubts(case)
    # A cause without a unit has no size: it happens or it does not.
    if assumed := [e for e in answer.assumed_sizes if e.unit]:
        text = ", ".join(f"{e.id} {e.size:.3g} {unit_words(e.unit)}" for e in assumed)
        notes.append(f"Assumed sizes (not in the machine file): {text}.")
    if answer.ruled_out:
        notes.append(f"Ruled out by hand: {', '.join(answer.ruled_out)}.")
    named_ids, changed = {cause.id for cause in answer.causes}, []
    for how, other in (answer.sensitivity or {}).items():
        if (other.verdict, set(other.ids)) != (answer.verdict, named_ids):
            ids, named = (" and ".join(sorted(names)) for names in (other.ids, named_ids))
            conclusion = {
                Verdict.CONSISTENT: "no cause is found",
                Verdict.NAMED: f"the cause found is {ids}",
                Verdict.AMBIGUOUS: f"{named} is no longer certain"
                if named
                else f"{ids} is possible",
                Verdict.UNEXPLAINED: "no listed cause explains these readings",
            }[other.verdict]
            changed.append(f"With tolerances {how}, {conclusion}.")
    if answer.sensitivity and not changed:
        notes.append("Conclusion unchanged when tolerances are halved or doubled.")
    return tuple(map(doc.small, (*notes, *changed)))


def _fit_blocks(case: Case) -> Sequence[str]:
    """Do the parameters alone explain the data?"""
    lack, words = case.answer.lack_of_fit, case.words
    if lack is None:
        return ()
    if not lack.dof:
        return [f"There are as many {words.many} as readings: they always fit exactly."]
    lines = [
        f"With {words.many} only, {plain(lack.left_mm, 4)} mm"
        f" r.m.s.{weighing(case.given.measured)} remains; this {words.noise}'s noise{words.also}"
        f" would leave {plain(lack.expected_mm, 4)} mm ({chance(lack.p_value)},"
        f" {counted(lack.dof, 'degree')} of freedom)."
    ]
    if lack.repeats_mm is not None:
        p = "" if lack.repeats_p_value is None else f" ({chance(lack.repeats_p_value)})"
        lines.append(f"Repeats scatter by {plain(lack.repeats_mm, 4)} mm{p}. {words.repeats}")
    return lines

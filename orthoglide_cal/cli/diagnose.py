"""`orthocal diagnose`: what the offsets do not explain, how certain that is, and what to do."""

from contextlib import suppress
from dataclasses import replace
from datetime import date
from pathlib import Path

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import File, Offsets, Text, Texts, flag, option
from orthoglide_cal.errors import OrthocalError, UnusableResultError, UsageError, command


def diagnose(
    files: list[str] = common.FILES,
    machine: File = common.MACHINE,
    data: common.Data = common.DATA,
    rule_out: Texts = common.RULE_OUT,
    holdout: Text = option("FILE", "Later readings to predict; they are not fitted."),
    applied: Offsets = option(
        "DX DY DZ", "Offsets entered in the controller before the held-out readings, mm."
    ),
    recalibrated: bool = flag(
        "--recalibrated", "The machine was calibrated again before the held-out readings."
    ),
    together: bool = flag(
        "--together",
        "Take all files as dates of one printer, the latest last; one answer for all.",
    ),
    accept: Text = option(
        "CAUSE", "Make this cause part of the machine and write a new machine file."
    ),
    output: File = option(
        "FILE", "New machine file of --accept. An existing file is never overwritten."
    ),
    details: bool = common.DETAILS,
    json: bool = common.JSON,
) -> int:
    """Find what is wrong besides the offsets, and what to do about it."""
    from orthoglide_cal.causes import CAUSES
    from orthoglide_cal.estimation.arms import free_arms
    from orthoglide_cal.files.input import in_order, read_input, require_distinct, require_order
    from orthoglide_cal.files.input import together as as_one
    from orthoglide_cal.files.machine_file import machine_text
    from orthoglide_cal.files.printer_file import PrinterFile
    from orthoglide_cal.files.text import write_text
    from orthoglide_cal.inference.diagnose import diagnose as diagnosis_of
    from orthoglide_cal.report.documents.answer import diagnosis_document

    if together and len(files) < 2:
        raise UsageError("--together needs several files.", "Name each date, the latest last.")
    for name, given in (("--recalibrated", recalibrated), ("--applied", applied)):
        if given and holdout is None:
            raise UsageError(f"{name} goes with --holdout.", "Name the later readings.")
    if [*files, holdout].count("-") > 1 or (holdout == "-" and len(files) > 1):
        raise UsageError("Standard input can be read only once.", "Name a file instead.")
    if accept is not None and len(files) != 1 and not together:
        raise UsageError("--accept goes with one file.", "Name the readings to identify it from.")
    if output is not None and accept is None:
        raise UsageError("--output goes with --accept.", "Name the cause to accept.")
    if str(output) == "-":
        raise UsageError("Standard output holds the diagnosis.", "Name a file: --output FILE")
    if accept is not None and accept not in CAUSES:
        raise UsageError(f"There is no cause {accept!r}.", f"Choose one of {', '.join(CAUSES)}.")
    full = details or json
    options = {"holdout": holdout, "applied": applied, "recalibrated": recalibrated}

    def judge(path: str) -> int:
        inputs = files if together else [path]
        dates, _ = in_order([common.read_input(name, machine, data, rule_out) for name in inputs])
        given = as_one(dates) if together else dates[0]
        named = common.known_machine(machine) if holdout else None
        by = named if isinstance(named, PrinterFile) else given.model
        later = free_arms(read_input(holdout, by, stored=data)) if holdout else None
        if holdout and later:
            require_distinct([*dates, later])
            right = command(
                "diagnose", holdout, machine=machine, holdout=path, applied=applied,
                recalibrated=recalibrated,
            )  # fmt: skip
            require_order(given, later, right)
        # Without a diagnosis the answer is that of solve.
        diagnosed, needless = None, () if later or accept else (UnusableResultError,)
        with common.working(path), suppress(*needless):
            diagnosed = diagnosis_of(
                given.measured,
                given.model,
                holdout=later.measured if later else None,
                applied=applied or (),
                then=later.model if later else None,
                sensitivity=full,
                recalibrated=recalibrated,
            )
        dated = dates if together else ()
        case = common.judged(given, diagnosed=diagnosed, holdout=holdout, details=full, dates=dated)
        case = replace(case, options=options)
        common.deliver(diagnosis_document(case), as_json=json, details=details)
        if accept is None or diagnosed is None:
            return 0 if case.answer.verdict else UnusableResultError.exit_code
        target = output or Path(f"{machine.stem if machine else 'machine'}-{accept}.yaml")
        try:
            write_text(target, machine_text(diagnosed.extend(accept, date.today())))
        except OrthocalError as error:
            # The diagnosis stands; only the extension is refused.
            common.tell_error(error, path)
            return error.exit_code
        go_on = replace(case, given=replace(given, machine_file=target)).typed("report")
        common.tell(f"{accept} is now part of {target}. Continue with:\n  {go_on}")
        return 0

    return common.for_each(files[-1:] if together else files, judge, as_json=json)

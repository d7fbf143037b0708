"""What `orthocal validate` found, as text and as its JSON object."""

from __future__ import annotations

from typing import Any

from orthoglide_cal.data import Check

_KINDS = {
    "readings": "reading{s}",
    "session": "reading{s} of a session",
    "six": "difference{s}, max − min",
    "twelve": "difference{s} from the isotropic posture",
    "single": "difference{s}, tool end − joint end",
}


def check_text(check: Check) -> str:
    """One line for a valid file; two for each fault: where and what, then the remedy."""
    path = "standard input" if check.path == "-" else check.path
    if check.kind == "machine":
        lines = [f"{path}: machine {check.name!r}, fine"]
    elif check.valid:
        what = _KINDS[check.kind or ""].format(s="" if check.count == 1 else "s")
        lines = [f"{path}: {check.count} {what}, fine (for {check.name})"]
    else:
        n = len(check.problems)
        lines = [f"{path}: {n} {'fault' if n == 1 else 'faults'}"]
    for problem in check.problems:
        place = [
            f"line {problem.line}" if problem.line is not None else "",
            f"column {problem.column}" if problem.column is not None else "",
        ]
        where = ", ".join(part for part in place if part)
        value = f" ({problem.value!r})" if problem.value is not None else ""
        lines.append(f"  {where}{': ' if where else ''}{problem.what}{value}")
        if problem.remedy:
            lines.append(f"    → {problem.remedy}")
    lines += [f"  note: {remark}" for remark in check.remarks]
    return "\n".join(lines)


def check_json(check: Check) -> dict[str, Any]:
    """The object of `validate --json`; fields that are not known are null."""
    return {
        "schema_version": 1,
        "input": {
            "path": check.path,
            "sha256": check.source.sha256 if check.source else None,
            "kind": check.kind,
            "readings": check.count,
        },
        "machine": check.name or None,
        "valid": check.valid,
        "problems": [
            {
                "line": problem.line,
                "column": problem.column,
                "value": problem.value,
                "what": problem.what,
                "remedy": problem.remedy,
            }
            for problem in check.problems
        ],
        "remarks": list(check.remarks),
    }

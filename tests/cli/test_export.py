"""`orthocal export`: one format at a time, refusals with their exit code."""

from tests.cli.program import SIX, UNDETERMINED, refused, run


def test_what_must_not_be_used_is_marked_if_forced() -> None:
    said = refused(4, "export", SIX)
    assert "Export refused." in said
    assert "To export it anyway, marked as FORCED: --force" in said
    forced = run("export", SIX, "--force", "--format", "linuxcnc")
    assert forced.exit_code == 0
    assert "# FORCED: this result must not be used." in forced.stdout
    assert forced.stdout.count("HOME_OFFSET = ") == 3
    assert forced.stderr.startswith("FORCED: ")
    nothing = run("export", "-", "--force", text=UNDETERMINED)
    assert (nothing.exit_code, nothing.stdout) == (4, "")
    assert "--force" not in nothing.stderr

"""The page with the machine in motion: its script does what it says, and nothing else runs."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from orthoglide_cal.cli.app import app
from orthoglide_cal.report.documents.calibration import calibration_document
from orthoglide_cal.report.escape import in_script
from orthoglide_cal.report.html import html
from tests.machines import ROOT, SAMPLES
from tests.report.chromium import Browser, browser, find_chromium
from tests.report.test_browser import CUT, OVERFLOW, WIDTHS
from tests.results import cases

PROGRAM = find_chromium()
SCRIPT = ROOT / "orthoglide_cal" / "report" / "motion.js"
# Puts the controls, then says where the named part is.
MOVE = """(() => {
  const form = document.querySelector('form.controls');
  for (const [name, value] of Object.entries(%s)) form.elements[name].value = value;
  form.dispatchEvent(new Event('input'));
  const at = (name, ...keys) => { const part = document.querySelector(`[data-part="${name}"]`);
    return keys.map(key => Number(part.getAttribute(key))); };
  return [at('tool', 'cx', 'cy'), at('ghost-tool', 'cx', 'cy'), at('leg-y', 'x1', 'y1'),
          form.querySelector('output').textContent];
})()"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("motion") / "page.html"
    document = calibration_document(cases.named_in_machine(), interactive=True)
    path.write_text(html(document.page()), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    if PROGRAM is None:
        pytest.skip("there is no Chromium on this machine")
    with browser(PROGRAM) as running:
        yield running


def test_the_policy_allows_this_script_and_no_other(page: Path):
    whole = page.read_text(encoding="utf-8")
    scripts = re.findall("<script([^>]*)>(.*?)</script>", whole, re.DOTALL)
    assert [attributes for attributes, _ in scripts] == [
        ' type="application/json" class="motion"', "",
    ]  # fmt: skip
    digest = base64.b64encode(hashlib.sha256(scripts[1][1].encode()).digest()).decode()
    policy = re.search('Content-Security-Policy" content="([^"]*)"', whole)
    assert policy is not None
    assert f"script-src &#x27;sha256-{digest}&#x27;;" in policy[1]
    assert policy[1].startswith("default-src &#x27;none&#x27;;")
    assert "unsafe" not in policy[1]
    assert len(SCRIPT.read_text(encoding="utf-8").splitlines()) <= 150
    assert not re.search("https?:|fetch|import|eval|innerHTML", scripts[1][1])


def test_no_text_ends_the_data_of_a_script():
    harmful = {"a": "</script><script>alert(1)</script><!--", "b": ["&lt;", "\u2028", "é"]}
    written = in_script(harmful)
    assert not set("<>&\u2028") & set(written)
    assert json.loads(written) == harmful


def test_without_the_option_nothing_runs():
    assert "<script" not in html(calibration_document(cases.named_in_machine()).page())
    assert "<script" not in html(calibration_document(cases.failed(), interactive=True).page())


def test_the_picture_shows_where_the_machine_stands(chromium: Browser, page: Path):
    """Every place in the picture from the calibration's own numbers, projected here."""
    found = cases.named_in_machine().travel
    assert found is not None
    chromium.open(page, width=1000)
    assert chromium.complaints() == []
    assert [url for url in chromium.requests() if not url.startswith("data:")] == [page.as_uri()]
    factors = (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
    for frame, enlarged, turn, when in ((0, 5, 0, "before"), (17, 6, 40, "after"),
                                        (26, 3, -150, "before")):  # fmt: skip
        real = {"before": found.before_mm, "after": found.after_mm}[when][frame]
        believed = found.nominal_mm[frame]
        drawn = believed + factors[enlarged] * (real - believed)
        controls = {"posture": frame, "enlarged": enlarged, "turn": turn, "when": when}
        tool, ghost, leg, said = chromium.evaluate(MOVE % json.dumps(controls))
        assert tool == pytest.approx(paper(drawn[3], turn), abs=0.05)
        assert ghost == pytest.approx(paper(believed[3], turn), abs=0.05)
        assert leg == pytest.approx(paper(drawn[1], turn), abs=0.05)
        off = float(np.linalg.norm((real - believed)[3]))
        assert f"{when}: tool off by {off:.3f} mm" in said
        assert f"drawn × {factors[enlarged]}." in said


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", WIDTHS)
def test_it_fits_every_width(chromium: Browser, page: Path, width: int, dark: bool):
    chromium.open(page, width=width, dark=dark)
    assert chromium.evaluate(OVERFLOW) == []
    assert chromium.evaluate(CUT) == []
    chromium.open(page, width=width, media="print")
    shown = "getComputedStyle(document.querySelector('.controls')).display"
    assert chromium.evaluate(shown) == "none"


def paper(point: np.ndarray, degrees: float) -> list[float]:
    """Turned about z, then seen along the space diagonal; a leg of 310.25 mm is 128 long."""
    turn = np.radians(degrees)
    x = np.cos(turn) * point[0] - np.sin(turn) * point[1]
    y = np.sin(turn) * point[0] + np.cos(turn) * point[1]
    scale = 128.0 / 310.25
    return [180.0 + scale * 0.84 * (y - x), 186.0 + scale * (0.5 * (x + y) - point[2])]


def test_it_moves_when_a_slider_is_used(chromium: Browser, page: Path):
    """By the keyboard, as a reader would."""
    chromium.open(page, width=1000)
    said = "document.querySelector('form.controls output').textContent"
    before = chromium.evaluate(said)
    assert before.startswith("leg x at -100 mm, before")
    chromium.evaluate("document.querySelector('[name=posture]').focus()")
    for kind in ("keyDown", "keyUp"):
        chromium.call("Input.dispatchKeyEvent", type=kind, key="ArrowRight", code="ArrowRight",
                      windowsVirtualKeyCode=39)  # fmt: skip
    assert chromium.evaluate(said).startswith("leg x at -75 mm, before")


def test_without_scripts_the_page_says_the_same(chromium: Browser, page: Path):
    chromium.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        chromium.open(page, width=360)
        assert chromium.complaints() == []
        hidden = chromium.evaluate("getComputedStyle(document.querySelector('.controls')).display")
        assert hidden == "none"
        text = chromium.evaluate("document.body.innerText")
        assert "Distance of the tool from where the controller believes it to be" in text
        assert "leg z at +60 mm" in text
        assert '"frames"' not in text
        still = chromium.evaluate("document.querySelector('[data-part=tool]').getAttribute('cx')")
        found = cases.named_in_machine().travel
        drawn = found.nominal_mm[0] + 20 * (found.before_mm[0] - found.nominal_mm[0])
        assert float(still) == pytest.approx(paper(drawn[3], 0.0)[0], abs=0.05)
    finally:
        chromium.call("Emulation.setScriptExecutionDisabled", value=False)


def test_interactive_needs_a_page(tmp_path: Path):
    run = CliRunner()
    file = str(SAMPLES / "experiment2.csv")
    refused = run.invoke(app, ["report", file, "--interactive"])
    assert refused.exit_code == 2
    assert "--html FILE" in refused.stderr
    target = tmp_path / "page.html"
    made = run.invoke(app, ["report", file, "--interactive", "--html", str(target)])
    assert made.exit_code == 0
    assert '<script type="application/json"' in target.read_text(encoding="utf-8")

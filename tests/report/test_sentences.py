"""Every reason that the package gives has its sentence, and no sentence is without a reason."""

import re

from orthoglide_cal.report.sentences import _COMPOSED, _SENTENCES
from tests.machines import ROOT


def test_reasons_and_sentences_belong_together() -> None:
    source = "".join(path.read_text() for path in (ROOT / "orthoglide_cal").rglob("*.py"))
    known = {*_COMPOSED, *_SENTENCES}
    assert set(re.findall(r'Reason\.of\(\s*"(\w+)"', source)) <= known
    quoted = set(re.findall(r'"(\w+)"', source))
    # The names of some are made of a field or a cause.
    assert {re.sub("^(gauge|doubted)_", "", code) for code in known - quoted} <= quoted

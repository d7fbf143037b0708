"""`orthocal guide`: the manual in the terminal; its pages are the Markdown files of `guide/`."""

import os
from pathlib import Path

from orthoglide_cal.cli import common
from orthoglide_cal.cli.common import Texts, argument
from orthoglide_cal.errors import UsageError

_WIDEST = 100  # longer lines are hard to read


def _pages() -> dict[str, Path]:
    """The pages of the manual by their plain names."""
    from importlib.resources import files

    folder = Path(str(files("orthoglide_cal") / "guide"))
    return {_plain(path.stem): path for path in sorted(folder.rglob("*.md"))}


def _topics(incomplete: str) -> list[str]:
    """Names of pages that begin so, for the shell."""
    return [path.stem for path in _pages().values() if path.stem.startswith(incomplete)]


def guide(
    topic: Texts = argument(
        "TOPIC", "Topic, or id of a cause. Default: the list of topics.", _topics
    ),
) -> None:
    """Show a page of the manual; in a pipe, as Markdown."""
    name, pages = " ".join(topic or ["index"]), _pages()
    if (wanted := _plain(name)) not in pages:
        raise UsageError(f"The guide has no page {name!r}.", "All pages: orthocal guide")
    # Above its title stands what other pages take from the page of a cause.
    text = pages[wanted].read_text(encoding="utf-8")
    text = text.split("---\n", 2)[2].lstrip() if text.startswith("---\n") else text
    console = common.console()
    if not console.is_terminal:
        print(text, end="")
        return
    from rich.markdown import Markdown
    from rich.theme import Theme

    # Colours of the terminal itself: rich's own are a dark patch on a light screen.
    with console.use_theme(Theme({"markdown.code": "bold cyan"})):
        page = Markdown(text, code_theme="ansi_dark")
        # The pager of the system shows colours only if it is told to.
        os.environ.setdefault("LESS", "-FRX")
        with console.pager(styles=True):
            console.print(page, width=min(console.width, _WIDEST))


def _plain(name: str) -> str:
    return "-".join(name.lower().replace("_", " ").replace("-", " ").split())

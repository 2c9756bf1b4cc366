"""What the site needs beside Markdown: formulas as MathML, which browsers draw without a script; roles of docstrings as
plain code; and fences without the word ``fails``, which is for the tests."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
DEFAULT = re.compile(r",\s*default:\s*<code>.*?</code>", re.DOTALL)
"""Of parameters that are described together the parser knows that of the first; the signature has them all."""
NO_DESCRIPTION = re.compile(r"–\s*<div class=\"doc-md-description\">\s*</div>")
ROLE = re.compile(r":(?:attr|class|func|meth|mod):(?=<code>)")


def _mathml(found: re.Match[str]) -> str:
    latex = re.sub(r"\\tag\{(.*?)\}", r"\\qquad (\1)", html.unescape(found[2]))
    return (
        f'<{found[1]} class="formula">{convert(latex, display="block" if found[1] == "div" else "inline")}</{found[1]}>'
    )


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Change the text of a page."""
    return markdown.replace("```sh fails", "```sh")


def on_page_content(content: str, **_: Any) -> str:
    """Change the HTML of a page's Markdown."""
    for nothing in (ROLE, DEFAULT, NO_DESCRIPTION):
        content = nothing.sub("", content)
    return FORMULA.sub(_mathml, content)

"""Templates, and what comes from outside in them: units of a recording's header, names of files, solvers and models.

Each target has one function that makes such text harmless there or refuses it, and one environment that applies it. HTML and XML
are escaped wherever a template names a value. Templates of C and Markdown name the function as a filter, and C refuses what could
end a comment or a string and has passed through none.
"""

from __future__ import annotations

import re
from typing import Any

import jinja2
from markupsafe import Markup, escape


def c_comment(text: str) -> Markup:
    """Text inside a comment of C.

    Examples
    --------
    >>> str(c_comment("N*m */ int main; ??/"))
    'N_m _/ int main; _?/'
    """
    return Markup(re.sub(r"[^ -~]|[*\\]|\?(?=\?)", "_", text))


def c_string(text: str) -> Markup:
    """A string literal of C that holds this text in UTF-8.

    Examples
    --------
    >>> print(c_string('% "µm" \\\\'))
    "% \\"\\302\\265m\\" \\\\"
    """
    return Markup('"' + "".join(_character(byte) for byte in text.encode("utf-8", "replace")) + '"')


def _character(byte: int) -> str:
    sign = chr(byte)
    if sign in '"\\?':  # the question mark ends what could be a trigraph
        return "\\" + sign
    return sign if " " <= sign <= "~" else f"\\{byte:03o}"


def c_identifier(text: str) -> str:
    """The text, if C takes it for an identifier that is not reserved; ValueError otherwise."""
    if not (text.isascii() and text.isidentifier() and not text.startswith("_")):
        raise ValueError(f"{text!r} is no identifier of C")
    return text


def xml(text: Any) -> Markup:
    """Text of an element or attribute; what XML 1.0 cannot hold becomes U+FFFD.

    Examples
    --------
    >>> str(xml('1" <b>\\x00'))
    '1&#34; &lt;b&gt;\\ufffd'
    """
    return escape(text if isinstance(text, Markup) else re.sub("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", str(text)))


def markdown(text: Any) -> str:
    """Text in a line of Markdown, nothing in it being markup.

    Examples
    --------
    >>> markdown("<b>1 | 2</b>\\n`x`")
    '&#60;b&#62;1 &#124; 2&#60;/b&#62; &#96;x&#96;'
    """
    return re.sub(r"[\\`*\[\]<>&|~]", lambda found: f"&#{ord(found[0])};", " ".join(str(text).split()))


def html_templates(package: str) -> jinja2.Environment:
    """Templates of pages."""
    return _templates(package, autoescape=True)


def xml_templates(package: str) -> jinja2.Environment:
    """Templates of XML."""
    return _templates(package, autoescape=True, finalize=xml)


def markdown_templates(package: str, *shared: str) -> jinja2.Environment:
    """Templates of Markdown, which may build on those of shared packages; its filter is ``plain``."""
    environment = _templates(package, *shared)
    environment.filters["plain"] = markdown
    return environment


def c_templates(package: str) -> jinja2.Environment:
    """Templates of C; their filters are ``comment`` and ``string``."""
    environment = _templates(package, finalize=_harmless, keep_trailing_newline=True)
    environment.filters |= {"comment": c_comment, "string": c_string}
    return environment


def _templates(*packages: str, **options: Any) -> jinja2.Environment:
    loader = jinja2.ChoiceLoader([jinja2.PackageLoader(package) for package in packages])
    return jinja2.Environment(loader=loader, trim_blocks=True, lstrip_blocks=True,
                              undefined=jinja2.StrictUndefined, **options)


def _harmless(value: Any) -> Any:
    if isinstance(value, str) and not isinstance(value, Markup) and re.search(r'["\\%\n]|/\*|\*/|\?\?', value):
        raise ValueError(f"{value!r} reaches the template without a filter")
    return value

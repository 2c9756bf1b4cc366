"""Safe rendering of text from outside: units in a recording's header, names of files, messages of solvers.

Each target has one function that makes such text harmless there or refuses it, and one place that applies it: the
console, and an environment of templates for HTML, XML, Markdown and C. HTML, XML and Markdown are escaped wherever a
template names a value. Templates of C name the function as a filter, and what could end a comment or a string and has
passed through none is refused.
"""

import re
from typing import Any

import jinja2
from markupsafe import Markup, escape


def c_comment(text: str) -> Markup:
    """Text inside a comment of C, with u for µ.

    Examples
    --------
    >>> str(c_comment("µm, N*m */ int main; ??/"))
    'um, N_m _/ int main; _?/'
    """
    return Markup(re.sub(r"[^ -~]|[*\\]|\?(?=\?)", "_", text.replace("µ", "u")))


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
    if sign in '"\\?':  # the question mark could be part of a trigraph
        return "\\" + sign
    return sign if " " <= sign <= "~" else f"\\{byte:03o}"


def xml(text: Any) -> Markup:
    """Text of an element or attribute; characters that XML 1.0 does not allow become U+FFFD.

    Examples
    --------
    >>> str(xml('1" <b>\\x00'))
    '1&#34; &lt;b&gt;\\ufffd'
    """
    return escape(
        text
        if isinstance(text, Markup)
        else re.sub("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", str(text))
    )


def terminal(text: str) -> str:
    r"""Text on a terminal, which takes nothing in it for a command: characters that cannot be printed are written as in
    Python.

    Examples
    --------
    >>> print(terminal("two\nlines, 3 µm, \x1b[2J \x9b \ud800"))
    two
    lines, 3 µm, \x1b[2J \x9b \ud800
    """
    return "".join(sign if sign.isprintable() or sign in "\n\t " else repr(sign)[1:-1] for sign in text)


def markdown(text: Any) -> Markup:
    """Text in a line of Markdown, nothing in it being markup.

    Examples
    --------
    >>> print(markdown("<b>1 | 2</b>\\n`x`"))
    &#60;b&#62;1 &#124; 2&#60;/b&#62; &#96;x&#96;
    """
    if isinstance(text, Markup):
        return text
    line = terminal(re.sub(r"\s*[\n\r\v\f\x1c-\x1e\x85\u2028\u2029]\s*", " ", str(text)))
    return Markup(re.sub(r"[\\`*\[\]<>&|~]", lambda match: f"&#{ord(match[0])};", line))


def markup_templates(package: str) -> jinja2.Environment:
    """Templates of HTML and XML."""
    return _templates(package, autoescape=True, finalize=xml)


def markdown_templates(package: str) -> jinja2.Environment:
    """Templates of Markdown; lists are escaped by the filter ``plain`` before they are joined."""
    environment = _templates(package, autoescape=True, finalize=markdown)
    environment.filters["plain"] = markdown
    return environment


def c_templates(package: str) -> jinja2.Environment:
    """Templates of C; their filters are ``comment`` and ``string``."""
    environment = _templates(package, finalize=_harmless, keep_trailing_newline=True)
    environment.filters |= {"comment": c_comment, "string": c_string}
    return environment


def _templates(package: str, **options: Any) -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader(package),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        **options,
    )


def _harmless(value: Any) -> Any:
    if isinstance(value, str) and not isinstance(value, Markup) and re.search(r'["\\%\n]|/\*|\*/|\?\?', value):
        raise ValueError(f"{value!r} reaches the template without a filter")
    return value

"""The manual page of the configuration, site.toml(5), from the models of docs/reference/configuration.md."""

from __future__ import annotations

import re

from tests.reference.configuration_page import Key, tables

HEAD = r"""
.TH SITE.TOML 5 "" "Starter Gateway" "Starter Gateway"
.SH NAME
site.toml \- configuration of starter\-gateway(1)
.SH DESCRIPTION
One TOML file describes a site: \fI/etc/starter\-gateway/site.toml\fR for the service.
File names in it are relative to its folder.
\fBstarter\-gateway check FILE\fR names every mistake with its key and line;
\fBstarter\-gateway schema\fR prints all of this as JSON Schema.
""".lstrip()
END = r"""
.SH EXAMPLES
\fI/usr/share/doc/starter\-gateway/examples\fR
.SH SEE ALSO
.BR starter\-gateway (1)
""".lstrip()


def site_manual() -> str:
    """Return the page in roff."""
    parts = [HEAD]
    for table in tables():
        if table.keys:
            parts += [f".SH {_roff(table.header)}", _roff(table.meaning), *map(_entry, table.keys)]
    return "\n".join([*parts, END]).replace("\n\n", "\n")


def _entry(key: Key) -> str:
    plain = [key.kind, key.unit, key.limits]
    about = ", ".join(_roff(_plain(each)) for each in plain if each)
    default = "required" if "required" in key.default else f"default: {_plain(key.default)}"
    return f".TP\n\\fB{_roff(key.name)}\\fR ({about}; {_roff(default)})\n{_roff(_plain(key.meaning))}"


def _plain(text: str) -> str:
    return re.sub(r"[`*]", "", text).replace("\\|", "|")


def _roff(text: str) -> str:
    """Return a text without what roff takes for a request or an escape."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{text}" if text.startswith((".", "'")) else text

"""Docstrings as they are written here, fit for reStructuredText and for links between packages.

An indented paragraph is a formula or a table, and shown as it stands. A name such as `Experiment`
means what a package exports, wherever that was defined.
"""

import re
import sys
from itertools import groupby
from typing import Any

from docutils.nodes import Element, Text, TextElement
from sphinx.addnodes import desc_annotation, pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode
from sphinx.util.typing import stringify_annotation

import compare.cli  # noqa: F401  it loads every module
from experiment.arrays import Floats, Ints
from experiment.fields import Part

ALIASES = {"Floats": Floats, "Ints": Ints}
IN_SIGNATURES = {stringify_annotation(kind, "smart"): name for name, kind in ALIASES.items()}
IN_PROPERTIES = {re.sub(r"~[a-z.]+\.", "", long): name for long, name in IN_SIGNATURES.items()}
PACKAGES = ("experiment", "ca_model", "continuum", "compare")


def keep_formulae(
    _app: Sphinx, _what: str, _name: str, _obj: Any, _options: Any, lines: list[str]
) -> None:
    """Make indented paragraphs literal blocks, and the rest free of accidental markup."""
    kept: list[str] = []
    for indented, paragraph in groupby(lines, lambda line: line.startswith("    ") or None):
        if indented:
            kept += ["", "::", "", *paragraph, ""]
        else:
            kept += [re.sub(r"([|*])|_(?=\W|$)", r"\\\g<0>", line) for line in paragraph]
    lines[:] = kept


def shorten_signature(
    _app: Sphinx, what: str, _name: str, obj: Any, _options: Any, signature: str, returns: str
) -> tuple[str, str] | None:
    """Arrays by the names of experiment/arrays.py; of a part of a set-up its fields tell all."""
    if what == "class" and issubclass(obj, Part):
        return "(**fields)", ""
    for long, short in IN_SIGNATURES.items():
        signature = signature and signature.replace(long, short)
        returns = returns and returns.replace(long, short)
    return signature, returns


def shorten_property(_app: Sphinx, _domain: str, kind: str, content: Element) -> None:
    """As :func:`shorten_signature`, of what is no call: a property's type, or an attribute's."""
    if kind in ("property", "attribute"):
        for told in content.parent.findall(desc_annotation):
            short = IN_PROPERTIES.get(told.astext().removeprefix(": "))
            if short:
                told[:] = [Text(f": {short}")]


def tell_of_fields(
    _app: Sphinx, what: str, _name: str, obj: Any, _options: Any, lines: list[str]
) -> None:
    """Lead from a part of a set-up to the page of its fields."""
    if what == "class" and issubclass(obj, Part):
        lines += ["Its fields are those of a :doc:`set-up </reference/set-up>`.", ""]


def set_example_apart(_app: Sphinx, _command: Any, lines: list[str]) -> None:
    """The example at the end of a command's help, on lines of its own."""
    for k, line in enumerate(lines):
        if line.startswith("Example: "):
            lines[k:] = ["::", "", "    " + " ".join([line, *lines[k + 1 :]])[9:].strip(), ""]
            return


def find_by_last_name(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: TextElement
) -> Element | None:
    """Lead to the one documented object of that last name; what is internal leads nowhere."""
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"].rpartition(".")[2]
    objects = env.domains.python_domain.objects.items()
    places = {(at.docname, at.node_id) for full, at in objects if full.endswith(f".{name}")}
    if len(places) == 1:
        docname, node_id = places.pop()
        return make_refnode(app.builder, node["refdoc"], docname, node_id, content)
    return content if _is_ours(node["reftarget"]) else None


def _is_ours(target: str) -> bool:
    """Whether a module of these packages has that name, or something of that name in it."""
    name = target.rpartition(".")[2]
    ours = [module for path, module in sys.modules.items() if path.split(".")[0] in PACKAGES]
    return target in sys.modules or any(name in vars(module) for module in ours)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", keep_formulae)
    app.connect("autodoc-process-docstring", tell_of_fields)
    app.connect("autodoc-process-signature", shorten_signature)
    app.connect("object-description-transform", shorten_property)
    app.connect("sphinx-click-process-description", set_example_apart)
    app.connect("missing-reference", find_by_last_name)
    return {"parallel_read_safe": True}

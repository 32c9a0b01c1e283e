"""What the code itself tells: fields of a set-up, variables of an archive, presets, public names.

    ```{generated} set-up mixture
    ```

stands for the Markdown that the function of the first word makes of the second.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from inspect import cleandoc
from typing import Any

import tomli_w
from docutils.nodes import Node
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective

import ca_model
import continuum
from experiment import (
    Cell,
    Constant,
    Experiment,
    Feed,
    Mixture,
    Pour,
    Published,
    Pulses,
    Sine,
    Source,
    Table,
    load,
    preset_names,
    preset_text,
)
from experiment.archive.variables import COORDINATES, VARIABLES
from experiment.fields import LARGEST, Part

PARTS: dict[str, type[Part]] = {
    "experiment": Experiment,
    "mixture": Mixture,
    "cell": Cell,
    "feed": Feed,
    "constant": Constant,
    "pulses": Pulses,
    "sine": Sine,
    "table": Table,
    "source": Source,
    "pour": Pour,
    "published": Published,
    "ca_model": ca_model.Settings,
    "continuum": continuum.Resolution,
}
PACKAGES = (
    "experiment",
    "experiment.archive",
    "experiment.law",
    "ca_model",
    "continuum",
    "continuum.theory",
    "compare",
    "compare.pictures",
)
UNITS = {"1", "cm", "s", "1/s", "cm/s", "cm2/s"}


def set_up(name: str) -> str:
    """The fields of a part of a set-up, and what its docstring says of them."""
    part = PARTS[name]
    schema = part.model_json_schema()
    meanings = _comments(part)
    rows = []
    for field, info in part.model_fields.items():
        unit, semicolon, meaning = meanings[field].partition("; ")
        if unit not in UNITS:
            unit, meaning = "", unit + semicolon + meaning
        allowed = _allowed(schema["properties"][field], schema.get("$defs", {}))
        rows.append((f"`{field}`", allowed, unit, _default(info), meaning))
    told = _markdown(cleandoc(part.__doc__ or ""))
    return f"{told}\n\n{_table(('field', 'allowed', 'unit', 'default', 'meaning'), rows)}"


def shorthands(name: str) -> str:
    """The names that a part of a set-up knows besides its fields, of two species."""
    part = PARTS[name]
    known = part.known_fields({"names": ["small", "large"]}) - set(part.model_fields)
    return ", ".join(f"`{shorthand}`" for shorthand in sorted(known))


def variables(_: str = "") -> str:
    """The coordinates and variables of an archive."""
    rows = [
        (
            f"`{variable.name}`",
            ", ".join(variable.dims),
            variable.units,
            variable.dtype,
            variable.long_name
            + ("; NaN where there is nothing" if variable.gaps else "")
            + ("; only where the set-up tells it" if variable.optional else ""),
        )
        for variable in (COORDINATES | VARIABLES).values()
    ]
    return _table(("name", "dimensions", "unit", "type", "meaning"), rows)


def presets(_: str = "") -> str:
    """Every preset: its title, and the file itself."""
    sections = []
    for name in preset_names():
        toml = preset_text(name).rstrip()
        sections.append(f"({name})=\n## `{name}`\n\n{load(name).title}.\n\n```toml\n{toml}\n```")
    return "\n\n".join(sections)


def api(package: str) -> str:
    """The public names of a package, by the file that each is defined in."""
    homes: dict[str, list[str]] = {}
    elsewhere = []
    for name in import_module(package).__all__:
        home = _home(package, name)
        if _page_of(home) == package:
            homes.setdefault(home, []).append(name)
        else:
            elsewhere.append(f"{{py:obj}}`{_page_of(home)}.{name}`")
    sections = [f"It also exports {', '.join(elsewhere)}."] if elsewhere else []
    for home, names in sorted(homes.items()):
        told = [f".. automodule:: {home}\n   :no-members:\n   :no-index:"]
        told += [_documented(package, name) for name in names]
        body = "\n\n".join(told)
        sections.append(f"## `{home}`\n\n```{{eval-rst}}\n{body}\n```")
    return "\n\n".join(sections)


PAGES = {
    "set-up": set_up,
    "shorthands": shorthands,
    "variables": variables,
    "presets": presets,
    "api": api,
}


class Generated(SphinxDirective):
    """What stands for the Markdown of a function."""

    required_arguments = 1
    optional_arguments = 1

    def run(self) -> list[Node]:
        """The Markdown, parsed where the directive stands."""
        self.env.note_reread()
        text = PAGES[self.arguments[0]](*self.arguments[1:])
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("generated", Generated)
    return {"parallel_read_safe": True}


def _comments(part: type[Part]) -> dict[str, str]:
    """The `#:` comment of each field, in one line."""
    found = ModuleAnalyzer.for_module(part.__module__).find_attr_docs()
    return {
        name: " ".join(lines).strip()
        for (owner, name), lines in found.items()
        if owner == part.__name__
    }


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    if info.default_factory is not None or info.default is None:
        return "optional"
    value = info.default
    if isinstance(value, Part):
        inside = tomli_w.dumps(value.model_dump()).strip().replace("\n", ", ")
        return f"`{{ {inside} }}`"
    return f"`{tomli_w.dumps({'value': value}).strip().removeprefix('value = ')}`"


def _allowed(schema: Mapping[str, Any], kinds: Mapping[str, Any]) -> str:
    """What a JSON schema allows, in words."""
    if "$ref" in schema:
        schema = kinds[schema["$ref"].rpartition("/")[2]]
    if "anyOf" in schema:
        choices = [one for one in schema["anyOf"] if one.get("type") != "null"]
        return " or ".join(dict.fromkeys(_allowed(one, kinds) for one in choices))
    if "enum" in schema or "const" in schema:
        words = schema.get("enum", [schema.get("const")])
        return ", ".join(f"`{word!r}`".replace("'", '"') for word in words)
    if schema["type"] == "array":
        if "prefixItems" in schema:
            return f"({', '.join(_allowed(one, kinds) for one in schema['prefixItems'])})"
        inside = _allowed(schema["items"], kinds)
        return inside.replace("list", "matrix") if "list" in inside else f"list, {inside}"
    named = {
        "integer": "whole number",
        "string": "text",
        "object": "table",
        "boolean": "true, false",
    }
    return " ".join([named.get(schema["type"], schema["type"]), ", ".join(_bounds(schema))]).strip()


def _bounds(schema: Mapping[str, Any]) -> list[str]:
    """The ends of a range, but for those that only keep numbers finite."""
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    return [
        f"{sign} {schema[name]:g}"
        for name, sign in signs.items()
        if name in schema and abs(schema[name]) < LARGEST
    ]


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    cells = [head, ["---"] * len(head), *rows]
    return "\n".join(
        f"| {' | '.join(cell.replace('|', '&#124;') for cell in row)} |" for row in cells
    )


def _markdown(docstring: str) -> str:
    """A docstring of one or more paragraphs, its roles as code."""
    return re.sub(r":\w+:`", "`", docstring)


def _home(package: str, name: str) -> str:
    """The module in which a public name is defined."""
    home: str = getattr(getattr(import_module(package), name), "__module__", package)
    return home


def _page_of(module: str) -> str:
    """The package on whose page the names of a module stand: the innermost one."""
    return max((one for one in PACKAGES if f"{module}.".startswith(f"{one}.")), key=len)


def _documented(package: str, name: str) -> str:
    """The directive that documents a public name; of a part of a set-up, all but its fields."""
    thing = getattr(import_module(package), name)
    if not isinstance(thing, type):
        return f".. auto{'function' if callable(thing) else 'data'}:: {package}.{name}"
    if issubclass(thing, Part):
        fields = ", ".join(["model_config", *thing.model_fields])
        return f".. autoclass:: {package}.{name}\n   :exclude-members: {fields}"
    kind = "exception" if issubclass(thing, Exception) else "class"
    return f".. auto{kind}:: {package}.{name}"

"""What a pour was made of and by: what two of them must share to be one."""

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import metadata
from typing import Any

from experiment.experiment import Experiment

__all__ = ["difference", "difference_of_setups", "made_by", "stamp", "version"]

version = cache(metadata.version)  # which reads a file
MADE_WITH = ("numpy", "numba")  # whose versions may change a last digit


def stamp(model: str, experiment: Experiment) -> dict[str, str]:
    """The attributes of an archive that say what was poured by which model and version."""
    return {
        "source": f"{model} of {made_by()}",
        "model": model,
        "experiment": experiment.to_toml(),
    }


def made_by() -> str:
    """The version of `stratify`, and of what may change the last digits of its numbers."""
    tools = ", ".join(f"{tool} {version(tool)}" for tool in MADE_WITH)
    return f"stratify {version('stratify')} with {tools}"


def difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """How the stamp of what is there differs from that of what is asked for; empty if it does not.

    Of several differences the first.
    """
    if there["source"] != here["source"]:
        return f"there {there['source']}, here {here['source']}"
    setups = (Experiment.from_toml(str(told["experiment"])) for told in (there, here))
    return difference_of_setups(*setups)


def difference_of_setups(there: Experiment, here: Experiment) -> str:
    """The first field in which two set-ups differ, and its values; empty if there is none."""
    old, new = dict(_fields(there)), dict(_fields(here))
    for key in [*new, *old]:
        if old.get(key) != new.get(key):
            return f"{key} = {old.get(key, 'not set')} there, {new.get(key, 'not set')} here"
    return ""


def _fields(experiment: Experiment) -> Iterator[tuple[str, object]]:
    """Every field of a set-up by its dotted name."""

    def walk(path: str, value: object) -> Iterator[tuple[str, object]]:
        if isinstance(value, Mapping):
            for name, part in value.items():
                yield from walk(f"{path}.{name}" if path else str(name), part)
        else:
            yield path, value

    return walk("", experiment.model_dump(mode="json", exclude_none=True))

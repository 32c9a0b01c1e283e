"""Where a closed form holds, and how it says that it does not."""

from collections.abc import Mapping

from experiment import Experiment, NotApplicableError

__all__ = ["refuse_unless", "steady_silo"]


def refuse_unless(conditions: Mapping[str, object], closed_form: str) -> None:
    """Raise :class:`NotApplicableError` for the first condition, `field: value`, not met."""
    for condition, holds in conditions.items():
        if not holds:
            raise NotApplicableError(f"{condition}; {closed_form} holds for no other")


def steady_silo(experiment: Experiment) -> dict[str, bool]:
    """The conditions of a silo with a wall that is fed steadily."""
    cell = experiment.cell
    return {
        "cell.shape: silo": cell.shape == "silo",
        "cell.end: wall": cell.end == "wall",
        "feed.schedule: constant": experiment.feed.schedule.kind == "constant",
    }

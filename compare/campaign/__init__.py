"""Many pours, each measured as it is poured: a campaign, in this process, in several, or on many.

`jobs` says what one pour of many is and what comes of it; `processes` shares jobs among the
processors of this machine, `cluster` among the workers of a Dask cluster; `schedulers` chooses. The
numbers are the same wherever a job is done.
"""

from compare.campaign.campaign import campaign
from compare.campaign.jobs import (
    BEGIN,
    CHECK,
    LOST,
    POUR,
    Job,
    Outcome,
    Outcomes,
    Pour,
    Scheduler,
    with_chance,
)
from compare.campaign.schedulers import scheduler_of
from compare.campaign.table import Table

__all__ = [
    "BEGIN",
    "CHECK",
    "LOST",
    "POUR",
    "Job",
    "Outcome",
    "Outcomes",
    "Pour",
    "Scheduler",
    "Table",
    "campaign",
    "scheduler_of",
    "with_chance",
]

"""What is known on paper, and whether the models and the instrument have it right.

Each subject is a function that makes its pours, which it is given a function for, and yields
checks: a number, what it should be, by whom, and how far off it may be. `steady`, `waves` and
`layers` are of the continuum, `lattice` of the lattice, `instrument` of the measurements on what is
`drawn`, `published` of experiments; `report` tells them.
"""

from compare.validation.check import Check, Poured
from compare.validation.report import page, record, table
from compare.validation.subjects import SUBJECTS, Finding, chosen, validate

__all__ = [
    "SUBJECTS",
    "Check",
    "Finding",
    "Poured",
    "chosen",
    "page",
    "record",
    "table",
    "validate",
]

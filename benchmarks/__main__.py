"""All benchmarks but the giant, or those named: `python -m benchmarks [pours] [lattice] ...`."""

import sys
from importlib import import_module

SUBJECTS = (
    "pours",
    "lattice",
    "rates",
    "continuum",
    "solvers",
    "grains",
    "archives",
    "recording",
    "measuring",
    "diagrams",
    "films",
)
ON_REQUEST = ("giant",)

for subject in sys.argv[1:] or SUBJECTS:
    if subject not in SUBJECTS + ON_REQUEST:
        known = ", ".join(SUBJECTS + ON_REQUEST)
        sys.exit(f"{subject}: no such benchmark; there are {known}")
    module = import_module(f"benchmarks.{subject}")
    print(f"\n== {subject}: {module.__doc__.splitlines()[0]}")
    module.main()
